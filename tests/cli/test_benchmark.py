import csv
import json

import cv2
import pytest
from textured_scenes import texture

from sips_lit.cli import evaluation


@pytest.fixture
def benchmark(command, frames, folders):
    """``benchmark("detectors=[sift]")`` runs on a tiny sequence."""

    def run(*arguments: str, folder: str = "run"):
        data = "data=folder", f"data.path={frames}", f"hydra.run.dir={folders}/{folder}"
        small = (
            "pairs=3",
            "n_max=40",
            "ks=[5]",
            "n=20",
            "calibration=[20]",
            "iterations=50",
            "pictures=false",
        )
        return command("benchmark", *data, *small, *arguments)

    return run


def needed(folder) -> dict[str, list[str]]:
    """n_k of every detector of the set of ``plane``."""
    found = {}
    for path in (folder / "folder_plane").glob("*_pairs.csv"):
        with path.open() as handle:
            found[path.name] = [row["nmin"] for row in csv.DictReader(handle)]
    return found


@pytest.mark.draws
def test_many_detectors(benchmark, folders, checkpoint):
    result = benchmark(
        "detectors=[sips,sift,superpoint,random]", f"checkpoint={checkpoint}", "pictures=true", "video_frames=2"
    )
    assert result.code == 0, result.err
    for name in ("SIPs + RootSIFT", "\nSIFT ", "SIFT + RootSIFT", "random + RootSIFT"):
        assert name in result.out
    assert "skipped superpoint: " in result.out
    line = "k = 10, at most 40 points, 3 pairs (kind=random, overlap=0.5, seed=0), exact search, inliers=klt"
    assert line in " ".join(result.out.split())
    run = folders / "run"
    assert (run / "report.html").stat().st_size
    assert (run / "folder_plane" / "pairs.csv").read_text().startswith("sequence,index0,index1,overlap,pixels\n")
    assert set(needed(run)) == {
        f"{key}_pairs.csv" for key in ("sips_rootsift", "sift", "sift_rootsift", "random_rootsift")
    }
    assert "superpoint" in (run / "results.json").read_text()
    json.loads((run / "results.json").read_text())
    assert str(run / "report.html") in result.out.split("wrote:\n")[1]
    assert list((run / "pictures" / "folder_plane").glob("sips_rootsift_*.png"))
    assert cv2.VideoCapture(str(run / "folder_plane" / "sips_rootsift_scores.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == 2


def test_the_same_again_from_kept_features_and_listed_pairs(benchmark, folders):
    assert benchmark("detectors=[sift]", folder="one").code == 0
    kept = sorted((folders / "data" / "features").rglob("*.npz"))
    stamps = [path.stat().st_mtime_ns for path in kept]
    again = benchmark("detectors=[sift]", f"pairs_file={folders}/one/folder_plane/pairs.csv", "seed=5", folder="two")
    assert again.code == 0, again.err
    assert "pairs_file=pairs.csv" in again.out
    assert needed(folders / "one") == needed(folders / "two")
    assert kept
    assert stamps == [path.stat().st_mtime_ns for path in kept]


def test_several_pair_sets(command, folders, frames, tmp_path):
    (tmp_path / "stills").mkdir()
    cv2.imwrite(str(tmp_path / "stills" / "a.png"), texture(200, 240))
    flight = (
        "{title: Flight, kind: first_to_others, data: {_target_: sips_lit.datasets.virtual_flight.virtual_flight,"
        f" path: {tmp_path}/stills, size: [128, 96], length: 4, flights_per_still: 1}},"
        " inliers: {_target_: sips_lit.inliers.homography.HomographyInliers}}"
    )
    film = f"{{pairs: 2, n_max: 30, k: 6, ks: [4], data: {{_target_: sips_lit.frames.folder.folder, path: {frames}}}}}"
    result = command(
        "benchmark",
        "detectors=[shi_tomasi]",
        f"+pair_sets.flight={flight}",
        f"+pair_sets.film={film}",
        "n_max=40",
        "k=5",
        "ks=[]",
        "n=20",
        "pictures=false",
        f"hydra.run.dir={folders}/run",
    )
    assert result.code == 0, result.err
    assert "\nFlight\n" in result.out
    assert "\nfilm\n" in result.out
    assert "k = 5, at most 40 points, 3 pairs (kind=first_to_others), exact search, inliers=homography" in result.out
    assert (
        "k = 6, at most 30 points, 2 pairs (kind=random, overlap=0.5, seed=0), exact search, inliers=klt" in result.out
    )
    assert len((folders / "run" / "flight" / "pairs.csv").read_text().splitlines()) == 4


def test_an_interrupted_benchmark_leaves_the_pair_sets_that_it_has_measured(benchmark, command, folders, monkeypatch):
    measure = evaluation.evaluate_pair_set

    def interrupted(methods, pairs, *more):
        if pairs.key == "second":
            raise KeyboardInterrupt
        return measure(methods, pairs, *more)

    monkeypatch.setattr(evaluation, "evaluate_pair_set", interrupted)
    result = benchmark("detectors=[sift,orb]", "+pair_sets.first={}", "+pair_sets.second={k: 4}")
    assert (result.code, result.err) == (130, "interrupted\n")
    redrawn = command("report", f"{folders}/run/results.json", f"output={folders}/again")
    assert redrawn.code == 0, redrawn.err
    assert "SIFT + RootSIFT" in redrawn.out
    assert "k = 4" not in redrawn.out
    assert (folders / "again" / "report.html").is_file()


def test_refusals_in_one_sentence(benchmark, tmp_path):
    assert "there is no detector siftt: choose from" in benchmark("detectors=[siftt]").sentence
    assert "kind is all" in benchmark("detectors=[sift]", "kind=all").sentence
    assert "k is 50 and n_max is 40" in benchmark("detectors=[sift]", "k=50").sentence
    (tmp_path / "pairs").write_text("plane 0 99\n")
    assert "names frame 99, which plane lacks" in benchmark("detectors=[sift]", f"pairs_file={tmp_path}/pairs").sentence
    sentence = benchmark("detectors=[sift]", "+pair_sets.a={nonsense: 1}").sentence
    assert "pair_sets.a sets nonsense, which no pair set has" in sentence
    assert "has no pose" in benchmark("detectors=[sift]", "inliers=pose_depth").sentence
    assert "no depth maps" in benchmark("detectors=[sift]", "inliers=stereo_p3p").sentence


def test_nothing_could_be_measured(benchmark):
    result = benchmark("detectors=[superpoint]")
    assert "skipped superpoint" in result.out
    assert "no method could be measured: " in result.sentence


@pytest.mark.slow
@pytest.mark.shared_data
def test_the_reference_pair_sets(command, shared_data, folders):
    """Real data: corners beat points at random on every set."""
    small = "pairs=3", "ks=[10]", "iterations=300", "repeats=2", "pictures=false"
    sets = "experiment=benchmark_reference", f"root={shared_data}", "detectors=[shi_tomasi,random]"
    result = command("benchmark", *sets, *small, f"hydra.run.dir={folders}/run")
    assert result.code == 0, result.err
    with (folders / "run" / "summary.csv").open() as handle:
        auc = {(row["pair_set"], row["detector"]): float(row["auc"]) for row in csv.DictReader(handle)}
    for key in ("kitti_easy", "kitti_p3p", "desk", "desk_wide", "v_churchill", "scenes"):
        assert auc[key, "shi_tomasi_rootsift"] > 0.6
        assert auc[key, "random_rootsift"] < 0.2
