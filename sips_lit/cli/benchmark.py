"""sips-benchmark: many detectors on the same pairs, on one pair set or several."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from sips_lit.cli.app import run
from sips_lit.cli.evaluation import best_auc, run_evaluation, told
from sips_lit.cli.methods import make_methods
from sips_lit.cli.next_steps import tensorboard


def benchmark(config: DictConfig) -> float:
    """Measures ``detectors``, each with its own and the common descriptor. Returns the best AUC of the first pair set."""
    skipped: dict[str, str] = {}
    methods = make_methods(config, told(skipped))
    return best_auc(run_evaluation(config, methods, skipped, Path(config.paths.run)))


main = partial(run, "benchmark", benchmark, tensorboard)

if __name__ == "__main__":
    main()
