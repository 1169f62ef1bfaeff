import csv

import numpy as np
import pytest
from textured_scenes import flight
from tiny_network import tiny_detector

from sips_lit.inference.match import match
from sips_lit.inference.match_stream import NamedPair
from sips_lit.inference.match_writers import MatchFormat, open_match_writer

FRAMES = flight(2, size=(128, 96)).frames
K = np.array([[120.0, 0, 64], [0, 120, 48], [0, 0, 1]])


@pytest.mark.parametrize("camera", [None, K])
@pytest.mark.parametrize(
    ("kind", "said"), [("npz", "2 npz files"), ("csv", "pairs.csv (2 rows)"), ("picture", "2 pictures")]
)
def test_every_format_of_any_model(tmp_path, kind: MatchFormat, said, camera):
    some, none = (match(*FRAMES, n=n, detector=tiny_detector(), camera=camera) for n in (40, 2))
    assert some.homography is not None or some.T_1_0 is not None
    assert none.homography is None
    assert none.T_1_0 is None
    writer = open_match_writer(kind, tmp_path / "out")
    for name, pair in (("first", some), ("second", none)):
        writer.write(NamedPair(name, pair))
    writer.close()
    writer.close()
    assert said in writer.written
    if kind == "csv":
        with (tmp_path / "out" / "pairs.csv").open(newline="") as file:
            head, full, empty = csv.reader(file)
        assert len(head) == len(full) == len(empty) == 6 + (9 if camera is None else 12)
        assert all(full[6:])
        assert not any(empty[6:])
    else:
        suffix = {"npz": "npz", "picture": "png"}[kind]
        assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [f"first.{suffix}", f"second.{suffix}"]
