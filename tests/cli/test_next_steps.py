import shlex

import pytest
from cli_runs import TINY
from hydra import compose, initialize_config_dir

from sips_lit.cli.app import register_resolvers
from sips_lit.cli.arguments import as_typed
from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.cli.next_steps import pasted, told


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


def sorted_as(log: str, printed: str) -> list[str]:
    """The lines that were printed, which come from two streams, in the order of the log; those of a log alone fail."""
    left = printed.splitlines()
    for line in log.splitlines():
        left.remove(line)
    assert [line for line in left if line.strip()] == []
    return log.splitlines()
