"""Colour and depth of the wall of `rgbd_files` in the layouts of other data sets."""

import json
from pathlib import Path

import cv2
import numpy as np
from rgbd_files import matrix, pose, render, write_image

from sips_lit.geometry.image_changes import resize_camera
from sips_lit.types import Camera

SIZE = (160, 120)
K = matrix(150.0, 152.0, 81.0, 58.5)
HOLE = np.s_[10:14, 20:25]


def write_pose(file: Path, T: np.ndarray) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(file, T)


def stored_depth(index: int, matrix: np.ndarray, size: tuple[int, int], steps: float, hole: int = 0) -> np.ndarray:
    depth = np.round(render(index, matrix, size)[1] * steps).astype(np.uint16)
    depth[HOLE] = hole
    return depth


def quarter(*intrinsics: float) -> np.ndarray:
    """A camera matrix of 640x480 for 160x120."""
    return resize_camera(Camera(matrix(*intrinsics), (640, 480)), SIZE).matrix


COLOUR_7, DEPTH_7 = quarter(525.0, 525.0, 320.0, 240.0), quarter(585.0, 585.0, 320.0, 240.0)


def write_seven_scenes(folder: Path, count: int = 4) -> Path:
    for i in range(count):
        write_image(folder / f"frame-{i:06d}.color.png", render(i, COLOUR_7, SIZE)[0])
        write_image(folder / f"frame-{i:06d}.depth.png", stored_depth(i, DEPTH_7, SIZE, 1000, 65535))
        write_pose(folder / f"frame-{i:06d}.pose.txt", pose(i))
    return folder


def write_replica(folder: Path, count: int = 4, beside: bool = False) -> Path:
    for i in range(count):
        write_image(folder / "results" / f"frame{i:06d}.jpg", render(i, K, SIZE)[0])
        write_image(folder / "results" / f"depth{i:06d}.png", stored_depth(i, K, SIZE, 6553.5))
    np.savetxt(folder / "traj.txt", [pose(i).ravel() for i in range(count)])
    camera = {"w": 160, "h": 120, "fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], "scale": 6553.5}
    ((folder if beside else folder.parent) / "cam_params.json").write_text(json.dumps({"camera": camera}))
    return folder


SCANNET_SIZE, SCANNET_K = (82, 64), matrix(76.0, 77.0, 40.0, 32.5)  # of the depth maps


def write_scannet(folder: Path, count: int = 4) -> Path:
    for i in range(count):
        write_image(folder / "color" / f"{i}.jpg", render(i, K, SIZE)[0])
        write_image(folder / "depth" / f"{i}.png", stored_depth(i, SCANNET_K, SCANNET_SIZE, 1000))
        write_pose(folder / "pose" / f"{i}.txt", pose(i))
    for name, own in (("color", K), ("depth", SCANNET_K)):
        whole = np.eye(4)
        whole[:3, :3] = own
        write_pose(folder / "intrinsic" / f"intrinsic_{name}.txt", whole)
    return folder


def write_nerfstudio(folder: Path, count: int = 4, lens: dict | None = None, depth: bool = True) -> Path:
    """Frames in an order of no meaning; ``lens`` has the keys of a distortion, whose images and depth are rendered."""
    frames = []
    distortion = None if lens is None else [lens.get(key, 0.0) for key in ("k1", "k2", "p1", "p2", "k3")]
    for i in range(count):
        image, metres = render(i, K, SIZE, distortion)
        write_image(folder / "images" / f"frame_{i + 1:05d}.png", image)
        write_image(folder / "images_2" / f"frame_{i + 1:05d}.png", cv2.resize(image, (80, 60)))
        write_image(folder / "masks" / f"frame_{i + 1:05d}.png", np.full_like(image, 255))
        frame = {
            "file_path": f"images/frame_{i + 1:05d}.png",
            "transform_matrix": (pose(i) @ np.diag([1, -1, -1, 1])).tolist(),
        }
        if depth:
            write_image(folder / "depths" / f"frame_{i + 1:05d}.png", np.round(metres * 1000).astype(np.uint16))
            frame["depth_file_path"] = f"depths/frame_{i + 1:05d}.png"
        frames.insert(0, frame)
    camera = {"w": 160, "h": 120, "fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2] + 0.5, "cy": K[1, 2] + 0.5}
    content = {"camera_model": "OPENCV", **camera, **(lens or {}), "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder


def change(file: Path, **keys: object) -> None:
    """Other values for keys of a JSON file."""
    file.write_text(json.dumps(json.loads(file.read_text()) | keys))
