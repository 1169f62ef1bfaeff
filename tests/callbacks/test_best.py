from types import SimpleNamespace

from sips_lit.callbacks.best import BestValidation


class Logger:
    """Keeps what is logged."""

    def __init__(self) -> None:
        self.logged = []

    def log_metrics(self, values, step) -> None:
        self.logged.append((step, values))


def validate(callback, trainer, step, **numbers) -> None:
    trainer.global_step = step
    callback.on_validation_start(trainer, None)
    trainer.callback_metrics.update({f"val/{name}": value for name, value in numbers.items()})
    callback.on_validation_end(trainer, None)


def new_trainer():
    return SimpleNamespace(loggers=[Logger()], callback_metrics={}, global_step=0)


def test_the_numbers_are_those_of_the_validation_with_the_highest_auc():
    trainer, callback = new_trainer(), BestValidation()
    callback.on_train_start(trainer, None)
    validate(callback, trainer, 1, succinctness_auc=0.3, n_at_80=60, ece=0.1)
    validate(callback, trainer, 2, succinctness_auc=0.2, n_at_80=50, ece=0.05)
    validate(callback, trainer, 3, succinctness_auc=0.4, ece=0.2)  # 80 % not reached: no number of another validation
    assert trainer.loggers[0].logged == [
        (1, {"best/succinctness_auc": 0.3, "best/n_at_80": 60, "best/ece": 0.1}),
        (3, {"best/succinctness_auc": 0.4, "best/ece": 0.2}),
    ]


def test_a_run_that_goes_on_has_the_best_so_far():
    first, second = BestValidation(), BestValidation()
    validate(first, new_trainer(), 1, succinctness_auc=0.5, ece=0.1)
    second.load_state_dict(first.state_dict())
    trainer = new_trainer()
    second.on_train_start(trainer, None)
    validate(second, trainer, 2, succinctness_auc=0.4, ece=0.1)
    assert trainer.loggers[0].logged == [(0, {"best/succinctness_auc": 0.5, "best/ece": 0.1})]


def test_a_validation_without_numbers_is_not_the_best():
    trainer, callback = new_trainer(), BestValidation()
    validate(callback, trainer, 1)
    validate(callback, trainer, 2, succinctness_auc=float("nan"))
    assert trainer.loggers[0].logged == []
