import inspect
import re
from pathlib import Path

import pytest
from hydra.utils import get_object
from omegaconf import OmegaConf

from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.datasets import kitti
from sips_lit.datasets.registry import IMAGES, VIDEOS, find_specs
from sips_lit.errors import BadInputError

ROOT = Path(__file__).parents[2]
SPECS = {spec.kind: spec for spec in find_specs() if spec.loader.__module__.startswith("sips_lit.")}
NO_LAYOUT = {"virtual_flight", "stills", "robotics", "mixed"}  # rows of the table that no folder can be recognised as


def test_every_published_data_set_has_a_spec():
    loaders = {path.stem for path in (ROOT / "sips_lit" / "datasets").glob("*.py")} & {
        path.stem for path in (CONF_DIR / "data").glob("*.yaml")
    }
    assert loaders - {"virtual_flight", "stills", "demo"} | {"video", "folder"} == set(SPECS)


def test_images_and_videos_come_after_all_layouts():
    assert find_specs()[-2:] == [VIDEOS, IMAGES]
    assert kitti.SPEC in find_specs()[:-2]


@pytest.mark.parametrize("kind", SPECS)
def test_the_yaml_is_of_the_loader_and_its_switches(kind):
    config = OmegaConf.load(CONF_DIR / "data" / f"{kind}.yaml")
    assert get_object(config._target_) is SPECS[kind].loader
    assert all(config[switch] is False for switch in SPECS[kind].switches)
    arguments = {key: value for key, value in OmegaConf.to_container(config).items() if key != "_target_"}
    assert set(inspect.signature(SPECS[kind].loader).bind(**arguments).arguments) == set(arguments)


@pytest.mark.parametrize("kind", SPECS)
def test_inliers_are_names_of_checks(kind):
    assert set(SPECS[kind].inliers) <= {path.stem for path in (CONF_DIR / "inliers").glob("*.yaml")}


def test_the_documentation_says_the_same():
    lines = (ROOT / "docs" / "explanation" / "data-sets.md").read_text().splitlines()
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if re.match(r"\| `\w+` \|", line)]
    rows = {row[0].strip("`"): row[1:] for row in cells if len(row) == 5}
    assert set(rows) == set(SPECS) | NO_LAYOUT
    for kind, spec in SPECS.items():
        what, knows, inliers, _ = rows[kind]
        assert what.split(":")[0] == spec.title
        assert knows == (", ".join(spec.has) or "images")
        assert inliers == ", ".join(f"`{name}`" for name in spec.inliers)


def test_a_package_offers_its_own_before_ours(installed):
    installed()
    first, *others = find_specs()
    assert (first.kind, first.title) == ("walk", "Walks")
    assert {spec.kind for spec in others} == set(SPECS)


@pytest.mark.parametrize(
    ("entry_point", "problem"),
    [
        ("walks.gone:SPEC", r"can't be loaded \(ModuleNotFoundError"),
        ("walks.walk:GONE", r"can't be loaded \(AttributeError"),
        ("walks.walk:walk", "is <function walk .*, not a DatasetSpec"),
    ],
)
def test_an_entry_point_that_leads_nowhere(installed, entry_point, problem):
    installed(entry_point=entry_point)
    with pytest.raises(BadInputError, match=rf"the entry point walks = {entry_point} of sips_lit\.datasets {problem}"):
        find_specs()


def test_visible_images_of_a_folder(tmp_path):
    assert IMAGES.sign(tmp_path) is None
    for name in ("1.png", "2.JPG", ".3.png", "notes.txt"):
        (tmp_path / name).touch()
    assert IMAGES.sign(tmp_path) == "2 images"
    assert IMAGES.sign(tmp_path / "1.png") is None


@pytest.mark.parametrize(
    ("files", "sign"),
    [
        (["a.mp4"], "1 video"),
        (["a.MP4", "b.avi", "c.txt"], "2 videos"),
        ([".a.mp4", "c.txt"], None),
        (["more/a.mp4"], None),
        ([], None),
    ],
)
def test_visible_videos_of_a_folder(tmp_path, files, sign):
    for name in files:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert VIDEOS.sign(tmp_path) == sign


def test_a_video_file(tmp_path):
    for name in ("a.mkv", "list.txt"):
        (tmp_path / name).touch()
    assert VIDEOS.sign(tmp_path / "a.mkv") == "a.mkv"
    assert VIDEOS.sign(tmp_path / "list.txt") is None
