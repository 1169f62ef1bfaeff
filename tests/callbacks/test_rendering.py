from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import torch
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from textured_scenes import flight, keypoints

from sips_lit.callbacks.calibration import CalibrationValidation
from sips_lit.callbacks.rendering import MatchPictures, score_map
from sips_lit.callbacks.succinctness import SuccinctnessValidation
from sips_lit.callbacks.tensorboard import writer_of
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.geometry.homography import apply_homography
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.inliers.verification import VerifiedPair, verify
from sips_lit.pairs.sampler import read_pair
from sips_lit.types import Features

N = 30


class Module:
    """What the callbacks ask of a module; keeps what is logged."""

    device = torch.device("cpu")

    def __init__(self) -> None:
        torch.manual_seed(0)
        self.network, self.logged = ScoreNetwork(3, 4), {}

    def log(self, name, value, **_) -> None:
        self.logged[name] = float(value)

    def log_dict(self, values, **_) -> None:
        self.logged |= {name: float(value) for name, value in values.items()}


class Writer:
    def __init__(self) -> None:
        self.figures, self.images = [], []

    def add_figure(self, tag, figure, step) -> None:
        self.figures.append((tag, step))

    def add_image(self, tag, image, step, dataformats) -> None:
        self.images.append((tag, step, image.shape, dataformats))


@pytest.fixture
def writer(monkeypatch) -> Writer:
    writer = Writer()
    for name in ("succinctness", "calibration", "rendering"):
        monkeypatch.setattr(f"sips_lit.callbacks.{name}.writer_of", lambda trainer: writer)
    return writer


TRAINER = SimpleNamespace(global_step=12, is_global_zero=True, loggers=[])


def verified(good: int, n: int = N, seed: int = 0, scale: float = 1.0) -> VerifiedPair:
    """A pair whose first ``good`` points correspond and match, and whose other matches are wrong."""
    pair = read_pair(flight(4, size=(120, 90), seed=seed), 0, 3)
    assert pair.homography is not None
    generator = np.random.default_rng(seed)
    xy0 = generator.uniform([30, 30], [90, 60], (n, 2))
    xy1 = apply_homography(pair.homography, xy0)
    xy1[good:] += 25
    descriptors = np.eye(max(n, 1), dtype=np.float32)[:n] * 9
    score = np.linspace(0.9, 0.1, n) * scale
    features = [Features(keypoints(xy, score), descriptors, "l2") for xy in (xy0, xy1)]
    return verify(pair, *features, HomographyInliers())


def validate(callback, *pairs) -> Module:
    module = Module()
    if hasattr(callback, "metric"):
        callback.on_validation_start(TRAINER, module)
    for index, pair in enumerate(pairs):
        callback.on_validation_batch_end(TRAINER, module, pair, None, index)
    if hasattr(callback, "metric"):
        callback.on_validation_epoch_end(TRAINER, module)
    return module


def test_succinctness_of_known_pairs(writer):
    # the best points are inliers: k of them need k points; the third pair has too few
    logged = validate(SuccinctnessValidation(10, 50), verified(30), verified(10, seed=1), verified(9, seed=2)).logged
    assert logged["val/succinctness_auc"] == pytest.approx(2 / 3 * 40 / 50)
    assert logged["val/failure_rate"] == pytest.approx(1 / 3)
    assert logged["val/n_median"] == 10
    assert "val/n_at_80" not in logged  # never reached: no number
    assert writer.figures == [("validation/succinctness", 12)]


def test_every_validation_starts_anew(writer):
    callback = SuccinctnessValidation(10, 50)
    assert validate(callback, verified(5)).logged["val/failure_rate"] == 1
    assert validate(callback, verified(20)).logged["val/failure_rate"] == 0


def test_calibration_of_known_pairs(writer):
    callback = CalibrationValidation(bins=10)
    pairs = verified(30), verified(0, seed=1)
    logged = validate(callback, *pairs).logged
    scores = np.linspace(0.9, 0.1, N)
    squared = np.concatenate([(scores - 1) ** 2, scores**2])
    assert logged["val/brier"] == pytest.approx(squared.mean(), abs=1e-4)
    assert 0 < logged["val/ece"] <= logged["val/mce"] <= 1
    assert callback.metric.result().points == 4 * N  # both images of both pairs
    assert writer.figures == [("validation/reliability", 12)]
    assert validate(callback, verified(30)).logged["val/brier"] == pytest.approx(((scores - 1) ** 2).mean(), abs=1e-4)


def test_pairs_without_any_point(writer):
    nothing = verified(0, n=0)
    assert validate(SuccinctnessValidation(10, 50), nothing).logged["val/succinctness_auc"] == 0
    logged = validate(CalibrationValidation(), nothing).logged
    assert np.isnan(logged["val/ece"])


def test_pictures_of_the_first_pairs(writer, tmp_path):
    validate(MatchPictures(2, 20, tmp_path / "new"), verified(30), verified(0, seed=1), verified(3, seed=2))
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == ["matches_0.png", "matches_1.png"]
    assert [(tag, step, form) for tag, step, _, form in writer.images] == [
        ("matches/0", 12, "HWC"),
        ("matches/1", 12, "HWC"),
    ]
    for index in range(2):
        picture = cv2.imread(str(tmp_path / "new" / f"matches_{index}.png"))
        assert picture.shape == writer.images[index][2]
        assert picture.shape[1] >= 2 * 120
        assert picture.std() > 10


def test_pictures_without_points_or_folder(writer, tmp_path):
    validate(MatchPictures(1, 20, None), verified(0, n=0))
    assert len(writer.images) == 1
    assert list(tmp_path.iterdir()) == []


def test_other_processes_draw_nothing(writer, tmp_path):
    trainer = SimpleNamespace(global_step=1, is_global_zero=False, loggers=[])
    MatchPictures(2, 20, tmp_path).on_validation_batch_end(trainer, Module(), verified(3), None, 0)
    assert writer.images == []
    assert list(tmp_path.iterdir()) == []


def test_a_score_map_holds_the_probabilities_of_every_pixel():
    module, image = Module(), flight(1, size=(50, 40)).frames[0]
    scores = score_map(module.network, image)
    expected = torch.sigmoid(module.network(torch.from_numpy(image)[None, None].float()))[0, 0]
    assert scores.shape == image.shape
    np.testing.assert_allclose(scores, expected.detach().numpy(), rtol=1e-6)


def test_the_writer_is_that_of_tensorboard(tmp_path):
    board, table = TensorBoardLogger(tmp_path / "a"), CSVLogger(tmp_path / "b")
    trainer = SimpleNamespace(is_global_zero=True, loggers=[table, board])
    assert writer_of(trainer) is board.experiment
    assert writer_of(SimpleNamespace(is_global_zero=True, loggers=[table])) is None
    assert writer_of(SimpleNamespace(is_global_zero=True, loggers=[])) is None
    assert writer_of(SimpleNamespace(is_global_zero=False, loggers=[board])) is None
