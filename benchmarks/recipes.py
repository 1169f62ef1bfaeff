"""A table of a sweep of recipe_search: how good each recipe is on each kind of data that it was not trained on.

    python benchmarks/recipes.py outputs/sweep/... [SCALAR]        SCALAR: val/n_at_80, val/ece, ... (val/succinctness_auc)

A row is a recipe (what was swept besides `held_out` and the seed), a column a kind; a cell is the mean of its seeds, and the
standard deviation where there are several. The last column is the mean of the kinds. Runs that have not ended are left out.
Runs of a kind that were validated on different pairs do not compare: it says so instead.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from omegaconf import OmegaConf
from tabulate import tabulate
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sips_lit.callbacks.cards import card_of
from sips_lit.cli.validation_record import FILE, digest_in

KIND, SEED = "held_out", "seed"


@dataclass(frozen=True, slots=True)
class JudgedRun:
    """What was set in a run, without its kind and seed; the kind; the scalar of its last validation; and on what that is."""

    recipe: tuple[str, ...]
    kind: str
    value: float
    judged_on: str | None = None


def read_runs(sweep: Path, scalar: str) -> list[JudgedRun]:
    """The runs of a sweep that have such a scalar, in the order of their numbers."""
    runs = []
    for overrides in sorted(sweep.glob("*/.hydra/overrides.yaml"), key=lambda file: file.parts[-3].zfill(9)):
        folder = overrides.parents[1]
        pairs = [str(override).split("=", 1) for override in OmegaConf.load(overrides)]
        given = {pair[0]: pair[-1] for pair in pairs}
        events = EventAccumulator(str(folder)).Reload()
        tag = card_of(scalar).tag
        if tag in events.Tags()["scalars"]:
            recipe = tuple(f"{name}={value}" for name, value in given.items() if name not in (KIND, SEED))
            kind, value = given[KIND].strip("[]"), events.Scalars(tag)[-1].value
            runs.append(JudgedRun(recipe, kind, value, digest_in(folder)))
    return runs


def kinds_judged_differently(runs: Sequence[JudgedRun]) -> list[str]:
    """Kinds whose runs were not all validated on the same."""
    digests = defaultdict(set)
    for run in runs:
        digests[run.kind].add(run.judged_on)
    return [kind for kind, found in digests.items() if len(found) > 1]


def table(runs: Sequence[JudgedRun]) -> list[list[str]]:
    """A head and a row for each recipe; what all recipes share is not told."""
    kinds = list(dict.fromkeys(run.kind for run in runs))
    values: dict[tuple[str, ...], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for run in runs:
        values[run.recipe][run.kind].append(run.value)
    shared = set.intersection(*(set(recipe) for recipe in values)) if len(values) > 1 else set()
    rows = [["recipe", *kinds, "mean"]]
    for recipe, of_kind in values.items():
        name = " ".join(part for part in recipe if part not in shared) or "as configured"
        whole = all(kind in of_kind for kind in kinds)
        mean = np.mean([np.mean(of_kind[kind]) for kind in kinds]) if whole else np.nan
        rows.append([name, *(_cell(of_kind.get(kind, [])) for kind in kinds), f"{mean:.3f}" if whole else ""])
    return rows


def _cell(values: Iterable[float]) -> str:
    values = list(values)
    if not values:
        return ""
    return f"{np.mean(values):.3f}" + (f" ± {np.std(values, ddof=1):.3f}" if len(values) > 1 else "")


if __name__ == "__main__":
    judged = read_runs(Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "val/succinctness_auc")
    if not judged:
        sys.exit(f"error: no run in {sys.argv[1]} has ended: give the folder of a sweep, outputs/sweep/...")
    if differ := kinds_judged_differently(judged):
        sys.exit(f"error: runs of {'; '.join(differ)} were not validated on the same: compare {FILE} in their folders")
    head, *body = table(judged)
    print(tabulate(body, head, tablefmt="pipe", disable_numparse=True))
