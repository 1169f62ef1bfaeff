"""sips-evaluate: one detector on one pair set, a benchmark of one method."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from omegaconf import DictConfig

from sips_lit.cli.app import run
from sips_lit.cli.evaluation import best_auc, run_evaluation
from sips_lit.cli.methods import configured_method
from sips_lit.cli.next_steps import tensorboard


def evaluate(config: DictConfig) -> float:
    """Measures ``detector`` with ``descriptor``. Returns the succinctness AUC."""
    return best_auc(run_evaluation(config, [configured_method(config)], {}, Path(config.paths.run)))


main = partial(run, "evaluate", evaluate, tensorboard)

if __name__ == "__main__":
    main()
