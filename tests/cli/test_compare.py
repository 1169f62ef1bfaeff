import json

from omegaconf import OmegaConf

from sips_lit.cli.compare import compare


def test_a_comparison_prints_and_writes_a_table_a_pair_set(frames, checkpoint, tmp_path, capsys):
    descriptor = {"_target_": "sips_lit.describe.sift.RootSift"}
    pairs = {
        "_target_": "sips_lit.evaluate.pairs.draw_pairs",
        "data": {"_target_": "sips_lit.frames.folder.folder", "path": str(frames)},
        "inliers": {"_target_": "sips_lit.inliers.klt.KltInliers"},
        "index_folder": str(tmp_path / "indexes"),
        "pairs": 3,
    }
    sift = {"_target_": "sips_lit.baselines.sift.SiftDetector"}
    config = {
        "n": 20,
        "descriptor": descriptor,
        "detectors": {
            "sift": {"detector": sift, "descriptor": None},
            "corners": {
                "detector": {"_target_": "sips_lit.baselines.shi_tomasi.ShiTomasi"},
                "descriptor": descriptor,
            },
        },
        "pair_sets": {
            "easy": {"title": "A plane, k = 5", "k": 5, "n_max": 60, "pairs": pairs},
            "hard": {"title": "A plane, k = 20", "k": 20, "n_max": 60, "pairs": pairs},
        },
    }
    compare(OmegaConf.create(config), checkpoint, tmp_path / "compare")
    printed = capsys.readouterr().out
    assert printed.count("| detector") == 2
    assert "A plane, k = 20" in printed
    for name, k in (("easy", 5), ("hard", 20)):
        folder = tmp_path / "compare" / name
        results = json.loads((folder / "results.json").read_text())
        assert set(results) == {"sips", "sift", "corners"}
        assert {result["protocol"]["k"] for result in results.values()} == {k}
        assert results["sift"]["protocol"]["descriptor"] == "own"
        assert sorted(p.name for p in folder.glob("sips_*.png")) == [
            "sips_best.png",
            "sips_median.png",
            "sips_reliability.png",
            "sips_worst.png",
        ]
