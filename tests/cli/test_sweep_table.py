import shlex
from pathlib import Path

import pytest
import yaml
from cli_runs import TINY

from sips_lit.cli.sweep_table import read_jobs, report


def write_job(folder: Path, overrides: list[str], result: dict | None) -> None:
    (folder / ".hydra").mkdir(parents=True)
    (folder / ".hydra" / "overrides.yaml").write_text(yaml.safe_dump(overrides))
    if result is not None:
        (folder / ".hydra" / "result.yaml").write_text(yaml.safe_dump(result))


def test_a_row_for_each_job_and_the_command_line_of_the_best(tmp_path):
    path = "data.path='my film.mp4'"
    results = [{"score": 0.5}, {"problem": "no frames " * 20}, {"score": 0.75}, None, {}]
    for number, result in enumerate(results):
        write_job(tmp_path / str(number), [path, f"seed={number}", "ckpt_path=last"], result)
    text = report("train", read_jobs(tmp_path))
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
    assert [row[0] for row in rows[2:]] == [f"seed={number}" for number in range(5)]
    assert [row[1][:17] for row in rows[2:]] == [
        "0.500",
        "failed: no frames",
        "0.750",
        "failed: did not e",
        "failed: none",
    ]
    assert [row[2] for row in rows[2:]] == [str(tmp_path / str(number)) for number in range(5)]
    assert f"best: AUC 0.750 in {tmp_path / '2'}" in text
    assert shlex.split(text.splitlines()[-1]) == ["sips-train", "data.path=my film.mp4", "seed=2"]


def test_jobs_that_were_validated_on_other_pairs_do_not_compete(tmp_path):
    for number, (score, pairs) in enumerate([(0.5, "a"), (0.9, "b"), (0.6, "a"), (0.8, "b")]):
        write_job(tmp_path / str(number), [f"seed={number}"], {"score": score})
        (tmp_path / str(number) / "validation.yaml").write_text(f"pairs: [{pairs}]\n")
    write_job(tmp_path / "4", ["seed=4"], {"problem": "it failed"})
    text = report("train", read_jobs(tmp_path))
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
    assert rows[0] == ["overrides", "best AUC", "validated on", "folder"]
    on = [row[2] for row in rows[2:]]
    assert on[0] == on[2] != on[1] == on[3]
    assert on[4] == ""
    assert "only AUCs of the same compare" in text
    best = [line for line in text.splitlines() if line.startswith("best")]
    assert best == [
        f"best on {on[0]}: AUC 0.600 in {tmp_path / '2'}",
        f"best on {on[1]}: AUC 0.900 in {tmp_path / '1'}",
    ]


def test_jobs_are_in_the_order_of_their_numbers(tmp_path):
    for number in (10, 2, 0):
        write_job(tmp_path / str(number), [f"seed={number}"], {"score": 0.0})
    assert [job.folder.name for job in read_jobs(tmp_path)] == ["0", "2", "10"]


def test_without_a_score_there_is_no_best(tmp_path):
    write_job(tmp_path / "0", ["seed=0"], {"problem": "it failed"})
    text = report("train", read_jobs(tmp_path))
    assert "seed=0" in text
    assert "best:" not in text


@pytest.mark.parametrize("launcher", [[], ["hydra/launcher=joblib", "hydra.launcher.n_jobs=1"]], ids=["here", "joblib"])
def test_a_sweep_ends_with_its_table(command, frames, folders, launcher):
    if launcher:
        pytest.importorskip("hydra_plugins.hydra_joblib_launcher")
    arguments = *TINY, "data=folder", f"data.path={frames}", f"hydra.sweep.dir={folders}/sweep", "seed=1", "k=10,70"
    result = command("train", "-m", *launcher, *arguments)
    assert result.code == 1, "a job failed"
    table = result.out[result.out.rindex("| overrides") :]
    good, bad, _, best, line = table.splitlines()[2:]
    assert good.startswith("| k=10")
    assert "failed: callbacks.succinctness" in bad
    assert best.endswith(f"in {folders}/sweep/0")
    assert shlex.split(line)[-1] == "k=10"
    assert "best validation AUC" in (folders / "sweep" / "0" / "sips-train.log").read_text()
    assert "next:" not in result.out


def test_a_single_run_has_no_table(command, frames, folders):
    result = command("evaluate", "data=folder", f"data.path={frames}", f"hydra.run.dir={folders}/e", "pairs=none")
    assert result.code == 1
    assert "overrides" not in result.out
    assert not list(folders.rglob("result.yaml"))
