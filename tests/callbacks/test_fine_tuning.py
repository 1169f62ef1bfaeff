from types import SimpleNamespace

import pytest

from sips_lit.callbacks.fine_tuning import FineTuning


def validated(callback: FineTuning, auc: float, before: bool) -> None:
    callback.on_validation_end(
        SimpleNamespace(sanity_checking=before, callback_metrics={"val/succinctness_auc": auc}), None
    )


def test_the_start_is_what_was_validated_before_the_first_step():
    callback = FineTuning()
    validated(callback, 0.8, before=True)
    validated(callback, 0.9, before=False)
    resumed = FineTuning()
    resumed.load_state_dict(callback.state_dict())
    assert resumed.start == 0.8
    assert resumed.told(0.9, "small.ckpt") == "AUC 0.800 with the weights of small.ckpt, 0.900 now (+0.100)"


@pytest.mark.parametrize("auc", [0.7, 0.8])
def test_no_gain_is_told(auc):
    callback = FineTuning()
    validated(callback, 0.8, before=True)
    assert callback.told(auc, "a.ckpt").startswith(f"no gain: AUC 0.800 with the weights of a.ckpt, {auc:.3f} at best")


def test_the_whole_validation_comes_first():
    trainer = SimpleNamespace(num_sanity_val_steps=0)
    FineTuning().setup(trainer, None, "fit")
    assert trainer.num_sanity_val_steps == float("inf")
