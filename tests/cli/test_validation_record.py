from pathlib import Path

import pytest
import yaml
from tiny_runs import config_of

from sips_lit.cli.validation_record import digest_in, write_record

PAIRS = ["a_10to14:0-1 96x80", "a_10to14:3-1 96x80"]


def digest(tmp_path, *overrides, pairs=PAIRS) -> str:
    config = config_of(tmp_path / "run", tmp_path, *overrides)
    return write_record(config, pairs)


def test_it_tells_what_the_score_is_of(tmp_path):
    told = digest(tmp_path, "k=7", "inliers=homography")
    assert told == digest_in(tmp_path / "run")
    record = yaml.safe_load((tmp_path / "run" / "validation.yaml").read_text())
    assert (record["k"], record["n_max"], record["pairs"]) == (7, 60, PAIRS)
    assert record["inliers"]["_target_"].endswith("HomographyInliers")


@pytest.mark.parametrize(
    ("override", "same"),
    [
        ("k=7", False),
        ("n_max=50", False),
        ("inliers=homography", False),
        ("datamodule.overlap=0.3", True),
        ("module.ranking=0", True),
        ("descriptor.size=6", True),
        ("seed=3", True),
    ],
)
def test_what_is_trained_does_not_change_what_it_is_judged_by(tmp_path, override, same):
    assert (digest(tmp_path) == digest(tmp_path, override)) is same


def test_other_pairs_and_sizes_are_told(tmp_path):
    assert len({digest(tmp_path, pairs=pairs) for pairs in (PAIRS, PAIRS[:1], ["a_10to14:0-1 48x40", PAIRS[1]])}) == 3


def test_a_folder_without_one(tmp_path: Path):
    assert digest_in(tmp_path) is None
