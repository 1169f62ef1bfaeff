"""HPatches full sequences (Balntas et al., CVPR 2017): six photographs of a planar scene each, with homographies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from sips_lit.datasets.layout import expect, files_fingerprint, read_table, wrong_layout
from sips_lit.datasets.spec import DatasetSpec, any_of
from sips_lit.datasets.split_lists import split_names
from sips_lit.errors import BadInputError
from sips_lit.files import safe_name
from sips_lit.frames.image_cache import image_cache
from sips_lit.frames.image_size import image_size
from sips_lit.frames.images import check_max_side, read_grey, shrunk_size
from sips_lit.frames.listing import list_folders
from sips_lit.geometry.image_changes import resize_map
from sips_lit.geometry.projection import apply_homography
from sips_lit.types import FloatArray, GreyImage, ImageSequence

LAYOUT = (
    "HPatches (hpatches-sequences-release) has folders v_... and i_..., each with 1.ppm to 6.ppm and the homographies "
    "H_1_2 to H_1_6"
)
IMAGES = range(1, 7)
SUFFIXES = (".ppm", ".png", ".jpg", ".jpeg")  # the first that is there: others are copies of the published .ppm
PREFIX = {"viewpoint": "v_", "illumination": "i_"}
TYPICAL = (800, 640)  # (W, H) of an image
LARGEST_CONDITION = 1e6  # of a homography between unit squares


@dataclass(frozen=True, slots=True)
class ResizedImage:
    """One image as it is read: ``file``, resized from ``stored`` to ``size`` (both (W, H), None if it can't be read).

    ``from_first`` (3, 3) maps pixels of image 1, as stored, to pixels of this one, resized.
    """

    name: str
    file: Path
    stored: tuple[int, int] | None
    size: tuple[int, int] | None
    from_first: FloatArray


class HPatchesSequence(ImageSequence):
    """The images 1 to 6 of a scene, then resized copies of them; sizes differ and the order means nothing.

    ``max_side``: images whose longer side exceeds it (pixels) are shrunk; ``synthetic_scales``: for each factor a copy of
    every image, relative to that. Homographies follow exactly. What is resized is kept in ``cache_dir``, if given.
    Raises BadInputError for a missing file, and a homography that can't be one; a damaged image is reported when it is
    asked for.
    """

    temporal = False

    def __init__(
        self, folder: Path, max_side: int | None, synthetic_scales: Sequence[float], cache_dir: str | Path | None
    ) -> None:
        self.name = safe_name(folder.resolve().name)
        files = [_image(folder, number) for number in IMAGES]
        homographies = [expect(folder / f"H_1_{number}", LAYOUT) for number in IMAGES[1:]]
        self.fingerprint = files_fingerprint([*files, *homographies], max_side, tuple(synthetic_scales))
        self._kept = image_cache(cache_dir, self.name, self.fingerprint)
        stored = [_stored_size(file) for file in files]
        planes = [np.eye(3)] + [
            _read_homography(file, stored[0], size) for file, size in zip(homographies, stored[1:], strict=True)
        ]
        self.images = [
            _resized_image(f"{self.name}_{number}", file, size, plane, max_side, scale)
            for scale in (None, *synthetic_scales)
            for number, file, size, plane in zip(IMAGES, files, stored, planes, strict=True)
        ]

    def __len__(self) -> int:
        return len(self.images)

    def frame(self, index: int) -> GreyImage:
        """Image ``index``, resized. Raises BadInputError when it can't be read."""
        image = self.images[index]
        size = image.size
        if size is None or size == image.stored:  # without a size it can't be read, and that is what reading says
            return read_grey(image.file)
        return self._kept(image.name, lambda: _read_resized(image.file, size))

    def frame_name(self, index: int) -> str:
        """Such as v_churchill_1, and v_churchill_1_x0.5 for a copy."""
        return self.images[index].name

    def homography(self, index0: int, index1: int) -> NDArray[np.float64]:
        """(3, 3) float64 from pixels of one image to pixels of another, if both can be read."""
        H: NDArray[np.float64] = self.images[index1].from_first @ np.linalg.inv(self.images[index0].from_first)
        return H


def _read_resized(file: Path, size: tuple[int, int]) -> GreyImage:
    image = read_grey(file)
    method = cv2.INTER_AREA if max(size) < max(image.shape) else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(image, size, interpolation=method), np.uint8)


