import shlex

import pytest
import rgbd_files
from cli_runs import TINY
from hydra import compose, initialize_config_dir

from sips_lit.cli.app import register_resolvers
from sips_lit.cli.arguments import as_typed
from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.cli.next_steps import pasted, told
from sips_lit.cli.speed import Candidate, fastest_of_ours
from sips_lit.evaluate.speed import Speed


def test_commands_are_quoted_for_the_shell():
    assert told([["a", "b=c d"], ["e"]]) == "\nnext:\n  a 'b=c d'\n  e"


@pytest.mark.parametrize(
    ("override", "typed"),
    [
        ("data.path='my frames'", "data.path=my frames"),
        ("data.path=null", "data.path=null"),
        ("data.path=['a','b']", "data.path=['a','b']"),
        ("n=5", "n=5"),
        ("title='a b'", "title='a b'"),
        (r"data.path='it\'s'", "data.path=it's"),
    ],
)
def test_paths_are_as_one_types_them(override, typed):
    assert pasted(override) == typed
    assert as_typed([typed]) == as_typed([override])


def test_a_training_ends_with_commands_that_run(command, frames, folders):
    moved = folders / "my frames"
    moved.symlink_to(frames)
    result = command("train", *TINY, "data=folder", f"data.path={moved}", f"hydra.run.dir={folders}/a run")
    assert result.code == 0, result.err
    assert "?" not in result.err, "progress without a total"
    _, _, text = result.out.partition("\nnext:\n")
    detect, evaluate, board = map(shlex.split, text.splitlines())
    assert board == ["tensorboard", "--logdir", str(folders / "outputs")]
    found = command(detect[0].removeprefix("sips-"), *detect[1:])
    assert found.code == 0, found.err
    assert (folders / "a run" / "points").is_dir()
    register_resolvers()
    with initialize_config_dir(str(CONF_DIR), version_base="1.3"):
        config = compose("evaluate", as_typed(evaluate[1:]))
    assert (config.data.path, config.checkpoint) == (str(moved), str(folders / "a run" / "checkpoints" / "best.ckpt"))
    log = (folders / "a run" / "sips-train.log").read_text()
    assert log == "".join(f"{line}\n" for line in sorted_as(log, result.out + result.err))


def following(result) -> list[list[str]]:
    assert result.code == 0, result.err
    return [shlex.split(line) for line in result.out.partition("\nnext:\n")[2].splitlines()]


@pytest.mark.parametrize("elsewhere", ["callbacks.checkpoint.dirpath=null", "callbacks.checkpoint.filename=null"])
def test_a_training_whose_checkpoint_is_elsewhere_ends_well(command, frames, folders, elsewhere):
    result = command("train", *TINY, "data=folder", f"data.path={frames}", elsewhere)
    assert result.code == 0, result.err
    assert result.out.endswith(f"\nnext:\n  tensorboard --logdir {folders}/outputs\n")


def test_an_odometry_ends_with_what_is_measured_next(command, folders):
    desk = rgbd_files.write_simple(folders / "my desk")
    short = "iterations=50", "repeats=1"
    one = command("odometry", "data=rgbd", f"data.path={desk}", *short, "detector=orb", "descriptor=own")
    (again,) = following(one)
    assert again == [
        *("sips-odometry", "data=rgbd", f"data.path={desk}", *short, "detector=orb", "descriptor=own"),
        *("n=[10,25,50,100,200,500]", "detectors=[sips,sift,orb]"),
    ]
    few = [part for part in again[1:] if not part.startswith(("n=", "detectors="))]
    (cost,) = following(command("odometry", *few, "n=[30,60]", "detectors=[orb]"))
    assert cost == ["sips-speed", "detectors=[orb]"]


def test_a_measurement_of_speed_ends_with_the_points_of_the_fastest(command, checkpoint, frames, folders):
    moved = folders / "my frames"
    moved.symlink_to(frames)
    listed = f"detectors=[orb,{{sips: {{path: {checkpoint}, runtime: torch}}}}]"
    size = "size=[64,48]", "rounds=2", "n=20", "memory=false", f"output={folders / 'speed'}"
    (detect,) = following(command("speed", f"input={moved}", listed, *size))
    assert detect == ["sips-detect", f"checkpoint={checkpoint}", "runtime=torch", "precision=32", f"input={moved}"]
    found = command("detect", *detect[1:], f"output={folders / 'points'}")
    assert found.code == 0, found.err
    assert "next:" not in command("speed", "input=" + str(moved), "detectors=[orb]", *size).out


def test_the_fastest_is_the_one_with_the_least_time():
    made = {"path": "a", "runtime": "torch"}, {"path": "b", "runtime": "torch"}, {"_target_": "orb"}
    candidates = [Candidate(None, config) for config in made]
    speeds = [Speed("", "", 0, {"points": [time]}) for time in (3.0, 2.0, 1.0)]
    assert fastest_of_ours(candidates, speeds) == made[1]
    assert fastest_of_ours(candidates[2:], speeds[2:]) is None


def sorted_as(log: str, printed: str) -> list[str]:
    """The lines that were printed, which come from two streams, in the order of the log; those of a log alone fail."""
    left = printed.splitlines()
    for line in log.splitlines():
        left.remove(line)
    assert [line for line in left if line.strip()] == []
    return log.splitlines()
