import csv
import os
import threading
from pathlib import Path

import pytest

from sips_lit.errors import BadInputError
from sips_lit.pairs.index_run import IndexedSequence, ShareSummary, write_table


def row(recording: str, sequence: str = "s", **values) -> IndexedSequence:
    return IndexedSequence(recording, sequence, **values)


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "summary.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def written(folder: Path, shard: str, *rows: IndexedSequence, data: str = "data") -> ShareSummary:
    summary = ShareSummary(folder, data, shard, [r.recording for r in rows])
    for r in rows:
        summary.add([r])
    summary.write()
    return summary


def test_all_shares_in_one_table(tmp_path):
    written(tmp_path / "new", "2/2", row("b.mp4", "", problem='no frames, says "OpenCV"'), row("ö.mp4", frames=7))
    written(tmp_path / "new", "1/2", row("a.mp4", "a", frames=3, points=4, reach=5, pairs=6, unreadable=1, problem="x"))
    rows = table(tmp_path / "new")
    assert [r["recording"] for r in rows] == ["a.mp4", "b.mp4", "ö.mp4"]
    assert list(rows[0].values()) == ["a.mp4", "a", "3", "4", "5", "6", "1", "x"]
    assert rows[1]["problem"] == 'no frames, says "OpenCV"'


def test_another_run_of_a_share_replaces_what_it_did(tmp_path):
    written(tmp_path, "1/1", row("a", frames=1), row("b", "", problem="damaged"), row("gone", frames=3))
    again = ShareSummary(tmp_path, "data", "1/1", ["a", "b"])
    assert [r.recording for r in again.rows] == ["a", "b"]  # known from before
    again.add([row("b", "b_shot0", frames=4), row("b", "b_shot1", frames=5)])
    again.write()
    assert [(r["recording"], r["sequence"], r["frames"]) for r in table(tmp_path)] == [
        ("a", "s", "1"),
        ("b", "b_shot0", "4"),
        ("b", "b_shot1", "5"),
    ]


def test_of_a_recording_in_several_shares_the_newest_counts(tmp_path):
    old = written(tmp_path, "1/1", row("a", frames=1), row("b", frames=1))
    new = written(tmp_path, "1/2", row("a", frames=2))
    for summary, time in ((old, 1000), (new, 2000)):
        os.utime(summary.path, (time, time))
    write_table(tmp_path)
    assert [r["frames"] for r in table(tmp_path)] == ["2", "1"]
    os.utime(old.path, (3000, 3000))
    write_table(tmp_path)
    assert [r["frames"] for r in table(tmp_path)] == ["1", "1"]


def test_data_sets_do_not_replace_each_other(tmp_path):
    written(tmp_path, "1/1", row("a"), data="one")
    written(tmp_path, "1/1", row("b"), data="two")
    assert [r["recording"] for r in table(tmp_path)] == ["a", "b"]


def test_many_machines_at_once(tmp_path):
    def work(number: int) -> None:
        for count in range(1, 6):
            rows = [row(f"{number}-{i}", frames=count) for i in range(count)]
            written(tmp_path, f"{number}/6", *rows)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(1, 7)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [(r["recording"], r["frames"]) for r in table(tmp_path)] == [
        (f"{number}-{i}", "5") for number in range(1, 7) for i in range(5)
    ]


@pytest.mark.parametrize("content", ["", "[{", '{"a": 1}', '[{"other": 1}]', "[3]"])
def test_damaged_summaries_are_named(tmp_path, content):
    summary = written(tmp_path, "1/1", row("a"))
    summary.path.write_text(content)
    with pytest.raises(BadInputError, match=rf"cannot read the summary .*{summary.path.name} \(.*\): remove it"):
        ShareSummary(tmp_path, "data", "1/1", ["a"])


def test_no_recordings(tmp_path):
    written(tmp_path, "4/4")
    assert table(tmp_path) == []
