"""A comparison of detectors on several pair sets, as part of a training run."""

from __future__ import annotations

from pathlib import Path

from omegaconf import DictConfig

from sips_lit.cli.app import build
from sips_lit.detect.detector import SipsDetector
from sips_lit.evaluate.evaluation import evaluate
from sips_lit.evaluate.pictures import write_match_pictures
from sips_lit.evaluate.results import protocol_line, table, write_results


def compare(config: DictConfig, checkpoint: Path, folder: Path) -> None:
    """Evaluates the checkpoint and the ``detectors`` of the config on each of its ``pair_sets``; prints a table a set.

    A detector is ``{detector, descriptor}``, a pair set ``{title, pairs, k}``; results go to ``folder``.
    """
    methods = {"sips": (SipsDetector.from_checkpoint(checkpoint), build(config.descriptor))}
    for key, entry in config.detectors.items():
        methods[str(key)] = (build(entry.detector), build(entry.descriptor))
    for name, entry in config.pair_sets.items():
        pairs = build(entry.pairs)
        results = {
            key: evaluate(detector, descriptor, pairs, entry.k, entry.n_max)
            for key, (detector, descriptor) in methods.items()
        }
        print(f"\n{entry.title}\n\n{table(list(results.values()))}\n\n{protocol_line(results['sips'])}")
        write_results(folder / str(name), results)
        write_match_pictures(folder / str(name), "sips", results["sips"], pairs, *methods["sips"], config.n)
    print(f"\ncomparison:  {folder} (tables as JSON and CSV, curves, reliability, match pictures)")
