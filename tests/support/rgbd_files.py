"""RGB-D sequences in both layouts: a camera before a slanted, textured wall, rendered pixel by pixel."""

import functools
import json
from pathlib import Path

import cv2
import numpy as np
from textured_scenes import texture

NORMAL, OFFSET = np.array([0.2, -0.1, 1.0]), 2.0  # the wall: NORMAL . X = OFFSET, in the world (metres)


def pose(index: int) -> np.ndarray:
    """T_world_camera of a frame."""
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.02, -0.03, 0.05]) * index)[0]
    T[:3, 3] = np.array([0.06, -0.03, 0.04]) * index
    return T


def matrix(fx: float, fy: float, cx: float, cy: float) -> np.ndarray:
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def depth_of(xy: np.ndarray, T: np.ndarray, K: np.ndarray, distortion=None) -> tuple[np.ndarray, np.ndarray]:
    """Depth (N,) of the wall at pixels (N, 2), and where on it (N, 3) in the world."""
    coefficients = np.zeros(5) if distortion is None else np.array(distortion)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-10)
    rays = cv2.undistortPoints(xy.reshape(-1, 1, 2).astype(float), K, coefficients, criteria=criteria)[:, 0]
    world = np.column_stack([rays, np.ones(len(rays))]) @ T[:3, :3].T
    depth = (OFFSET - NORMAL @ T[:3, 3]) / (world @ NORMAL)
    return depth, T[:3, 3] + depth[:, None] * world


def render(index: int, K: np.ndarray, size: tuple[int, int], distortion=None) -> tuple[np.ndarray, np.ndarray]:
    """Image (H, W) uint8 and depth (H, W) in metres of a frame."""
    return tuple(map(np.copy, _rendered(index, tuple(map(tuple, K)), size, distortion and tuple(distortion))))


@functools.lru_cache(maxsize=64)
def _rendered(index: int, K: tuple, size: tuple[int, int], distortion: tuple | None) -> tuple[np.ndarray, np.ndarray]:
    xy = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), -1).reshape(-1, 2)
    depth, place = depth_of(xy, pose(index), np.array(K), distortion)
    on_wall = (place[:, :2] * 150 + 400).reshape(size[1], size[0], 2).astype(np.float32)
    image = cv2.remap(_wall(), on_wall[..., 0], on_wall[..., 1], cv2.INTER_LINEAR)
    return image, depth.reshape(size[1], size[0])


@functools.cache
def _wall() -> np.ndarray:
    return texture(800, 800)


def write_image(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image if image.dtype == np.uint16 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))


SIMPLE_K, SIMPLE_SIZE = matrix(150.0, 152.0, 81.0, 58.5), (160, 120)


def write_simple(folder: Path, count: int = 4) -> Path:
    """color/, depth/ in millimetres with a hole, poses.txt, cam.json."""
    for i in range(count):
        image, depth = render(i, SIMPLE_K, SIMPLE_SIZE)
        stored = np.round(depth * 1000).astype(np.uint16)
        stored[10:14, 20:25] = 0
        write_image(folder / "color" / f"color_image_{i:04d}.png", image)
        write_image(folder / "depth" / f"depth_image_{i:04d}.png", stored)
    np.savetxt(folder / "poses.txt", [pose(i)[:3].ravel() for i in range(count)])
    camera = {"h": 120, "w": 160, "depthScale": 0.001, "px": 150.0, "py": 152.0, "u0": 81.0, "v0": 58.5}
    (folder / "cam.json").write_text(json.dumps(camera | {"model": "perspectiveProjWithoutDistortion"}))
    return folder


def write_tum(folder: Path, K: np.ndarray, distortion=None, count: int = 3, size: tuple[int, int] = (640, 480)) -> Path:
    """TUM RGB-D: an image every 0.1 s, its depth 8 ms later, a pose every 10 ms (those of the images among them)."""
    start = 1305031102.1753
    lists: dict[str, list[str]] = {"rgb": [], "depth": [], "groundtruth": []}
    for i in range(count):
        image, depth = render(i, K, size, distortion)
        time = start + 0.1 * i
        for kind, moment, pixels in (
            ("rgb", time, image),
            ("depth", time + 0.008, np.round(depth * 5000).astype(np.uint16)),
        ):
            write_image(folder / kind / f"{moment:.6f}.png", pixels)
            lists[kind].append(f"{moment:.6f} {kind}/{moment:.6f}.png")
        for step in range(-2, 3):  # only the nearest is right
            T = pose(i)
            angle = np.linalg.norm(cv2.Rodrigues(T[:3, :3])[0])
            axis = cv2.Rodrigues(T[:3, :3])[0][:, 0] / max(angle, 1e-12)
            q = [*(axis * np.sin(angle / 2)), np.cos(angle / 2)]
            t = T[:3, 3] + [0.5 * step, 0, 0]
            lists["groundtruth"].append(" ".join(f"{v:.7f}" for v in [time + 0.01 * step + 0.001, *t, *q]))
    for name, lines in lists.items():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.txt").write_text(f"# {name}\n# file: 'made.bag'\n" + "\n".join(lines) + "\n")
    return folder
