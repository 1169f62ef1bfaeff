from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from lightning.pytorch.callbacks import ModelCheckpoint

from sips_lit.callbacks.continuation import Continuation, identity_of
from sips_lit.errors import InputWarning

RECORD = {"identity": {"seed": 0}, "told": {"trainer.max_steps": 8}}


def written(folder: Path, scores: dict[str, float], mode: str = "max") -> tuple[ModelCheckpoint, dict]:
    """The callback of a folder and a checkpoint beside its best ones, which are files there."""
    callback = ModelCheckpoint(folder, "{step}", "auc", mode=mode, save_top_k=len(scores) or 1)
    key = callback.state_key
    folder.mkdir(parents=True)
    callback.best_k_models = {str(folder / name): torch.tensor(score) for name, score in scores.items()}
    for name, score in scores.items():
        state = {"current_score": torch.tensor(score)}
        content = {"state_dict": {}, "hyper_parameters": {}, "run": RECORD, "callbacks": {key: state}, "is": name}
        torch.save(content, folder / name)
    return callback, {"run": RECORD, "callbacks": {key: callback.state_dict()}}


def load(callback: ModelCheckpoint, checkpoint: dict, resumed: Path) -> None:
    trainer = SimpleNamespace(
        checkpoint_callbacks=[callback],
        is_global_zero=True,
        ckpt_path=str(resumed),
        strategy=SimpleNamespace(broadcast=lambda value: value),
    )
    Continuation(RECORD).on_load_checkpoint(trainer, None, checkpoint)


def test_checkpoints_tell_what_their_run_is():
    checkpoint = {}
    Continuation(RECORD).on_save_checkpoint(None, None, checkpoint)
    assert checkpoint == {"run": RECORD}


def test_before_there_was_a_seed_of_validation_pairs_the_runs_chose_them():
    assert identity_of({"run": {"identity": {"seed": 3, "k": 10}}}) == {"val_seed": 3, "seed": 3, "k": 10}
    assert identity_of({"run": {"identity": {"seed": 3, "val_seed": 0}}}) == {"seed": 3, "val_seed": 0}
    assert identity_of({}) == {}


@pytest.mark.parametrize(("mode", "best", "worst"), [("max", "b.ckpt", "a.ckpt"), ("min", "a.ckpt", "b.ckpt")])
def test_all_kept_checkpoints_are_brought_along_with_their_scores(tmp_path, mode, best, worst):
    _, checkpoint = written(tmp_path / "old", {"a.ckpt": 0.25, "c.ckpt": 0.5, "b.ckpt": 0.75}, mode)
    here = ModelCheckpoint(tmp_path / "new", "{step}", "auc", mode=mode, save_top_k=3)
    load(here, checkpoint, tmp_path / "old" / "last.ckpt")
    here.load_state_dict(checkpoint["callbacks"][here.state_key])
    scores = {"a.ckpt": 0.25, "b.ckpt": 0.75, "c.ckpt": 0.5}
    assert here.best_k_models == {str(tmp_path / "new" / name): score for name, score in scores.items()}
    assert (here.best_model_path, here.best_model_score) == (str(tmp_path / "new" / best), scores[best])
    assert (here.kth_best_model_path, here.kth_value) == (str(tmp_path / "new" / worst), scores[worst])
    for name in scores:
        assert torch.load(tmp_path / "new" / name, weights_only=True)["is"] == name


def test_one_that_is_gone_is_told_and_the_others_count(tmp_path):
    _, checkpoint = written(tmp_path / "old", {"a.ckpt": 0.25, "b.ckpt": 0.75})
    (tmp_path / "old" / "b.ckpt").unlink()
    here = ModelCheckpoint(tmp_path / "new", "{step}", "auc", mode="max", save_top_k=2)
    with pytest.warns(InputWarning, match=r"best checkpoint so far, .*b\.ckpt \(auc 0\.750\), is gone"):
        load(here, checkpoint, tmp_path / "old" / "last.ckpt")
    assert checkpoint["callbacks"][here.state_key]["best_model_score"] == 0.25


def test_nothing_is_brought_where_nothing_was_validated(tmp_path):
    callback, checkpoint = written(tmp_path / "old", {})
    load(callback, checkpoint, tmp_path / "old" / "last.ckpt")
    assert checkpoint["callbacks"][callback.state_key]["best_k_models"] == {}
