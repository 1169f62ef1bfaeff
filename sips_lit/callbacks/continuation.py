"""What a run needs to go on in any folder: checkpoints that tell whose they are, and the best one brought along."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import lightning as L
from lightning.pytorch.callbacks import ModelCheckpoint, Timer

from sips_lit.detect.checkpoint import read_checkpoint
from sips_lit.errors import BadInputError, warn_input
from sips_lit.files import make_folder, write_whole

RECORD: Final = "run"
"""Key of a checkpoint under which it tells what its run is."""


def identity_of(content: Mapping[str, Any]) -> dict[str, Any]:
    """What is the same in all checkpoints of a run, from one of them; empty where it does not tell.

    Before validation pairs had a seed of their own, ``val_seed``, the run's chose them.
    """
    identity = dict(content.get(RECORD, {}).get("identity", {}))
    return {"val_seed": identity["seed"], **identity} if "seed" in identity else identity


class Continuation(L.Callback):
    """Stores in the checkpoints of a run what it is, and goes on with the best of them.

    ``record``: plain values; those under ``identity`` are the same in all checkpoints of a run. The best checkpoint so far
    is copied into the folder of this run with its score: `ModelCheckpoint` forgets both where the folder is another one. It
    is looked for beside the checkpoint that the run goes on from, then where that says. Warns when it is gone.
    """

    def __init__(self, record: Mapping[str, Any]) -> None:
        self.record = dict(record)

    def on_save_checkpoint(self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]) -> None:
        """Adds the record."""
        checkpoint[RECORD] = self.record

    def on_load_checkpoint(self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]) -> None:
        """Brings the best checkpoints along, before `ModelCheckpoint` takes its state out of ``checkpoint``.

        ``trainer.max_time`` is that of this run: the timer of the one before, which may have run out, is not restored.
        """
        checkpoint["callbacks"].pop(Timer.__name__, None)
        for callback in trainer.checkpoint_callbacks:
            state = checkpoint["callbacks"].get(callback.state_key)
            if not isinstance(callback, ModelCheckpoint) or not state or not state["best_k_models"]:
                continue
            scores: dict[str, Any] = {}
            if trainer.is_global_zero:
                beside = Path(str(trainer.ckpt_path)).parent
                scores = _bring(checkpoint, callback.state_key, beside, Path(str(callback.dirpath)))
            scores = trainer.strategy.broadcast(scores)
            if not scores:
                del checkpoint["callbacks"][callback.state_key]
                continue
            best, worst = (max, min) if callback.mode == "max" else (min, max)
            first, last = best(scores, key=scores.__getitem__), worst(scores, key=scores.__getitem__)
            state |= {"dirpath": callback.dirpath, "best_k_models": scores}
            state |= {"best_model_path": first, "best_model_score": scores[first]}
            state |= {"kth_best_model_path": last, "kth_value": scores[last]}


def _bring(checkpoint: Mapping[str, Any], key: str, beside: Path, folder: Path) -> dict[str, Any]:
    """Copies the best checkpoints into a folder, unless they are there; their new paths and their scores."""
    state, scores = checkpoint["callbacks"][key], {}
    for recorded, score in state["best_k_models"].items():
        inside = Path(recorded).relative_to(state["dirpath"])
        for source in (beside / inside, Path(recorded)):
            content = _of_this_run(source, checkpoint)
            if content is None:
                continue
            target = folder / inside
            if source.resolve() != target.resolve():
                make_folder(target.parent)
                write_whole(target, source.read_bytes())
            # a kill may have left a file of a later validation than the checkpoint's: its own score belongs to it
            scores[str(target)] = content.get("callbacks", {}).get(key, {}).get("current_score", score)
            break
        else:
            warn_input(
                f"the best checkpoint so far, {recorded} ({state['monitor']} {float(score):.3f}), is gone, damaged or of "
                f"another run, and does not count: to count it put it into {beside} and go on from there again"
            )
    return scores


def _of_this_run(path: Path, checkpoint: Mapping[str, Any]) -> Mapping[str, Any] | None:
    try:
        content = read_checkpoint(path)
    except BadInputError:
        return None
    return content if identity_of(content) == identity_of(checkpoint) else None
