"""Every YAML composes with the command that it is for, and what it describes can be made."""

import importlib
import shlex
import subprocess
import sys
import zipfile
from pathlib import Path

import cv2
import hpatches_files
import numpy as np
import pytest
import rgbd_files
import rgbd_layouts
from cli_runs import ROOT
from hydra import compose, initialize_config_dir
from hydra.errors import InstantiationException
from hydra.utils import instantiate
from image_files import write_images
from omegaconf import OmegaConf
from random_weights import weights_file
from robotcar_files import write_run
from textured_scenes import texture
from tum_mono_files import write_sequence

from sips_lit.cli.app import build, register_resolvers
from sips_lit.cli.arguments import as_typed
from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.cli.data import how_to_use
from sips_lit.cli.evaluation import CHOICE, MEASURED, PAIR_SET
from sips_lit.cli.methods import make_methods
from sips_lit.cli.train import comparison
from sips_lit.dataset_tools.recognise import recognise
from sips_lit.evaluate.measures import Measures
from sips_lit.frames.source import as_sources

GROUPS = {
    "train": ["model", "inliers", "descriptor", "augment", "optim", "callbacks", "logger", "trainer", "paths"],
    "evaluate": ["detector", "descriptor", "inliers", "paths"],
    "index": ["paths"],
}
OTHERS = {"data", "experiment", "evaluation", "datamodule", "module", "hydra"}  # need data, a teacher, a checkpoint
EXTRAS = {"descriptor/surf": "mahotas", "detector/surf": "mahotas"}
LEARNED = {"aliked", "dedode", "disk", "keynet", "raco", "superpoint", "xfeat"}
MIXTURES = {
    "mixed": {"video": "video", "driving": "kitti", "drone": "euroc", "indoor": "rgbd", "planes": "hpatches"},
    "robotics": {"tum_mono": "tum_mono", "robotcar": "robotcar"},
}
DEMO = {"demo", "demo_val", "hpatches_flights", "released", "released_layers"}


def names(group: str) -> list[str]:
    return sorted(path.stem for path in (CONF_DIR / group).glob("*.yaml"))


def composed(command: str, *overrides: str):
    register_resolvers()
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        return compose(command, list(overrides))


def cases() -> list[tuple[str, str, str]]:
    return [(command, group, name) for command, groups in GROUPS.items() for group in groups for name in names(group)]


def test_every_group_is_covered():
    groups = {path.name for path in CONF_DIR.iterdir() if path.is_dir()}
    assert groups == {group for groups in GROUPS.values() for group in groups} | OTHERS
    commands = {path.stem for path in CONF_DIR.glob("*.yaml")}
    assert commands == {*GROUPS, "benchmark", "calibrate", "detect", "export", "match", "odometry", "report", "speed"}


def test_an_evaluation_has_the_keys_that_are_read_and_the_defaults_of_the_code():
    stored = OmegaConf.load(CONF_DIR / "evaluation" / "default.yaml")
    others = {"refine_poses", "pair_sets", "features", "pictures", "video_frames", "workers", "labels", "resamples"}
    assert set(stored) == {*CHOICE, *MEASURED} | others
    for name in set(MEASURED) - {"seed"}:
        default = getattr(Measures(), name)
        assert stored[name] == (list(default) if isinstance(default, tuple) else default), name


@pytest.mark.parametrize(("command", "group", "name"), cases(), ids=lambda part: str(part))
def test_every_part_can_be_made(command, group, name, tmp_path, checkpoint):
    extra = EXTRAS.get(f"{group}/{name}")
    if extra is not None:
        pytest.importorskip(extra, reason=f"{group}={name} needs an extra")
    paths = f"paths.run={tmp_path}/run", f"paths.data={tmp_path}/data"
    more = [f"checkpoint={checkpoint}"] if command == "evaluate" else []
    more += files_of(name, tmp_path) if group == "detector" else []
    config = composed(command, "data=folder", "data.path=x", *paths, f"{group}={name}", *more)
    node = config[group]
    if "_target_" in node:
        made = build(node)
        assert made is not None or (group, name) == ("descriptor", "own")
    elif group == "paths":
        assert all(OmegaConf.to_container(node, resolve=True).values())
    else:
        made = [build(part) for part in node.values() if part is not None]
        assert made
        assert None not in made


def files_of(name: str, tmp_path: Path) -> list[str]:
    """Arguments that give a detector the files that it needs."""
    if name in LEARNED:
        return [f"detector.weights={weights_file(name, tmp_path)}"]
    if name == "precomputed":
        cv2.imwrite(str(tmp_path / "1.png"), texture(40, 50))
        np.savez(tmp_path / "1.npz", keypoints=np.zeros((1, 2)))
        return [f"detector.features={tmp_path}", f"data.path={tmp_path}"]
    return []


