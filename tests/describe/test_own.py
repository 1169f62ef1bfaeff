from omegaconf import OmegaConf

from sips_lit.cli.app import build
from sips_lit.cli.conf_files import CONF_DIR
from sips_lit.describe.own import own


def test_the_detectors_own_descriptor_is_no_descriptor():
    assert own() is None
    assert build(OmegaConf.load(CONF_DIR / "descriptor" / "own.yaml")) is None
