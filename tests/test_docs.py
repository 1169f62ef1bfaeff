"""What the documentation tells readers to type works: commands, keys, files, and the package of their own."""

import importlib
import importlib.util
import re
import shlex
import sys
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from detector_contract import check_contract
from documented_package import write_documented_package
from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from markdown_code import ROOT, blocks, pages
from omegaconf import OmegaConf
from textured_scenes import flight
from tiny_network import tiny_network

import sips_lit
from sips_lit.cli.app import register_resolvers
from sips_lit.cli.arguments import with_keys
from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.cli.data import parser
from sips_lit.detect.checkpoint import export_safetensors
from sips_lit.detect.selection import PointSelector
from sips_lit.errors import BadInputError
from sips_lit.types import Camera, FramePair, Keypoints, Matches, Reason, ViewGeometry

LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
PLACEHOLDERS = {"…": "run", "$shards": "1/2,2/2", "\\\n": " "}


def commands() -> list[tuple[str, str, list[str]]]:
    """Every sips command in a block of shell: where it stands, its name, its arguments."""
    found = []
    for block in blocks("bash"):
        text = block.text
        for placeholder, value in PLACEHOLDERS.items():
            text = text.replace(placeholder, value)
        for line in text.splitlines():
            for part in line.split("&&"):
                words = shlex.split(part, comments=True)
                if words and Path(words[0]).name.startswith("sips-"):
                    found.append((str(block), Path(words[0]).name.removeprefix("sips-"), words[1:]))
    return found


@pytest.fixture(scope="module")
def my_package(tmp_path_factory):
    folder = tmp_path_factory.mktemp("user")
    package = write_documented_package(folder)
    sys.path.insert(0, str(folder))
    yield package
    sys.path.remove(str(folder))
    for name in [name for name in sys.modules if name.partition(".")[0] == "my_package"]:
        del sys.modules[name]


def first_of_sweep(override: str) -> str:
    (parsed,) = OverridesParser.create().parse_overrides([override])
    if not parsed.is_sweep_override():
        return override
    value = next(parsed.sweep_string_iterator()) if parsed.is_discrete_sweep() else parsed.value().start
    return f"{parsed.get_key_element()}={value}"


@pytest.mark.parametrize(("place", "command", "arguments"), commands())
def test_commands_are_understood(place, command, arguments, my_package):
    if command == "data":
        parser().parse_args(arguments)
        return
    register_resolvers()
    overrides = [
        a for a in with_keys(command, arguments) if not a.startswith(("-", "hydra/launcher", "hydra.launcher"))
    ]
    if "-m" in arguments:
        overrides = [first_of_sweep(override) for override in overrides]
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        compose(command, overrides)


def test_there_are_commands():
    assert {name for _, name, _ in commands()} == {
        "train",
        "index",
        "data",
        "evaluate",
        "benchmark",
        "calibrate",
        "detect",
        "export",
        "match",
        "report",
        "speed",
        "odometry",
    }


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files(page):
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if "://" not in target and not target.startswith("mailto:") and "reference/" not in target:
            assert (page.parent / target).exists(), f"{page} links to {target}"


@pytest.fixture(scope="module")
def generated():
    spec = importlib.util.spec_from_file_location("generated", ROOT / "docs" / "generated.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_reference_holds_every_key(generated):
    page = generated.configuration_page()
    for path in CONF_DIR.rglob("*.yaml"):
        at = page.index(f"{{ #{path.stem} }}" if path.parent == CONF_DIR else f"{{ #{path.parent.name}-{path.stem} }}")
        shown = re.compile("```yaml\n(.*?)\n```", re.DOTALL).search(page, at)
        assert shown is not None
        assert OmegaConf.create(shown[1]) == OmegaConf.load(path)


def test_the_reference_holds_every_command(generated):
    page = generated.commands_page()
    with (ROOT / "pyproject.toml").open("rb") as file:
        scripts = tomllib.load(file)["project"]["scripts"]
    assert re.findall(r"^## (.*)$", page, re.MULTILINE) == list(scripts)
    assert "--yes" in page, "sips-data has no configuration: its own help is shown"


def test_the_reference_holds_every_public_name(generated):
    shown = {line.rpartition(".")[2] for line in generated.api_page().splitlines() if line.startswith("::: ")}
    assert shown == set(sips_lit.__all__) - {"__version__"}


def made(my_package, part: str, node: str | None = None):
    config = OmegaConf.load(my_package / "conf" / f"{part}.yaml")
    return instantiate(config if node is None else config[node])


def test_the_documented_detector_keeps_the_promises(my_package):
    detector = made(my_package, "detector/blobs")
    check_contract(detector, dimension=None)
    image = cv2.GaussianBlur(np.where(np.indices((60, 80)).sum(0) == 50, 255, 0).astype(np.uint8), (0, 0), 1)
    image[:], image[18:21, 29:32] = 0, 255
    np.testing.assert_array_equal(detector.detect(image, 1).xy, [[30, 19]])


def test_the_documented_descriptor_follows_the_picture(my_package):
    descriptor = made(my_package, "descriptor/patches")
    image = np.random.default_rng(0).integers(0, 255, (60, 80)).astype(np.uint8)
    points = Keypoints(*(np.array(v, np.float32) for v in ([[30, 20], [0, 0]], [1, 0.5], [1, 2])))
    moved = Keypoints(points.xy + np.float32([4, 3]), points.score, points.scale)
    rows = descriptor.describe(image, points)
    assert rows.shape == (2, 64)
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1, atol=1e-5)
    np.testing.assert_allclose(descriptor.describe(np.roll(image, (3, 4), (0, 1)), moved)[0], rows[0], atol=1e-5)
    assert descriptor.describe(image, Keypoints.empty()).shape == (0, 64)


