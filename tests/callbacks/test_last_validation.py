from types import SimpleNamespace

import lightning as L
import pytest
import torch

from sips_lit.callbacks.last_validation import LastValidation


@pytest.mark.parametrize(("step", "stops"), [(3, False), (4, True)])
def test_the_last_step_asks_for_a_validation(step, stops):
    trainer = SimpleNamespace(global_step=step, max_steps=4, should_stop=False)
    LastValidation().on_train_batch_end(trainer, None, None, None, step - 1)
    assert trainer.should_stop is stops


class Counting(L.LightningModule):
    """Notes after how many steps it is validated."""

    def __init__(self):
        super().__init__()
        self.layer, self.validated = torch.nn.Linear(1, 1), []

    def training_step(self, batch, batch_idx):
        return self.layer(batch).sum()

    def validation_step(self, batch, batch_idx):
        if not self.trainer.sanity_checking:
            self.validated.append(self.global_step)

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), 0.1)


@pytest.mark.parametrize(("callbacks", "validated"), [([], [3, 6]), ([LastValidation()], [3, 6, 7])])
def test_a_trainer_validates_after_its_last_step(callbacks, validated, tmp_path):
    batches = torch.utils.data.DataLoader(torch.ones(20, 1))
    trainer = L.Trainer(
        max_steps=7, val_check_interval=3, callbacks=callbacks, accelerator="cpu", logger=False,
        enable_checkpointing=False, enable_progress_bar=False, enable_model_summary=False, default_root_dir=tmp_path,
    )  # fmt: skip
    module = Counting()
    trainer.fit(module, batches, torch.utils.data.DataLoader(torch.ones(1, 1)))
    assert module.validated == validated
