from types import SimpleNamespace

from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger

from sips_lit.callbacks.tensorboard import writer_of


def test_the_writer_is_that_of_tensorboard(tmp_path):
    board, table = TensorBoardLogger(tmp_path / "a"), CSVLogger(tmp_path / "b")
    trainer = SimpleNamespace(is_global_zero=True, loggers=[table, board])
    assert writer_of(trainer) is board.experiment
    assert writer_of(SimpleNamespace(is_global_zero=True, loggers=[table])) is None
    assert writer_of(SimpleNamespace(is_global_zero=True, loggers=[])) is None
    assert writer_of(SimpleNamespace(is_global_zero=False, loggers=[board])) is None