def sources_of(name: str, tmp_path: Path) -> list[str]:
    """Arguments that give a data configuration something to read."""
    if name in MIXTURES:
        parts = ((part, sources_of(kind, tmp_path / part)) for part, kind in MIXTURES[name].items())
        return [
            a.replace("data.", f"data.sources.{part}.sequences.", 1) for part, arguments in parts for a in arguments
        ]
    tmp_path.mkdir(exist_ok=True)
    if name in ("folder", "virtual_flight", "stills"):
        for i in range(3):
            cv2.imwrite(str(tmp_path / f"{i}.png"), texture(200, 260, i))
        return [f"data.path={tmp_path}"]
    if name == "video":
        path = tmp_path / "clip.avi"
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10, (96, 80))
        for i in range(4):
            writer.write(cv2.cvtColor(texture(80, 96)[:, :], cv2.COLOR_GRAY2BGR) // (1 + i // 3))
        writer.release()
        return [f"data.path={path}"]
    if name == "tum_mono":
        return [f"data.path={write_sequence(tmp_path)}"]
    if name == "robotcar":
        return [f"data.path={write_run(tmp_path)}", "data.crop_bottom=20"]
    if name == "hpatches":
        hpatches_files.write_sequence(tmp_path)
        return [f"data.path={tmp_path}"]
    if name == "rgbd":
        return [f"data.path={rgbd_files.write_simple(tmp_path / 'desk')}"]
    if hasattr(rgbd_layouts, f"write_{name}"):
        return [f"data.path={getattr(rgbd_layouts, f'write_{name}')(tmp_path / 'scene')}"]
    make = getattr(importlib.import_module(f"{name}_files"), f"make_{name}")  # any other brings its own, in support/
    return [f"data.path={make(tmp_path)}"]


@pytest.mark.parametrize("name", names("data"))
@pytest.mark.parametrize("command", ["train", "evaluate", "index"])
def test_every_data_set_composes(command, name):
    config = composed(command, f"data={name}", "paths.run=x")
    target = config.data._target_
    assert target.startswith(("sips_lit.frames.", "sips_lit.datasets."))
    assert callable(instantiate({"_target_": target, "_partial_": True}))


@pytest.mark.parametrize("name", sorted(set(names("data")) - DEMO))
def test_every_data_set_opens(name, tmp_path):
    config = composed(
        "train", f"data={name}", "paths.run=x", f"paths.data={tmp_path}/data", *sources_of(name, tmp_path)
    )
    sources = as_sources(build(config.data))
    assert len(sources) == len(MIXTURES.get(name, [name]))
    for source in sources:
        assert source.sequences[0].frame(0).ndim == 2


def test_names_of_frames_are_read_as_check_prints_them(tmp_path):
    for name, kind in (("color", "colour"), ("depth", "depth")):
        write_images(tmp_path, f"frame-{{:06d}}.{name}.png", kind)
    (dataset,) = recognise(tmp_path)
    with pytest.raises(InstantiationException, match="different kinds"):
        build(composed("train", "data=folder", f"data.path={tmp_path}", "paths.run=x").data)
    _, command, *arguments = shlex.split(how_to_use(dataset))
    assert command == "sips-train"
    (sequence,) = build(composed("train", *as_typed(arguments), "paths.run=x").data)
    assert {file.name.split(".")[1] for file in sequence.files} == {"color"}


def test_validation_data_in_its_own_place():
    config = composed("train", "data=folder", "data@val_data=video", "val_data.path=v.mp4", "paths.run=x")
    assert config.val_data.path == "v.mp4"
    assert config.val_data._target_ == "sips_lit.frames.video.video"
    assert OmegaConf.is_missing(config.data, "path")


BENCHMARKS = [name for name in names("experiment") if name.startswith("benchmark")]


@pytest.mark.parametrize("name", BENCHMARKS)
def test_every_benchmark_composes(name, tmp_path):
    given = "root=x", "checkpoint=x", "data.path=x", f"paths.run={tmp_path}"
    config = composed("benchmark", f"experiment={name}", *given)
    OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    for entry in config.pair_sets.values():
        assert build(entry.inliers).protocol["inliers"]


def test_the_calibration_of_released_weights_composes(tmp_path):
    config = composed("calibrate", "experiment=calibrate_released", "root=x", f"paths.run={tmp_path}", "data.path=x")
    sources = OmegaConf.load(CONF_DIR / "data" / "released.yaml").sources
    for name, entry in OmegaConf.to_container(config, resolve=True, throw_on_missing=True)["pair_sets"].items():
        assert entry["data"]["_target_"] == sources[name].sequences._target_


@pytest.mark.parametrize("name", sorted(set(names("experiment")) - {*BENCHMARKS, "calibrate_released"}))
def test_every_experiment_composes(name, tmp_path, checkpoint):
    given = [f"data.sources.{part}.sequences.path=x" for part in MIXTURES["robotics"]] if name == "paper" else []
    given += ["root=x"] if name in ("released", "recipe_search") else []
    given += ["data.path=x"] if name in ("covariance", "distill", "own_recipe") else []
    given += [f"teacher={checkpoint}"] if name == "distill" else []
    config = composed("train", f"experiment={name}", f"paths.run={tmp_path}", f"paths.data={tmp_path}", *given)
    OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    if config.compare is not None:
        with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
            compared, skipped = comparison(config, checkpoint), {}
            assert {method.key for method in make_methods(compared, skipped.__setitem__)} > {
                "sips_rootsift",
                "sift",
            }
            assert not skipped
        for entry in config.compare.pair_sets.values():
            build(entry.inliers)
            assert set(entry) <= set(PAIR_SET)


@pytest.mark.parametrize(
    ("choices", "averaged", "inliers"),
    [
        (["experiment=released", "root=x"], True, "klt_retraced"),
        (["experiment=[released,distill]", "root=x", "teacher=x"], False, "klt_retraced"),
        (["data.path=x"], False, "klt_retraced"),
        (["experiment=paper", "data.sources=null"], False, "klt"),
        (["experiment=quickstart"], False, "klt"),
    ],
    ids=["released", "distilled", "default", "paper", "quickstart"],
)
def test_labels_by_klt_and_averaged_weights_where_they_are_wanted(choices, averaged, inliers):
    config = composed("train", *choices)
    assert (config.callbacks.average is not None) == averaged
    assert (config.optim.scheduler is None) == (averaged or choices[0] == "experiment=paper")
    assert config.inliers._target_.startswith(f"sips_lit.inliers.{inliers}.")


def test_what_is_searched_is_the_recipe_of_released_weights():
    """But for what a search of kinds left out has of its own: kinds, steps, and what validation costs."""
    released, searched = (composed("train", f"experiment={name}", "root=x") for name in ("released", "recipe_search"))
    del searched.callbacks.pictures, released.callbacks.pictures
    searched.data.without = []
    shared = "data", "optim", "callbacks", "module", "model", "inliers", "descriptor", "augment"
    assert {name: searched[name] for name in shared} == {name: released[name] for name in shared}
    assert searched.datamodule.overlap == released.datamodule.overlap


def test_every_target_is_ours_or_of_what_we_depend_on():
    for path in CONF_DIR.rglob("*.yaml"):
        for line in path.read_text().splitlines():
            if "_target_:" in line:
                target = line.split("_target_:")[1].strip().split("}")[0]
                ours = ("sips_lit.", "hydra_plugins.sips_lit_", "lightning.", "torch.", "torchmetrics.", "optuna.")
                assert target.startswith(ours), (path, target)


@pytest.mark.parametrize(
    "name", ["index", "evaluate", "benchmark", "calibrate", "detect", "export", "odometry", "match", "speed"]
)
def test_unknown_keys_are_refused(command, name):
    result = command(name, "nonsense=1")
    assert result.code == 1
    assert "nonsense" in result.err
    assert "Traceback" not in result.err


@pytest.mark.slow
def test_a_wheel_holds_the_configurations_and_works_from_any_folder(tmp_path):
    build_wheel = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(tmp_path), str(ROOT)]
    run = subprocess.run(build_wheel, capture_output=True, text=True)
    if run.returncode != 0 and "hatchling" in run.stderr:
        pytest.skip("a wheel can't be built here: hatchling is not installed and can't be downloaded")
    assert run.returncode == 0, run.stderr
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        held = set(archive.namelist())
        archive.extractall(tmp_path / "installed")
    for path in CONF_DIR.rglob("*.yaml"):
        assert f"sips_lit/conf/{path.relative_to(CONF_DIR)}" in held
    assert {"sips_lit/py.typed", "hydra_plugins/sips_lit_sweeper.py"} <= held
    assert not any(name.startswith(("tests/", "conf/", "data/", "outputs/")) for name in held)
    show = [sys.executable, "-m", "sips_lit.cli.index", "--cfg", "job", "data=folder", "data.path=x"]
    environment = {"PATH": "/usr/bin:/bin", "PYTHONPATH": str(tmp_path / "installed")}
    shown = subprocess.run(show, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert shown.returncode == 0, shown.stderr
    assert "OverlapParameters" in shown.stdout
