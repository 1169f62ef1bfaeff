import runpy
from pathlib import Path

import pytest
from torch.utils.tensorboard import SummaryWriter

from sips_lit.callbacks.cards import card_of

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "recipes.py"))
read_runs, table = SCRIPT["read_runs"], SCRIPT["table"]


def ended(sweep: Path, number: int, overrides: list[str], values: list[float]) -> None:
    """A run of a sweep as sips-train leaves it: ``values`` are those of its validations."""
    folder = sweep / str(number)
    (folder / ".hydra").mkdir(parents=True)
    (folder / ".hydra" / "overrides.yaml").write_text("".join(f"- {o!r}\n" for o in overrides))
    with SummaryWriter(folder) as writer:
        for step, value in enumerate(values):
            writer.add_scalar(card_of("val/succinctness_auc").tag, value, step)


def test_a_row_for_each_recipe_and_a_column_for_each_kind(tmp_path):
    fixed = "experiment=recipe_search"
    drives, desk = "held_out=[drives,snow]", "held_out=[desk]"
    runs = [
        ([fixed, drives, "seed=0", "module.ranking=0"], [0.1, 0.5]),
        ([fixed, drives, "seed=1", "module.ranking=0"], [0.7]),
        ([fixed, desk, "seed=0", "module.ranking=0"], [0.8]),
        ([fixed, drives, "seed=0", "module.ranking=30"], [0.9]),
        ([fixed, desk, "seed=0", "module.ranking=30"], []),  # has not ended
    ]
    for number, (overrides, values) in enumerate(
        runs, start=8
    ):  # folders 8 to 12: their order is not that of their names
        ended(tmp_path, number, overrides, values)
    assert table(read_runs(tmp_path, "val/succinctness_auc")) == [
        ["recipe", "drives,snow", "desk", "mean"],
        ["module.ranking=0", "0.600 ± 0.141", "0.800", "0.700"],
        ["module.ranking=30", "0.900", "", ""],
    ]


def test_a_single_recipe(tmp_path):
    ended(tmp_path, 0, ["held_out=[desk]"], [0.5])
    assert table(read_runs(tmp_path, "val/succinctness_auc"))[1:] == [["as configured", "0.500", "0.500"]]
    assert read_runs(tmp_path, "val/ece") == []


def test_runs_of_a_kind_that_were_judged_on_other_pairs(tmp_path, monkeypatch):
    for number, (kind, pairs) in enumerate([("desk", "a"), ("desk", "a"), ("drives", "b"), ("drives", "c")]):
        ended(tmp_path, number, [f"held_out=[{kind}]", f"seed={number}"], [0.5])
        (tmp_path / str(number) / "validation.yaml").write_text(f"pairs: [{pairs}]\n")
    monkeypatch.setattr("sys.argv", ["recipes.py", str(tmp_path)])
    with pytest.raises(SystemExit, match=r"runs of drives were not validated on the same: compare validation\.yaml"):
        runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "recipes.py"), run_name="__main__")


def test_without_a_run_that_ended(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["recipes.py", str(tmp_path)])
    with pytest.raises(SystemExit, match=r"no run in .* has ended"):
        runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "recipes.py"), run_name="__main__")
