import numpy as np
import pytest

Shown = list[tuple[str, int, np.ndarray]]


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> Shown:
    """What callbacks show: name, step, picture or figure."""
    shown: Shown = []
    for name in ("succinctness", "calibration", "covariance", "rendering"):
        target = f"sips_lit.callbacks.{name}.show"
        monkeypatch.setattr(target, lambda trainer, tag, picture: shown.append((tag, trainer.global_step, picture)))
    return shown
