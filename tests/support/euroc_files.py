"""Tiny sequences in the published layout of EuRoC."""

from pathlib import Path

import cv2
import numpy as np
from textured_scenes import texture

from sips_lit.geometry.rectify import LensCamera

START = 1403715273262142976
STEP = 50_000_000  # nanoseconds between images
SIZE = (94, 60)
LENSES = [
    LensCamera(np.array([[57.3, 0, 45.9], [0, 57.1, 31.0], [0, 0, 1]]), np.array([-0.28, 0.07, 2e-4, 2e-5]), SIZE),
    LensCamera(np.array([[57.2, 0, 47.5], [0, 57.0, 31.9], [0, 0, 1]]), np.array([-0.28, 0.07, -1e-4, -4e-5]), SIZE),
]


def rigid(rotation: tuple[float, ...], translation: tuple[float, ...]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array(rotation))[0]
    T[:3, 3] = translation
    return T


T_BODY_CAMERA = [rigid((0.02, -0.01, 1.55), (-0.02, -0.06, 0.01)), rigid((0.03, -0.01, 1.55), (-0.02, 0.05, 0.01))]


def body_pose(time: float) -> np.ndarray:
    """Seconds since the start."""
    return rigid((0.3 * time, -0.2, 0.5 * time), (1 + time, 2 - 0.5 * time, 0.3))


def quaternion(R: np.ndarray) -> np.ndarray:
    """w, x, y, z from the axis and the angle."""
    axis = cv2.Rodrigues(R)[0][:, 0]
    angle = np.linalg.norm(axis)
    return np.array([np.cos(angle / 2), *(axis / angle * np.sin(angle / 2))])


SENSOR = """%YAML:1.0
# General sensor definitions.
sensor_type: camera

T_BS:
  cols: 4
  rows: 4
  data: [{T}]

rate_hz: 20
resolution: [{size}]
camera_model: pinhole
intrinsics: [{intrinsics}] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [{distortion}]
"""


def comma(numbers) -> str:
    return ", ".join(repr(float(number)) for number in numbers)


def make_euroc(sequence: Path, cameras: int = 2, frames: int = 4, columns: int = 17) -> Path:
    """``sequence/mav0`` with lines that end as in the published files; returns it."""
    mav0 = sequence / "mav0"
    for camera in range(cameras):
        folder, lens = mav0 / f"cam{camera}", LENSES[camera]
        (folder / "data").mkdir(parents=True)
        K = lens.matrix
        (folder / "sensor.yaml").write_text(
            SENSOR.format(
                T=comma(T_BODY_CAMERA[camera].ravel()),
                size="{}, {}".format(*lens.size),
                intrinsics=comma((K[0, 0], K[1, 1], K[0, 2], K[1, 2])),
                distortion=comma(lens.distortion),
            )
        )
        times = [START + i * STEP for i in range(frames)]
        for i, time in enumerate(times):
            assert cv2.imwrite(str(folder / "data" / f"{time}.png"), texture(60, 94, 10 * camera + i))
        rows = "".join(f"{time},{time}.png\r\n" for time in times)
        (folder / "data.csv").write_bytes(f"#timestamp [ns],filename\r\n{rows}".encode())
    truth = mav0 / "state_groundtruth_estimate0"
    truth.mkdir(parents=True)
    rows = "#timestamp, p_RS_R_x [m], ...\r\n"
    for time in range(START, START + frames * STEP, 5_000_000):
        T = body_pose((time - START) * 1e-9)
        row = [*T[:3, 3], *quaternion(T[:3, :3]), *[0.0] * 9][: columns - 1]
        rows += f"{time},{','.join(f'{v:.9f}' for v in row)}\r\n"
    (truth / "data.csv").write_bytes(rows.encode())
    return mav0


def as_tum_vi(mav0: Path) -> None:
    """16-bit images, equidistant lenses calibrated in dso/camchain.yaml, poses of the body in mocap0."""
    chain = []
    for camera, lens in enumerate(LENSES):
        (mav0 / f"cam{camera}" / "sensor.yaml").unlink()
        K = lens.matrix
        T = np.linalg.inv(T_BODY_CAMERA[camera])
        chain.append(
            f"cam{camera}:\n  T_cam_imu:\n"
            + "".join(f"  - {row.tolist()}\n" for row in T)
            + "  camera_model: pinhole\n"
            f"  distortion_coeffs: [0.0035, 0.0007, -0.002, 0.0002]\n  distortion_model: equidistant\n"
            f"  intrinsics: {[float(v) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2])]}\n  resolution: [94, 60]\n"
        )
        for file in (mav0 / f"cam{camera}" / "data").iterdir():
            assert cv2.imwrite(str(file), cv2.imread(str(file), cv2.IMREAD_GRAYSCALE).astype(np.uint16) * 40 + 900)
    (mav0.parent / "dso").mkdir()
    (mav0.parent / "dso" / "camchain.yaml").write_text("".join(chain))
    (mav0 / "state_groundtruth_estimate0").rename(mav0 / "mocap0")
