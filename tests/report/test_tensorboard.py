from dataclasses import replace

from golden_results import golden

from sips_lit.report.columns import columns_of
from sips_lit.report.tensorboard import log_numbers


class Writer:
    """Keeps what it is given."""

    def __init__(self):
        self.scalars = {}

    def add_scalar(self, tag, value):
        assert tag not in self.scalars
        self.scalars[tag] = value


def test_each_number_has_its_tag():
    result, writer = golden(), Writer()
    log_numbers(writer, [result, replace(result, key="other", detectors=result.detectors[1:])])
    tags = {"/".join(tag.split("/")[1:3]) for tag in writer.scalars}
    assert tags == {"kitti/alpha", "kitti/beta", "other/beta"}
    for column in columns_of(result.detectors):
        value = column.value(result.detectors[0])
        assert writer.scalars[f"benchmark/kitti/alpha/{column.key}"] == value


def test_what_is_undefined_or_infinite_is_left_out():
    result, writer = golden(), Writer()
    failed = replace(result.detectors[0], n_k=result.detectors[0].n_k + float("inf"))
    log_numbers(writer, [replace(result, detectors=(failed, result.detectors[1]))])
    assert "benchmark/kitti/alpha/n_at_80" not in writer.scalars  # never
    assert "benchmark/kitti/beta/ece_30" not in writer.scalars  # no probabilities
    assert writer.scalars["benchmark/kitti/alpha/auc"] == 0
    log_numbers(empty := Writer(), [])
    assert empty.scalars == {}
