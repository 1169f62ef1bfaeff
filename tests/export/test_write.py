import pytest
from exported_models import model_of

import sips_lit.export.write
from sips_lit.errors import BadInputError
from sips_lit.export.parity import Difference
from sips_lit.export.write import require_packages, write_model


@pytest.fixture
def quick(monkeypatch):
    """Building gives no model at all."""
    monkeypatch.setattr(sips_lit.export.write, "built", lambda *_: ({".xml": b"graph", ".bin": b"numbers"}, None))
    monkeypatch.setattr(sips_lit.export.write, "difference_of", lambda *_: Difference(0))


def test_both_files_are_written(quick, tmp_path):
    written, difference = write_model(model_of("map"), "openvino", tmp_path / "a.xml")
    assert written == [tmp_path / "a.xml", tmp_path / "a.bin"]
    assert [path.read_bytes() for path in written] == [b"graph", b"numbers"]
    assert difference == Difference(0)


@pytest.mark.parametrize("difference", [Difference(2e-4), Difference(float("nan")), Difference(0, 100, 2)])
def test_nothing_is_written_where_the_two_disagree(quick, tmp_path, monkeypatch, difference):
    monkeypatch.setattr(sips_lit.export.write, "difference_of", lambda *_: difference)
    with pytest.raises(RuntimeError, match="nothing was written"):
        write_model(model_of("map"), "openvino", tmp_path / "a.xml")
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_written(quick, tmp_path):
    (tmp_path / "a.xml").write_text("old")
    (tmp_path / "a.bin").mkdir()
    with pytest.raises(BadInputError, match=r"cannot write .*a\.bin"):
        write_model(model_of("map"), "openvino", tmp_path / "a.xml")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.bin", "a.xml"]
    with pytest.raises(BadInputError, match="cannot write"):
        write_model(model_of("map"), "openvino", tmp_path / "gone" / "a.xml")


@pytest.mark.parametrize(("kind", "package"), [("onnx", "onnxscript"), ("openvino", "openvino")])
def test_missing_packages_are_named(monkeypatch, kind, package):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == package else name)
    with pytest.raises(BadInputError, match=rf"needs {package}: install them with pip install 'sips_lit\[export\]'"):
        require_packages(kind)
    require_packages("torch_export")
