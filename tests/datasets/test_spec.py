import pytest

from sips_lit.datasets.spec import DatasetSpec, any_of, at_least


@pytest.fixture
def place(tmp_path):
    for name in ("b/2.png", "b/1.png", "poses.txt", ".hidden/cam.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def test_any_of_tells_the_first_pattern_that_matches(place):
    assert any_of("a", "b/*.png", "poses.txt")(place) == "b/1.png"
    assert any_of("a", "c/*.png")(place) is None
    assert any_of("a")(place / "poses.txt") is None  # a file


@pytest.mark.parametrize(("count", "found"), [(1, "b, poses.txt"), (2, "b, poses.txt"), (3, None)])
def test_at_least_tells_all_that_match(place, count, found):
    assert at_least(count, "b", "cam.txt", "poses.txt")(place) == found


def test_any_of_the_signs_will_do(place):
    def spec(*signs):
        return DatasetSpec(kind="made", title="Made", loader=lambda path: [], signs=signs)

    assert spec(any_of("gone"), any_of("poses.txt"), any_of("b")).sign(place) == "poses.txt"
    assert spec(any_of("gone")).sign(place) is None
    assert (spec().options(place), spec().parts(place)) == ({}, ())
