"""A stereo camera that moves before textured boards, made for the tests: images, depth and poses are all known."""

from dataclasses import dataclass

import cv2
import numpy as np
from textured_scenes import texture

from sips_lit.types import Camera, FramePair, GreyImage, ImageSequence, ViewGeometry

SIZE = (320, 240)
FOCAL, BASELINE = 250.0, 0.4
CAMERA = Camera(np.array([[FOCAL, 0, 160.0], [0, FOCAL, 120.0], [0, 0, 1]]), SIZE)


@dataclass(frozen=True)
class Board:
    """A textured rectangle: texture pixel (a, b) is at ``corner + pitch * (a * across + b * down)``, metres."""

    picture: GreyImage
    corner: np.ndarray
    across: np.ndarray
    down: np.ndarray
    pitch: float

    def homography(self, T_camera_world: np.ndarray) -> np.ndarray:
        """From texture pixels to image pixels."""
        R, t = T_camera_world[:3, :3], T_camera_world[:3, 3]
        columns = [R @ self.across * self.pitch, R @ self.down * self.pitch, R @ self.corner + t]
        return CAMERA.matrix @ np.column_stack(columns)

    def depth(self, T_camera_world: np.ndarray) -> np.ndarray:
        """Depth (H, W) of the board's whole plane."""
        R, t = T_camera_world[:3, :3], T_camera_world[:3, 3]
        normal, point = R @ np.cross(self.across, self.down), R @ self.corner + t
        x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
        rays = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(CAMERA.matrix).T
        return (normal @ point) / (rays @ normal)


def boards() -> list[Board]:
    """A wall 9 m away, a board 3 m away on the left, and one on the right that recedes from 4 m to 6 m; far ones first."""
    x, y, z = np.eye(3)
    slant = (0.8 * x + 0.6 * z) / np.linalg.norm([0.8, 0.6])
    return [
        Board(texture(500, 700, 1), np.array([-12.6, -9.0, 9.0]), x, y, 0.036),
        Board(texture(140, 180, 2), np.array([0.4, -1.2, 4.0]), slant, y, 0.018),
        Board(texture(150, 90, 3), np.array([-1.6, -0.9, 3.0]), x, y, 0.012),
    ]


def render(T_camera_world: np.ndarray) -> tuple[GreyImage, np.ndarray]:
    """Image and depth map (H, W) float32 of a camera."""
    image, depth = np.zeros(SIZE[::-1], np.uint8), np.full(SIZE[::-1], np.nan, np.float32)
    for board in boards():
        H = board.homography(T_camera_world)
        seen = cv2.warpPerspective(np.ones_like(board.picture), H, SIZE, flags=cv2.INTER_NEAREST) > 0
        image[seen] = cv2.warpPerspective(board.picture, H, SIZE, flags=cv2.INTER_CUBIC)[seen]
        depth[seen] = board.depth(T_camera_world)[seen]
    return image, depth


class StereoScene(ImageSequence):
    """Frames of the moving stereo camera; ``tells`` says where depth comes from: stereo, depth (maps) or nothing."""

    def __init__(self, count: int = 4, tells: str = "stereo", name: str = "boards") -> None:
        self.name, self.tells = name, tells
        self.fingerprint = f"{name} {count} {tells}"
        self.poses = [pose(0.12 * i, -0.04 * i, 0.25 * i, 0.015 * i) for i in range(count)]
        rendered = [render(np.linalg.inv(T)) for T in self.poses]
        self.frames, self.depths = [image for image, _ in rendered], [depth for _, depth in rendered]
        self.rights = [render(np.linalg.inv(T @ pose(BASELINE, 0, 0, 0)))[0] for T in self.poses]

    def __len__(self) -> int:
        return len(self.frames)

    def frame(self, index: int) -> GreyImage:
        return self.frames[index]

    def camera(self, index: int) -> Camera | None:
        return CAMERA

    def pose(self, index: int) -> np.ndarray | None:
        return self.poses[index]

    def depth(self, index: int) -> np.ndarray | None:
        return self.depths[index] if self.tells == "depth" else None

    def right(self, index: int) -> GreyImage | None:
        return self.rights[index] if self.tells == "stereo" else None

    def baseline(self) -> float | None:
        return BASELINE if self.tells == "stereo" else None


def pose(x: float, y: float, z: float, yaw: float) -> np.ndarray:
    """4x4: a place and a turn about the vertical axis (radians)."""
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0, yaw, 0.0]))[0]
    T[:3, 3] = x, y, z
    return T


LOW = (320, 180)
SQUEEZE = LOW[1] / SIZE[1]
LOW_CAMERA = Camera(np.array([[FOCAL, 0, 160.0], [0, FOCAL * 0.75, 120.5 * 0.75 - 0.5], [0, 0, 1]]), LOW)


def squeezed(pair: FramePair) -> FramePair:
    """A pair of the scene in images three quarters as high: the focal lengths of x and y differ."""

    def squeeze(image: np.ndarray | None, how: int = cv2.INTER_AREA) -> np.ndarray | None:
        return None if image is None else cv2.resize(image, LOW, interpolation=how)

    g, frames = pair.geometry, tuple(squeeze(frame) for frame in pair.frames)
    assert g is not None
    depth0, depth1 = (squeeze(depth, cv2.INTER_NEAREST_EXACT) for depth in (g.depth0, g.depth1))
    partners = squeeze(g.right0), squeeze(g.right1)
    geometry = ViewGeometry(g.T_1_0, LOW_CAMERA, LOW_CAMERA, depth0, depth1, *partners, g.baseline)
    return FramePair(pair.name, pair.index0, pair.index1, frames, frames[0], frames[-1], geometry=geometry)


def squeezed_points(xy: np.ndarray) -> np.ndarray:
    """Where points (N, 2) are then."""
    return np.stack([xy[:, 0], (xy[:, 1] + 0.5) * SQUEEZE - 0.5], 1)
