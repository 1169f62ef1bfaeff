from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import torch
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sips_lit.callbacks.cards import card_of
from sips_lit.callbacks.tensorboard import TensorBoard, show, writer_of
from sips_lit.render.figure import new_figure


def test_the_writer_is_that_of_tensorboard(tmp_path):
    board, table = TensorBoardLogger(tmp_path / "a"), CSVLogger(tmp_path / "b")
    trainer = SimpleNamespace(is_global_zero=True, loggers=[table, board])
    assert writer_of(trainer) is board.experiment
    assert writer_of(SimpleNamespace(is_global_zero=True, loggers=[table])) is None
    assert writer_of(SimpleNamespace(is_global_zero=True, loggers=[])) is None
    assert writer_of(SimpleNamespace(is_global_zero=False, loggers=[board])) is None


def reloaded(folder):
    return EventAccumulator(str(folder), {"images": 0}).Reload()


def test_numbers_go_to_their_cards_without_the_epoch(tmp_path):
    board = TensorBoard(tmp_path, name="", version="")
    for step in range(2):
        board.log_metrics({"val/ece": 0.5 - step / 4, "own/number": torch.tensor(3.0), "epoch": 0}, step)
    board.finalize("success")
    board.log_metrics({"val/ece": 0.125}, 2)  # after the end of a fit, too
    board.experiment.flush()
    events = reloaded(tmp_path)
    assert set(events.Tags()["scalars"]) == {"1_val/3_ece", "own/number"}
    assert [(e.step, e.value) for e in events.Scalars("1_val/3_ece")] == [(0, 0.5), (1, 0.25), (2, 0.125)]
    assert events.summary_metadata["1_val/3_ece"].summary_description == card_of("val/ece").text


@pytest.mark.parametrize("make", [TensorBoard, TensorBoardLogger])
def test_pictures_and_figures_are_shown_as_they_are(tmp_path, make):
    board = make(tmp_path, name="", version="")
    trainer = SimpleNamespace(is_global_zero=True, loggers=[board], global_step=7)
    picture = np.random.default_rng(0).integers(0, 256, (20, 30, 3), np.uint8)
    show(trainer, "val/pair_0", picture)
    show(trainer, "val/curve", new_figure(2, 1))
    show(SimpleNamespace(is_global_zero=False, loggers=[board], global_step=7), "val/pair_1", picture)
    board.experiment.flush()
    events = reloaded(tmp_path)
    assert set(events.Tags()["images"]) == {"1_val/pair_0", "1_val/curve"}
    (shown,) = events.Images("1_val/pair_0")
    assert shown.step == 7
    stored = cv2.imdecode(np.frombuffer(shown.encoded_image_string, np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(stored[:, :, ::-1], picture)
    assert (events.Images("1_val/curve")[0].width, events.Images("1_val/curve")[0].height) == (300, 150)
    assert events.summary_metadata["1_val/pair_0"].summary_description == card_of("val/pair_0").text
