import pytest
from omegaconf import OmegaConf

from sips_lit.cli.data_names import name_of_data
from sips_lit.frames.source import Source


class Sequence:
    def __init__(self, name):
        self.name = name


def named(target, *names, source="data"):
    return name_of_data(
        OmegaConf.create({"_target_": target}), [Source([Sequence(name) for name in names], name=source)]
    )


@pytest.mark.parametrize(
    ("target", "names", "key", "title"),
    [
        ("sips_lit.datasets.kitti.kitti", ["01"], "kitti_01", "KITTI odometry: 01"),
        ("sips_lit.datasets.kitti.kitti", ["kitti_01"], "kitti_01", "KITTI odometry: kitti_01"),
        ("sips_lit.datasets.kitti.kitti", ["00", "01"], "kitti", "KITTI odometry: 00, 01"),
        ("sips_lit.datasets.kitti.kitti", list("abcd"), "kitti", "KITTI odometry: 4 sequences"),
        ("sips_lit.frames.video.video", ["my walk"], "video_my_walk", "video: my walk"),
        ("sips_lit.frames.folder.folder", ["x" * 90], "folder_" + "x" * 53, "folder of images: " + "x" * 90),
        ("sips_lit.datasets.demo.demo_video", ["city"], "demo_video_city", "demo_video: city"),  # has no SPEC
    ],
)
def test_a_data_set_is_called_by_its_title_and_its_sequences(target, names, key, title):
    assert named(target, *names) == (key, title)


def test_a_mixture_is_called_by_its_sources():
    node = OmegaConf.create({"_target_": "sips_lit.frames.source.mixture"})
    sources = [Source([Sequence("a")], name=name) for name in ("city", "flights")]
    assert name_of_data(node, sources) == ("city_flights", "city, flights")
    assert name_of_data(node, sources[:1]) == ("city", "city")
    many = [Source([Sequence("a")], name=f"s{index}") for index in range(5)]
    assert name_of_data(node, many) == ("mixture", "5 sources")
