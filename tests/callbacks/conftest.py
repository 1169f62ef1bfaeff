import pytest
from validation_pairs import Writer


@pytest.fixture
def writer(monkeypatch: pytest.MonkeyPatch) -> Writer:
    """The writer that callbacks find."""
    writer = Writer()
    for name in ("succinctness", "calibration", "covariance", "rendering"):
        monkeypatch.setattr(f"sips_lit.callbacks.{name}.writer_of", lambda trainer: writer)
    return writer
