"""Succinct interest points: the fewest points that still give k inlier correspondences."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sips_lit.opencv_packages import warn_of_several

if TYPE_CHECKING:
    from sips_lit.baselines.orb import OrbDetector as OrbDetector
    from sips_lit.baselines.shi_tomasi import ShiTomasi as ShiTomasi
    from sips_lit.baselines.sift import SiftDetector as SiftDetector
    from sips_lit.datasets.euroc import euroc as euroc
    from sips_lit.datasets.hpatches import hpatches as hpatches
    from sips_lit.datasets.kitti import kitti as kitti
    from sips_lit.datasets.nerfstudio import nerfstudio as nerfstudio
    from sips_lit.datasets.posed_depth import posed_depth as posed_depth
    from sips_lit.datasets.replica import replica as replica
    from sips_lit.datasets.rgbd import rgbd as rgbd
    from sips_lit.datasets.robotcar import robotcar as robotcar
    from sips_lit.datasets.scannet import scannet as scannet
    from sips_lit.datasets.seven_scenes import seven_scenes as seven_scenes
    from sips_lit.datasets.spec import DatasetSpec as DatasetSpec
    from sips_lit.datasets.spec import any_of as any_of
    from sips_lit.datasets.spec import at_least as at_least
    from sips_lit.datasets.tum_mono import tum_mono as tum_mono
    from sips_lit.datasets.virtual_flight import virtual_flight as virtual_flight
    from sips_lit.describe.orb import OrbDescriptor as OrbDescriptor
    from sips_lit.describe.sift import RootSift as RootSift
    from sips_lit.describe.sift import SiftDescriptor as SiftDescriptor
    from sips_lit.describe.surf import SurfDescriptor as SurfDescriptor
    from sips_lit.detect.base import BaseDetector as BaseDetector
    from sips_lit.detect.budget import Budget as Budget
    from sips_lit.detect.detector import SipsDetector as SipsDetector
    from sips_lit.detect.recalibration import Recalibration as Recalibration
    from sips_lit.errors import BadInputError as BadInputError
    from sips_lit.evaluate.measures import Measures as Measures
    from sips_lit.evaluate.result import MethodResult as MethodResult
    from sips_lit.evaluate.runner import evaluate_detector as evaluate_detector
    from sips_lit.formats.colmap import ColmapDatabase as ColmapDatabase
    from sips_lit.formats.hloc import HlocFeatures as HlocFeatures
    from sips_lit.formats.kornia import SipsFeature as SipsFeature
    from sips_lit.formats.kornia import kornia_lafs as kornia_lafs
    from sips_lit.formats.opencv import opencv_keypoints as opencv_keypoints
    from sips_lit.formats.vismatch import SipsMatcher as SipsMatcher
    from sips_lit.frames.folder import folder as folder
    from sips_lit.frames.images import read_grey as read_grey
    from sips_lit.frames.video import video as video
    from sips_lit.inference.match import match as match
    from sips_lit.inference.matched_pair import MatchedPair as MatchedPair
    from sips_lit.inliers.homography import HomographyInliers as HomographyInliers
    from sips_lit.inliers.independent import IndependentCheck as IndependentCheck
    from sips_lit.inliers.klt import KltInliers as KltInliers
    from sips_lit.inliers.pose_depth import PoseDepthInliers as PoseDepthInliers
    from sips_lit.inliers.stereo_p3p import StereoP3PInliers as StereoP3PInliers
    from sips_lit.inliers.verification import VerifiedPair as VerifiedPair
    from sips_lit.inliers.verification import verify as verify
    from sips_lit.matching.mutual_nearest import distances as distances
    from sips_lit.matching.mutual_nearest import mutual_nearest as mutual_nearest
    from sips_lit.metrics.calibration import Calibration as Calibration
    from sips_lit.metrics.calibration import CalibrationResult as CalibrationResult
    from sips_lit.metrics.pose_auc import PoseAuc as PoseAuc
    from sips_lit.metrics.pose_auc import pose_auc as pose_auc
    from sips_lit.metrics.repeatability import MovedPoints as MovedPoints
    from sips_lit.metrics.repeatability import Repeated as Repeated
    from sips_lit.metrics.repeatability import move_points as move_points
    from sips_lit.metrics.repeatability import repeated as repeated
    from sips_lit.metrics.spread import spread as spread
    from sips_lit.metrics.succinctness import Succinctness as Succinctness
    from sips_lit.metrics.succinctness import SuccinctnessResult as SuccinctnessResult
    from sips_lit.pairs.sampler import read_pair as read_pair
    from sips_lit.types import Camera as Camera
    from sips_lit.types import ColorOrder as ColorOrder
    from sips_lit.types import Descriptor as Descriptor
    from sips_lit.types import Detector as Detector
    from sips_lit.types import Features as Features
    from sips_lit.types import FloatArray as FloatArray
    from sips_lit.types import FramePair as FramePair
    from sips_lit.types import GreyImage as GreyImage
    from sips_lit.types import ImageSequence as ImageSequence
    from sips_lit.types import InlierCheck as InlierCheck
    from sips_lit.types import Inliers as Inliers
    from sips_lit.types import Keypoints as Keypoints
    from sips_lit.types import Matches as Matches
    from sips_lit.types import Norm as Norm
    from sips_lit.types import Reason as Reason
    from sips_lit.types import ScoreKind as ScoreKind
    from sips_lit.types import ViewGeometry as ViewGeometry

    __version__: str

PUBLIC: Final[dict[str, tuple[str, ...]]] = {
    "types": (
        "ImageSequence",
        "FramePair",
        "Camera",
        "ViewGeometry",
        "GreyImage",
        "FloatArray",
        "Keypoints",
        "Features",
        "Norm",
        "Matches",
        "Inliers",
        "Reason",
        "ScoreKind",
        "ColorOrder",
        "Detector",
        "Descriptor",
        "InlierCheck",
    ),
    "errors": ("BadInputError",),
    "frames.images": ("read_grey",),
    "frames.folder": ("folder",),
    "frames.video": ("video",),
    "datasets.kitti": ("kitti",),
    "datasets.euroc": ("euroc",),
    "datasets.tum_mono": ("tum_mono",),
    "datasets.robotcar": ("robotcar",),
    "datasets.rgbd": ("rgbd",),
    "datasets.seven_scenes": ("seven_scenes",),
    "datasets.replica": ("replica",),
    "datasets.scannet": ("scannet",),
    "datasets.nerfstudio": ("nerfstudio",),
    "datasets.posed_depth": ("posed_depth",),
    "datasets.hpatches": ("hpatches",),
    "datasets.virtual_flight": ("virtual_flight",),
    "datasets.spec": ("DatasetSpec", "any_of", "at_least"),
    "pairs.sampler": ("read_pair",),
    "detect.detector": ("SipsDetector",),
    "detect.budget": ("Budget",),
    "detect.recalibration": ("Recalibration",),
    "detect.base": ("BaseDetector",),
    "baselines.sift": ("SiftDetector",),
    "baselines.orb": ("OrbDetector",),
    "baselines.shi_tomasi": ("ShiTomasi",),
    "describe.sift": ("RootSift", "SiftDescriptor"),
    "describe.orb": ("OrbDescriptor",),
    "describe.surf": ("SurfDescriptor",),
    "matching.mutual_nearest": ("distances", "mutual_nearest"),
    "inliers.klt": ("KltInliers",),
    "inliers.stereo_p3p": ("StereoP3PInliers",),
    "inliers.homography": ("HomographyInliers",),
    "inliers.pose_depth": ("PoseDepthInliers",),
    "inliers.independent": ("IndependentCheck",),
    "inliers.verification": ("verify", "VerifiedPair"),
    "metrics.succinctness": ("Succinctness", "SuccinctnessResult"),
    "metrics.calibration": ("Calibration", "CalibrationResult"),
    "metrics.pose_auc": ("PoseAuc", "pose_auc"),
    "metrics.repeatability": ("move_points", "repeated", "MovedPoints", "Repeated"),
    "metrics.spread": ("spread",),
    "evaluate.runner": ("evaluate_detector",),
    "evaluate.measures": ("Measures",),
    "evaluate.result": ("MethodResult",),
    "formats.opencv": ("opencv_keypoints",),
    "formats.kornia": ("kornia_lafs", "SipsFeature"),
    "formats.vismatch": ("SipsMatcher",),
    "formats.hloc": ("HlocFeatures",),
    "formats.colmap": ("ColmapDatabase",),
    "inference.match": ("match",),
    "inference.matched_pair": ("MatchedPair",),
}
"""The public names by their modules, in the order of the data; the imports above are the same list for type checkers."""

warn_of_several()

_MODULES: Final = {name: module for module, names in PUBLIC.items() for name in names}

__all__ = ["__version__", *_MODULES]


if not TYPE_CHECKING:  # a type checker would take any name for one of these

    def __getattr__(name: str) -> Any:
        """Loads a public name when it is first used: torch takes seconds, and the commands set it up before."""
        if name == "__version__":
            from importlib.metadata import version

            value = version("sips_lit")
        elif name in _MODULES:
            from importlib import import_module

            value = getattr(import_module(f"sips_lit.{_MODULES[name]}"), name)
        else:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """The public names, loaded or not, and the modules loaded so far."""
    return sorted({*globals(), *__all__})