def test_the_documented_data_set_is_read(my_package, tmp_path):
    log = tmp_path / "logs" / "first"
    (log / "images").mkdir(parents=True)
    for index in range(3):
        cv2.imwrite(str(log / "images" / f"{index}.png"), np.full((4, 6), 10 * index, np.uint8))
    poses = np.tile(np.eye(4)[:3], (3, 1, 1))
    poses[:, 0, 3] = [0, 1, 2]
    np.savetxt(log / "poses.txt", poses.reshape(3, 12))
    np.savetxt(log / "camera.txt", [[5, 0, 3], [0, 5, 2], [0, 0, 1]])
    loader = OmegaConf.load(my_package / "conf" / "data" / "rover.yaml")
    (sequence,) = instantiate(loader, path=str(tmp_path / "logs"))
    assert (len(sequence), sequence.name, sequence.camera(0).size) == (3, "first", (6, 4))
    assert sequence.frame(2).max() == 20
    np.testing.assert_array_equal(sequence.pose(2)[:, 3], [2, 0, 0, 1])
    (log / "images" / "0.png").unlink()
    with pytest.raises(InstantiationException, match="3 rows for 2 images"):
        instantiate(loader, path=str(tmp_path / "logs"))


def test_the_documented_check_knows_epipolar_lines(my_package):
    check = made(my_package, "inliers/epipolar")
    K = np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]])
    angle = np.radians(3)
    T_1_0 = np.eye(4)
    T_1_0[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    T_1_0[:3, 3] = [0.5, 0.1, 0.05]
    points = np.random.default_rng(0).uniform([-1, -1, 4], [1, 1, 8], (20, 3))
    seen0, seen1 = points @ K.T, (points @ T_1_0[:3, :3].T + T_1_0[:3, 3]) @ K.T
    xy0, xy1 = (seen[:, :2] / seen[:, 2:] for seen in (seen0, seen1))
    xy1[10:, 1] += 20  # the motion is sideways, and so are the lines
    image, ones = np.zeros((80, 100), np.uint8), np.ones(20, np.float32)
    camera = Camera(K, (100, 80))
    pair = FramePair("pair", 0, 1, (), image, image, None, ViewGeometry(T_1_0, camera, camera, None, None))
    sides = [Keypoints(xy.astype(np.float32), ones, ones) for xy in (xy0, xy1)]
    answer = check(pair, *sides, Matches(np.arange(20), np.arange(20)))
    np.testing.assert_array_equal(answer.inlier, np.arange(20) < 10)
    assert set(answer.reason[10:]) == {Reason.FAR}
    with pytest.raises(BadInputError, match="has no poses"):
        check(FramePair("pair", 0, 1, (), image, image), *sides, Matches(np.arange(20), np.arange(20)))


def test_the_documented_metric_is_the_ratio_of_all_matches(my_package):
    callback = made(my_package, "callbacks/inlier_ratio", "inlier_ratio")
    assert callback.n == 50
    for inliers, matches in ((3, 4), (0, 8)):
        callback.metric.update(inliers, matches)
    assert callback.metric.compute() == 3 / 12


def test_the_documented_data_set_is_recognised(my_package, tmp_path):
    spec = importlib.import_module("my_package.rover").SPEC
    assert spec.sign(tmp_path) is None
    (tmp_path / "first" / "images").mkdir(parents=True)
    (tmp_path / "first" / "poses.txt").touch()
    assert spec.sign(tmp_path) == "first/images, first/poses.txt"
    assert OmegaConf.load(my_package / "conf" / "data" / "rover.yaml")["_target_"] == "my_package.rover.rover"


def test_the_documented_formats_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    network, selector = tiny_network(), PointSelector()
    export_safetensors(network, selector, tmp_path / "best.safetensors")
    for name, image in zip(("a.jpg", "b.jpg"), flight(2, size=(160, 120)).frames, strict=True):
        cv2.imwrite(str(tmp_path / name), image)
    names: dict[str, object] = {}
    snippets = [block for block in blocks("python") if block.page == "docs/how-to/formats.md"]
    for block in snippets:
        exec(compile(block.text, str(block), "exec"), names)
    assert len(snippets) == 4
    assert (tmp_path / "database.db").is_file()
    assert [len(points) for points in names["several"]] == [50, 50]
    assert len(names["listed"]) == 50
    assert names["lafs"].shape == (1, 50, 2, 3)
    assert names["result"]["num_inliers"] > 4


def test_the_documented_matching_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, image in zip(("a.jpg", "b.jpg"), flight(2, size=(160, 120)).frames, strict=True):
        cv2.imwrite(str(tmp_path / name), image)
    snippets = [block for block in blocks("python") if block.page == "docs/how-to/match.md"]
    for block in snippets:
        names: dict[str, object] = {}  # each can be copied alone
        exec(compile(block.text, str(block), "exec"), names)
        assert names["pair" if "pair" in names else "posed"].inlier.sum() > 20
    assert len(snippets) == 3
    pictures = [cv2.imread(str(tmp_path / name)) for name in ("matches.png", "opencv.png")]
    assert [picture.shape[1] for picture in pictures] == [326, 320]
