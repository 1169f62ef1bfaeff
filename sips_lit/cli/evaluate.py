"""sips-evaluate: one detector on one pair set, a benchmark of one method."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from sips_lit.cli.app import run
from sips_lit.cli.evaluation import best_auc, run_evaluation
from sips_lit.cli.methods import configured_method


def evaluate(config: DictConfig) -> float:
    """Measures ``detector`` with ``descriptor``. Returns the succinctness AUC."""
    return best_auc(run_evaluation(config, [configured_method(config)], {}, Path(config.paths.run)))


main = partial(run, "evaluate", evaluate)

if __name__ == "__main__":
    main()