def hpatches(
    path: str | Path,
    split: str | None = None,
    kind: Literal["viewpoint", "illumination"] | None = None,
    max_side: int | None = 1000,
    sequences: Sequence[str] | None = None,
    synthetic_scales: Sequence[float] = (),
    cache_dir: str | Path | None = None,
) -> list[ImageSequence]:
    """The sequences of a folder of ``v_...`` and ``i_...``, or the one that ``path`` is.

    ``split``: ``train`` or ``test`` of split "a" of its authors; ``kind``: only these; ``sequences``: only these names;
    the rest as for `HPatchesSequence`. Raises BadInputError for a folder that is not HPatches, and one that lacks a
    sequence of the split or of the names.
    """
    check_max_side(max_side)
    scales = list(synthetic_scales)
    if any(not 0.1 <= scale <= 4 or scale == 1 for scale in scales) or len(set(scales)) < len(scales):
        raise BadInputError(
            f"data.synthetic_scales is {scales}: give different factors from 0.1 to 4 without 1, such as [0.5, 0.71]"
        )
    if kind is not None and kind not in PREFIX:
        raise BadInputError(f"data.kind is {kind}: it must be viewpoint, illumination, or null for both")
    root = Path(path)
    found = _find(root)
    wanted = list(sequences) if sequences is not None else sorted(found)
    if split is not None:
        listed = split_names("hpatches", split)
        wanted = sorted(listed) if sequences is None else [name for name in wanted if name in listed]
    wanted = [name for name in wanted if kind is None or name.startswith(PREFIX[kind])]
    missing = [name for name in wanted if name not in found]
    if missing:
        raise BadInputError(
            f"{root} lacks {len(missing)} of the {len(wanted)} HPatches sequences that are asked for, such as "
            f"{missing[0]}: download them, or name in data.sequences those that you want"
        )
    if not wanted:
        raise BadInputError(
            f"of the {len(found)} sequences in {root} none is left: check data.split, data.kind and data.sequences"
        )
    return [HPatchesSequence(found[name], max_side, synthetic_scales, cache_dir) for name in wanted]


def _find(root: Path) -> dict[str, Path]:
    """The folders of sequences by name. A folder with an image 1 is a sequence itself, whatever it is called."""
    if any((root / f"1{suffix}").is_file() for suffix in SUFFIXES):
        return {root.resolve().name: root}
    folders = list_folders(root) if root.is_dir() else []
    found = {p.name: p for p in folders if p.name.startswith(tuple(PREFIX.values()))}
    if not found:
        raise wrong_layout(f"HPatches sequence {root / 'v_*'}", root, LAYOUT)
    return found


def _image(folder: Path, number: int) -> Path:
    for suffix in SUFFIXES:
        if (folder / f"{number}{suffix}").is_file():
            return folder / f"{number}{suffix}"
    raise wrong_layout(f"{folder / str(number)}.ppm", folder, LAYOUT)


def _stored_size(file: Path) -> tuple[int, int] | None:
    """The size (W, H) of an image; None if it is so damaged that it tells none."""
    try:
        return image_size(file)
    except BadInputError:
        return None


def _resized_image(
    name: str, file: Path, stored: tuple[int, int] | None, plane: FloatArray, max_side: int | None, scale: float | None
) -> ResizedImage:
    name = name if scale is None else f"{name}_x{scale:g}"
    if stored is None:
        return ResizedImage(name, file, None, None, plane)
    size = shrunk_size(stored, max_side)
    if scale is not None:
        size = max(1, round(size[0] * scale)), max(1, round(size[1] * scale))
    return ResizedImage(name, file, stored, size, resize_map(stored, size) @ plane)


def _read_homography(file: Path, size0: tuple[int, int] | None, size1: tuple[int, int] | None) -> NDArray[np.float64]:
    """Image 1 to image i, as stored, with pixel centres at integers. Raises BadInputError for one that can't be true.

    Sizes are (W, H); where one is None, that image can't be read, and whether the homography leads into it is not checked.
    """
    H = read_table(file, 3)
    if H.shape != (3, 3):
        raise BadInputError(f"{file} has {len(H)} rows of numbers: a homography has 3 rows of 3")
    to_unit = [np.diag([1 / size[0], 1 / size[1], 1]) for size in (size0 or TYPICAL, size1 or TYPICAL)]
    if not np.linalg.cond(to_unit[1] @ H @ np.linalg.inv(to_unit[0])) < LARGEST_CONDITION:
        raise BadInputError(f"the homography in {file} is singular: download the file again")
    if size0 and size1 and not (_sees(H, size0, size1) or _sees(np.linalg.inv(H), size1, size0)):
        raise BadInputError(
            f"the homography in {file} maps nothing of image 1 into the other image: the file is damaged or of another "
            "sequence; download it again"
        )
    return H


def _sees(H: FloatArray, size0: tuple[int, int], size1: tuple[int, int]) -> bool:
    """Whether any point of a coarse grid over image 0 is in image 1; sizes are (W, H)."""
    x, y = (np.linspace(0, side - 1, 16) for side in size0)
    moved = apply_homography(H, np.stack(np.meshgrid(x, y), -1).reshape(-1, 2))
    with np.errstate(invalid="ignore"):
        return bool(((moved >= 0) & (moved <= np.array(size1) - 1)).all(1).any())


def _one_homography_or_image(folder: Path) -> str | None:
    """The sign: homographies; or, in a folder named like a sequence, its first image or the patches (another download)."""
    named = folder.name.startswith(tuple(PREFIX.values()))
    return any_of("H_1_[2-6]", *(("1.ppm", "e1.png") if named else ()))(folder)


SPEC = DatasetSpec(
    kind="hpatches",
    title="HPatches sequences",
    loader=hpatches,
    signs=(_one_homography_or_image,),
    family=True,
    has=("homographies",),
    inliers=("homography",),  # images in no order can't be tracked
    keys=("datamodule.val_fraction=0.34",),  # 15% of six images are none
)
