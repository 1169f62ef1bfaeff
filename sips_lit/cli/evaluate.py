"""sips-evaluate: one detector on one pair set."""

from __future__ import annotations

from pathlib import Path

import cv2
from omegaconf import DictConfig

from sips_lit.cli.app import build, run
from sips_lit.evaluate.evaluation import evaluate
from sips_lit.evaluate.pairs import draw_pairs
from sips_lit.evaluate.pictures import write_match_pictures
from sips_lit.evaluate.results import protocol_line, table, write_results


def evaluate_one(config: DictConfig) -> float:
    """Evaluates, prints the table, writes results and pictures. Returns the succinctness AUC."""
    cv2.setNumThreads(-1)
    detector, descriptor = build(config.detector), build(config.descriptor)
    pairs = draw_pairs(
        build(config.data),
        build(config.inliers),
        config.paths.indexes,
        config.pairs,
        config.overlap,
        config.seed,
        workers=config.workers,
    )
    evaluation = evaluate(detector, descriptor, pairs, config.k, config.n_max, config.search)
    print(f"{table([evaluation])}\n\n{protocol_line(evaluation)}")
    folder = Path(config.paths.run)
    written = write_results(folder, {"result": evaluation})
    written += write_match_pictures(folder / "pictures", "pair", evaluation, pairs, detector, descriptor, config.n)
    print("\nwrote:\n" + "\n".join(f"  {path}" for path in written))
    return evaluation.succinctness.auc


def main() -> None:
    """Entry point."""
    run("evaluate", evaluate_one)


if __name__ == "__main__":
    main()
