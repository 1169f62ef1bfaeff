"""A stereo camera that moves before textured boards, made for the tests: images, depth and poses are all known."""

from dataclasses import dataclass

import cv2
import numpy as np
from textured_scenes import texture

from sips_lit.types import Camera, GreyImage, ImageSequence

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
