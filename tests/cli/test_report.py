import json

import pytest
from benchmark_examples import NAMES, pair_set

from sips_lit.report.stored import store_results


@pytest.fixture
def runs(tmp_path):
    """Folders of two runs: one of all methods, one of a single one."""
    whole = pair_set(NAMES[:2], 8, repeats=1)
    single = whole.__class__(whole.key, whole.title, whole.protocol, whole.detectors[:1], {})
    folders = tmp_path / "a run" / "x=1", tmp_path / "second"
    for folder, result, date in zip(folders, (whole, single), ("2026-01-02", "2026-01-03"), strict=True):
        folder.mkdir(parents=True)
        store_results(folder / "results.json", [result], date, {"cores": "2"})
    return folders


@pytest.mark.draws
def test_several_results_in_one_report(command, runs, tmp_path):
    first, second = runs
    output = tmp_path / "drawn"
    result = command(
        "report",
        f"{first}/results.json",
        str(second),
        f"output={output}",
        'labels={sips: ours, 2/sips: "ours, longer"}',
    )
    assert result.code == 0, result.err
    assert "\nours, longer + RootSIFT " in result.out
    assert "95 % intervals, from 1000 draws of the pairs" in result.out
    assert f"  {output}/report.html" in result.out
    (pair_set,) = json.loads((output / "results.json").read_text())["pair_sets"]
    names = [method["name"] for method in pair_set["detectors"]]
    assert names[0] == "ours + RootSIFT"
    assert names[-1] == "ours, longer + RootSIFT"
    page = (output / "report.html").read_text()
    assert "ours, longer + RootSIFT" in page
    assert "2026-01-02, 2026-01-03" in page


def test_results_as_a_key_without_intervals(command, runs, tmp_path):
    result = command("report", f"results={runs[1]}", f"output={tmp_path}/drawn", "resamples=0")
    assert result.code == 0, result.err
    assert "95 %" not in result.out


def test_the_same_method_twice(command, runs, tmp_path):
    result = command("report", *map(str, runs), f"output={tmp_path}/drawn")
    assert result.sentence.startswith(
        "SIPs + RootSIFT on KITTI odometry 00 is in two of the files: call one by another name"
    )


def test_no_results(command, tmp_path):
    assert (
        command("report", f"output={tmp_path}/drawn").sentence == "results is not set: add results=... to the command"
    )
    sentence = command("report", "gone.json", f"output={tmp_path}/drawn").sentence
    assert sentence == "the results gone.json can't be read: No such file or directory"


@pytest.mark.parametrize("labels", ["labels=x", "labels={sips: [1]}"])
def test_labels_that_are_none(command, runs, tmp_path, labels):
    result = command("report", str(runs[0]), f"output={tmp_path}/drawn", labels)
    assert "give names of methods with their labels" in result.sentence
