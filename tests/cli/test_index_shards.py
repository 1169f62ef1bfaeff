"""sips-index over many videos: in shares, restarted, with failures, by the launchers of Hydra."""

import csv
from pathlib import Path

import cv2
import pytest
from omegaconf import OmegaConf
from textured_scenes import flight

from sips_lit.cli.index import recordings
from sips_lit.pairs.index_run import COLUMNS

SHARDS = "shard=1/2,2/2"


@pytest.fixture
def videos(tmp_path: Path) -> Path:
    """Four videos of 4 to 7 frames, and one that is none."""
    folder = tmp_path / "videos"
    (folder / "b").mkdir(parents=True)
    for count, name in enumerate(("a", "b/a", "b/c", "d"), start=4):
        writer = cv2.VideoWriter(str(folder / f"{name}.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (96, 80))
        for frame in flight(count, size=(96, 80), name=name).frames:
            writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
        writer.release()
    (folder / "b" / "b.avi").write_bytes(b"RIFF nothing")
    return folder


def summary(folders: Path) -> dict[str, dict[str, str]]:
    with (folders / "data" / "indexes" / "summary.csv").open(newline="") as file:
        reader = csv.DictReader(file)
        rows = {str(Path(row["recording"]).relative_to(folders / "videos")): row for row in reader}
        assert reader.fieldnames == COLUMNS
    return rows


def decoded(folders: Path) -> list[str]:
    return sorted(path.parent.name.split("-")[0] for path in (folders / "data" / "frames").glob("*/frames.u8"))


def given(videos: Path, *more: str) -> list[str]:
    return ["data=video", f"data.path={videos}/**/*.avi", "workers=1", *more]


def assert_all_done(folders: Path) -> None:
    rows = summary(folders)
    assert [(name, row["frames"]) for name, row in rows.items()] == [
        ("a.avi", "4"), ("b/a.avi", "5"), ("b/b.avi", "0"), ("b/c.avi", "6"), ("d.avi", "7")
    ]  # fmt: skip
    assert "b.avi is no video that can be read" in rows["b/b.avi"]["problem"]
    assert len(list((folders / "data" / "indexes").glob("*.npz"))) == 4


def test_a_machine_decodes_its_own_videos_only(command, folders, videos):
    second = command("index", *given(videos, "shard=2/3"))
    assert second.code == 0, second.err  # b/a and d
    assert second.out.startswith("about 0.0 minutes of video: 0.1 MB of frames (")
    assert set(summary(folders)) == {"b/a.avi", "d.avi"}
    assert [name[:1] for name in decoded(folders)] == ["a", "d"]
    third = command("index", *given(videos, "shard=3/3"))
    assert "1 of 1 recordings failed" in third.sentence
    assert "b.avi is no video that can be read" in third.sentence
    first = command("index", *given(videos, "shard=1/3"))
    assert first.code == 0, first.err
    assert_all_done(folders)


def test_a_failure_stops_no_other_and_is_tried_again(command, folders, videos):
    result = command("index", *given(videos))
    assert "1 of 5 recordings failed" in result.sentence
    assert f"failed: {videos}/b/b.avi: " in result.out
    assert_all_done(folders)
    times = {path: path.stat().st_mtime_ns for path in (folders / "data" / "indexes").glob("*.npz")}
    (videos / "b" / "b.avi").write_bytes((videos / "d.avi").read_bytes())
    again = command("index", *given(videos))
    assert again.code == 0, again.err
    assert summary(folders)["b/b.avi"]["frames"] == "7"
    assert (
        times.items()
        <= {path: path.stat().st_mtime_ns for path in (folders / "data" / "indexes").glob("*.npz")}.items()
    )


def test_a_list_of_videos(command, folders, videos):
    (videos / "list.txt").write_text("d.avi\nb/c.avi\n")
    result = command("index", "data=video", f"data.path={videos}/list.txt")
    assert result.code == 0, result.err
    assert set(summary(folders)) == {"b/c.avi", "d.avi"}


def test_training_finds_the_indexes(command, folders, videos, monkeypatch):
    (videos / "b" / "b.avi").unlink()
    assert command("index", *given(videos)).code == 0
    monkeypatch.setattr("sips_lit.pairs.build.measure_overlap", None)
    result = command("evaluate", "detector=fast", "checkpoint=none", "pairs=3", *given(videos))
    assert result.code == 0, result.err


@pytest.mark.parametrize("shard", ["0/4", "5/4", "x"])
def test_no_shares(command, videos, shard):
    assert f"shard is {shard}: give a part" in command("index", *given(videos, f"shard={shard}")).sentence


def test_shares_of_sequences(command, folders, tmp_path):
    for name in "abc":
        (tmp_path / "all" / name).mkdir(parents=True)
        for i, frame in enumerate(flight(3, size=(64, 48)).frames):
            cv2.imwrite(str(tmp_path / "all" / name / f"{i}.png"), frame)
    result = command("index", "data=folder", f"data.path={tmp_path}/all", "shard=2/2")
    assert result.code == 0, result.err
    assert [line.split()[1] for line in result.out.splitlines() if line.startswith("| all")] == ["all_b"]


def test_the_videos_of_a_mixture_are_decoded_in_their_turn(folders, videos):
    still = folders / "still.png"
    cv2.imwrite(str(still), flight(1, size=(200, 160)).frames[0])
    video = {"_target_": "sips_lit.frames.video.video", "path": str(videos / "*.avi"), "cache_dir": str(folders / "f")}
    flights = {
        "_target_": "sips_lit.datasets.virtual_flight.virtual_flight",
        "path": str(still),
        "flights_per_still": 2,
    }
    sources = {"a": {"sequences": video}, "none": None, "b": {"sequences": flights}}
    parts = recordings(OmegaConf.create({"_target_": "sips_lit.frames.source.mixture", "sources": sources}))
    assert [part.where for part in parts] == [
        f"{videos}/a.avi", f"{videos}/d.avi", f"{still}:still_flight0", f"{still}:still_flight1"
    ]  # fmt: skip
    assert not (folders / "f").exists()
    assert [len(sequence) for part in parts for sequence in part.open()] == [4, 7, 80, 80]


def test_many_sequences_are_a_line_of_totals(command, videos, monkeypatch):
    monkeypatch.setattr("sips_lit.cli.index.SHOWN", 3)
    result = command("index", *given(videos))
    assert "4 sequences, 22 frames (0 of them unreadable)" in result.out
    assert "| a" not in result.out


def test_one_after_the_other(command, folders, videos):
    result = command("index", "-m", *given(videos, SHARDS), f"hydra.sweep.dir={folders}/sweep")
    assert result.code == 1
    assert "Traceback" not in result.err
    assert "a job failed: 1 of 3 recordings failed" in result.err
    assert_all_done(folders)  # the second share, too


@pytest.mark.slow
def test_side_by_side(command, folders, videos, monkeypatch):
    pytest.importorskip("hydra_plugins.hydra_joblib_launcher", reason="needs the extra sweep")
    from joblib.externals.loky import get_reusable_executor

    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    options = "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", f"hydra.sweep.dir={folders}/sweep"
    try:
        result = command("index", "-m", *given(videos, SHARDS, *options))
    finally:
        get_reusable_executor().shutdown(kill_workers=True)
    assert "a job failed: 1 of 3 recordings failed" in result.err
    assert_all_done(folders)


LAUNCHERS = {
    "submitit_local": ("hydra_submitit_launcher", "cluster", ["hydra.launcher.timeout_min=5"]),
    "ray": ("hydra_ray_launcher", "ray", ["+hydra.launcher.ray.init.num_cpus=2"]),
}


@pytest.mark.slow
@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_by_launchers_of_clusters(process, folders, videos, launcher):
    plugin, extra, options = LAUNCHERS[launcher]
    pytest.importorskip(f"hydra_plugins.{plugin}", reason=f"needs the extra {extra}")
    more = f"hydra/launcher={launcher}", f"hydra.sweep.dir={folders}/sweep", *options
    child = process("index", "-m", *given(videos, SHARDS, *more))
    assert child.wait(timeout=100) == 1, child.log.read_text()
    assert "a job failed: 1 of 3 recordings failed" in child.log.read_text()
    assert_all_done(folders)


def test_slurm_composes(command, videos, folders):
    pytest.importorskip("hydra_plugins.hydra_submitit_launcher", reason="needs the extra cluster")
    options = "hydra/launcher=submitit_slurm", "hydra.launcher.partition=cpu", "hydra.launcher.timeout_min=600"
    shown = command("index", "--cfg", "hydra", *given(videos, *options))
    assert shown.code == 0, shown.err
    assert "SlurmLauncher" in shown.out
    assert "partition: cpu" in shown.out
