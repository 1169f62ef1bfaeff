import torch

from sips_lit.baselines.sift import SiftDetector
from sips_lit.describe.sift import RootSift
from sips_lit.detect.detector import SipsDetector
from sips_lit.detect.score_network import ScoreNetwork
from sips_lit.detect.selection import PointSelector
from sips_lit.evaluate.method import signature_of, weights_digest


def sips(seed: int = 0) -> SipsDetector:
    torch.manual_seed(seed)
    return SipsDetector(ScoreNetwork(3, 4), PointSelector())


def signature(config, descriptor=None, of=None):
    return signature_of(of or SiftDetector(), descriptor, config, {"size": 8.0})


def test_settings_make_a_difference():
    assert signature({"a": 1}) == signature({"a": 1})
    assert signature({"a": 1}) != signature({"a": 2})
    assert signature({"a": 1}, RootSift()) != signature({"a": 1})
    assert signature({}, of=sips()) != signature({}, of=sips(1))


def test_what_a_file_holds_matters_not_where_it_is(tmp_path):
    one, two = tmp_path / "one.pth", tmp_path / "two.pth"
    one.write_bytes(b"weights")
    two.write_bytes(b"weights")
    before = signature({"weights": str(one)})
    assert before == signature({"weights": str(two)})
    two.write_bytes(b"other weights")
    assert before != signature({"weights": str(two)})


def test_files_of_a_folder(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"1")
    before = signature({"features": str(tmp_path)})
    assert before == signature({"features": str(tmp_path)})
    (tmp_path / "b.npz").write_bytes(b"2")
    assert before != signature({"features": str(tmp_path)})


def test_weights():
    assert weights_digest(SiftDetector()) is None
    assert weights_digest(None) is None
    assert weights_digest(sips()) == weights_digest(sips()) != weights_digest(sips(1))
    detector, changed = sips(), sips()
    with torch.no_grad():
        next(changed.network.parameters()).view(-1)[0] += 1e-6
    assert weights_digest(detector) != weights_digest(changed)
    assert weights_digest(detector) is not None


def test_versions_are_part_of_it(monkeypatch):
    before = signature({})
    monkeypatch.setattr(torch, "__version__", "0.0")
    assert before != signature({})
