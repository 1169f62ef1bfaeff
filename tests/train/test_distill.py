import numpy as np
import pytest
import torch
from distilling import crops, distilling, teacher
from train_run import Watch, fit

from sips_lit.detect.checkpoint import load_checkpoint
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import image_tensor
from sips_lit.errors import BadInputError
from sips_lit.train.augment import Augmentation
from sips_lit.train.crops import TrainingCrops
from sips_lit.train.dense_loss import logit_loss, soft_target_loss


@pytest.fixture
def step(tmp_path, monkeypatch):
    """``step(module)``: what a step on a batch of crops gives and logs."""
    data = crops(tmp_path)

    def run(module):
        batch = TrainingCrops(data.sources, Augmentation(), 1, 0, 3, 32, module.margin)[0]
        logged = {}
        module.log = lambda name, value, **_: logged.update({name: float(value)})
        monkeypatch.setattr(type(module), "data", data)
        return module.training_step(batch, 0), logged, batch

    return run


@pytest.mark.parametrize("options", [{}, {"emphasis": 3.0, "logit_weight": 2.0, "bound": 1.0}])
@pytest.mark.parametrize("depth", [3, 6])
def test_the_loss_is_that_of_whole_crops_with_their_surroundings(step, options, depth):
    """Whichever of both sees farther."""
    module = distilling(ScoreNetwork(depth, 4), **options)
    loss, logged, batch = step(module)
    margin = max(depth, 4)
    assert batch.images.shape[-1] == 32 + 2 * margin
    with torch.no_grad():
        whole = [network(batch.images.float()) for network in (module.network, module.teacher)]
    student, target = (logits[..., margin:-margin, margin:-margin] for logits in whole)
    weight, bound = options.get("logit_weight", 0.1), options.get("bound", 8.0)
    entropy = soft_target_loss(student, target, batch.inside, options.get("emphasis", 20.0))
    expected = entropy + weight * logit_loss(student, target, batch.inside, bound)
    torch.testing.assert_close(loss.detach(), expected)
    assert logged["train/loss"] == pytest.approx(float(expected), rel=1e-5)
    assert 0 < logged["train/excess_loss"] < logged["train/loss"]


def test_a_student_that_is_its_teacher_has_nothing_to_learn(step):
    module = distilling(ScoreNetwork(4, 6))
    module.network.load_state_dict(teacher().state_dict())
    loss, logged, _ = step(module)
    assert logged["train/excess_loss"] == 0
    assert logged["train/logit_difference"] == 0
    loss.backward()
    assert max(float(p.grad.abs().max()) for p in module.network.parameters()) < 1e-4
    assert all(p.grad is None for p in module.teacher.parameters())


def test_a_student_learns_in_seconds(tmp_path):
    module, watch = distilling(ScoreNetwork(4, 6)), Watch()
    excess = []
    watch.on_train_batch_end = lambda trainer, *_: excess.append(float(trainer.callback_metrics["train/excess_loss"]))
    before = [p.clone() for p in module.teacher.parameters()]
    fit(module, crops(tmp_path), steps=80, callbacks=[watch])
    assert np.mean(excess[-10:]) < 0.5 * np.mean(excess[:5])
    assert all(torch.equal(a, b) for a, b in zip(before, module.teacher.parameters(), strict=True))
    assert len(watch.validated) == 2


def test_a_checkpoint_holds_the_student_alone(tmp_path):
    module = distilling()
    trainer = fit(module, crops(tmp_path), steps=1)
    trainer.save_checkpoint(tmp_path / "a.ckpt")
    stored = torch.load(tmp_path / "a.ckpt", weights_only=True)
    assert {name.partition(".")[0] for name in stored["state_dict"]} == {"network"}
    network, selector = load_checkpoint(tmp_path / "a.ckpt")
    assert (network.config["depth"], selector.nms_radius) == (3, 3)
    image = image_tensor(crops(tmp_path).sources[0].sequences[0].frame(0))
    with torch.no_grad():
        torch.testing.assert_close(network(image), module.network(image))


@pytest.mark.parametrize("options", [{"emphasis": -1}, {"logit_weight": -1}, {"bound": 0}])
def test_weights_can_not_be_negative(options):
    with pytest.raises(BadInputError, match="can't be negative, and bound must be positive"):
        distilling(**options)
