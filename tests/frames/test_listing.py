import random
from pathlib import Path

import pytest

from sips_lit.errors import InputWarning
from sips_lit.frames.listing import images_below, in_order, list_images


def test_images_are_listed_in_natural_order(tmp_path: Path):
    names = ["2.png", "10.jpg", "a9b2.PNG", "a9b10.png", "a10b1.tif", "²3.bmp"]
    for name in [*names, "1.txt", ".3.png", "4", "5.png.part", "._2.png"]:
        (tmp_path / name).touch()
    (tmp_path / "6.png").mkdir()
    listed = [path.name for path in list_images(tmp_path)]
    assert sorted(listed) == sorted(names)
    assert [name for name in listed if name[0] == "a"] == ["a9b2.PNG", "a9b10.png", "a10b1.tif"]
    assert listed.index("2.png") < listed.index("10.jpg")


def test_order_does_not_depend_on_the_file_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    for name in ["1.png", "01.png", "001.png"]:  # equal as numbers
        (tmp_path / name).touch()
    orders = []
    files = sorted(tmp_path.iterdir())
    for files_found in (files, files[::-1]):
        monkeypatch.setattr(Path, "iterdir", lambda _, found=files_found: iter(found))
        orders.append(list_images(tmp_path))
    assert orders[0] == orders[1]


def ordered(names: list[str]) -> list[str]:
    """The names as `in_order` puts them, whatever order they come in."""
    shuffled = random.Random(0).sample(names, len(names))
    return [path.name for path in in_order(map(Path, shuffled))]


@pytest.mark.parametrize("start", [0.0, 7.0, 1548266469.0])
@pytest.mark.parametrize(
    "pattern", ["{}.png", "left_{}.png", "{}_rgb.jpg", "cam0_{}.png", "{}_2.png", "2024-01-02 {}.png"]
)
def test_decimal_times_without_trailing_zeros(pattern: str, start: float, recwarn: pytest.WarningsRecorder):
    names = [pattern.format(str(round(start + i * 0.03, 5))) for i in range(120)]  # 0.9, 0.93, ..., 1.02, 1.05
    assert ordered(names) == names
    assert not recwarn.list


def test_a_few_times_since_1970(recwarn: pytest.WarningsRecorder):
    names = ["1548266470.09.png", "1548266470.1.png", "1548266470.11.png", "1548266471.png", "1548266471.5.png"]
    assert ordered(names) == names
    assert ordered(names[1:]) == names[1:]
    assert ordered([*names, "preview.png"]) == [*names, "preview.png"]
    assert ordered([name.replace(".", ",", 1) for name in names[:3]]) == [
        name.replace(".", ",", 1) for name in names[:3]
    ]
    assert not recwarn.list


@pytest.mark.parametrize(
    "names",
    [
        [f"{9_999_999_990 + 7 * i}.png" for i in range(20)],  # unpadded nanoseconds
        [f"{i}.png" for i in range(120)],
        [f"frame{i:06d}.png" for i in range(5)],
        [f"{12 + i // 10}.{i % 10}00000.png" for i in range(40)],  # padded times
        [f"seq{a}_img{b}.png" for a in range(3) for b in range(12)],
        [f"{round(33.3333 * i, 4)}.png" for i in range(40)],  # milliseconds: either way of reading gives this order
        [f"v1.{a}.{b}.png" for a in range(3) for b in range(12)],
        ["img.png", *(f"img ({i}).png" for i in range(1, 12))],
    ],
)
def test_numbers(names: list[str], recwarn: pytest.WarningsRecorder):
    assert ordered(names) == names
    assert not recwarn.list


def test_two_readings():
    """Of 1.8, 1.9, 1.11, 1.12 both are possible; a counter would have 1.10, but not all files need be there."""
    names = ["1.8.png", "1.9.png", "1.11.png", "1.12.png"]
    with pytest.warns(InputWarning, match=r"like 1\.1[12]\.png .* numbers behind a point \(1\.9 before 1\.10\)"):
        assert ordered(names) == names
    names = ["1548266470.1.png", "1548266470.25.png", "1548266470.3.png"]
    with pytest.warns(InputWarning, match=r"like 1548266470\.25\.png .* taken as decimal times"):
        assert ordered(names) == names


def test_a_counter_behind_a_point():
    names = [f"scene1.{i}.png" for i in range(1, 25)]
    assert ordered(names) == names


def test_images_below_a_folder(tmp_path: Path):
    for name in (
        "2.png",
        "10.png",
        "a/1.jpg",
        "a/b/c.png",
        ".x/1.png",
        "__MACOSX/1.png",
        "a/@eaDir/1.jpg",
        "a/.1.png",
        "n.txt",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = [str(file.relative_to(tmp_path)) for file in images_below(tmp_path)]
    assert found == ["2.png", "10.png", "a/1.jpg", "a/b/c.png"]
