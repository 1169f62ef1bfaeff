import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sips_lit.metrics.trajectory import absolute_error, align, motion_errors, segments_of, trajectory_errors


def motion(rotation, translation) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(np.array(rotation, float))[0], translation
    return T


def walk(seed: int, count: int = 30) -> np.ndarray:
    """A camera that goes about a metre a frame, and turns."""
    generator = np.random.default_rng(seed)
    poses = [motion(generator.normal(size=3), generator.normal(size=3))]
    for _ in range(count - 1):
        poses.append(poses[-1] @ motion(generator.normal(0, 0.1, 3), generator.normal([0.1, 0, 1], 0.1)))
    return np.stack(poses)


def shaken(poses: np.ndarray, seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return np.stack([T @ motion(generator.normal(0, 0.02, 3), generator.normal(0, 0.05, 3)) for T in poses])


ALL = np.ones(30, bool)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_nothing_is_wrong_with_the_truth_in_another_world(seed):
    truth = walk(seed)
    errors = trajectory_errors(motion([1, 2, 3], [4, 5, 6]) @ truth, truth, ALL, 10.0)
    assert errors.ate < 1e-9
    assert max(errors.rpe_translation, errors.rpe_rotation, errors.drift, errors.drift_rotation) < 1e-6
    assert errors.segments > 5


def test_a_mirror_is_no_alignment():
    truth = walk(0)[:, :3, 3]
    assert absolute_error(truth * [1, 1, -1], truth) > 0.5
    assert np.linalg.det(align(truth * [1, 1, -1], truth)[:3, :3]) == pytest.approx(1)


def test_no_other_motion_aligns_better():
    truth, places = walk(1)[:, :3, 3], shaken(walk(1), 2)[:, :3, 3] + [3, 0, 1]
    least, T = absolute_error(places, truth), align(places, truth)
    generator = np.random.default_rng(0)
    for _ in range(50):
        other = motion(generator.normal(0, 0.01, 3), generator.normal(0, 0.01, 3)) @ T
        moved = places @ other[:3, :3].T + other[:3, 3]
        assert np.sqrt(((moved - truth) ** 2).sum(1).mean()) >= least


@pytest.mark.parametrize("seed", range(3))
def test_errors_are_those_of_evo(seed):
    pytest.importorskip("evo", reason="the reference of trajectory errors is in the extra test")
    from evo.core.metrics import APE, RPE, PoseRelation, StatisticsType, Unit
    from evo.core.trajectory import PosePath3D

    truth = walk(seed)
    estimate = motion([0, 1, 2], [1, 2, 3]) @ shaken(truth, seed + 10)
    errors = trajectory_errors(estimate, truth, ALL)
    true, own = PosePath3D(poses_se3=list(truth)), PosePath3D(poses_se3=list(estimate))
    for field, relation in (
        ("translation", PoseRelation.translation_part),
        ("rotation", PoseRelation.rotation_angle_deg),
    ):
        rpe = RPE(relation, 1, Unit.frames)
        rpe.process_data((true, own))
        assert getattr(errors, f"rpe_{field}") == pytest.approx(rpe.get_statistic(StatisticsType.rmse), rel=1e-6)
    own.align(true)
    ape = APE(PoseRelation.translation_part)
    ape.process_data((true, own))
    assert errors.ate == pytest.approx(ape.get_statistic(StatisticsType.rmse), rel=1e-6)


def test_drift_is_the_error_at_the_end_of_segments():
    truth = np.stack([motion([0, 0, 0], [0, 0, float(i)]) for i in range(30)])
    estimate = np.stack([motion([0, 0, 0], [0, 0, 1.02 * i]) for i in range(30)])
    errors = trajectory_errors(estimate, truth, ALL, 10.0)
    assert (errors.segment, errors.segments) == (10, 20)
    assert errors.drift == pytest.approx(2)
    turned = np.stack([motion([0, np.radians(0.1 * i), 0], [0, 0, float(i)]) for i in range(30)])
    assert trajectory_errors(turned, truth, ALL, 10.0).drift_rotation == pytest.approx(0.1)


def test_a_short_path_has_segments_of_half_of_it():
    truth = np.stack([motion([0, 0, 0], [0, 0, float(i)]) for i in range(5)])
    errors = trajectory_errors(truth, truth, np.ones(5, bool))
    assert (errors.segment, errors.segments) == (2, 3)


def test_segments_are_found_as_by_looking():
    path = np.random.default_rng(0).uniform(0, 2, 40).cumsum()
    first, last = segments_of(path, 7.0)
    slow = [(i, next((j for j in range(40) if path[j] >= path[i] + 7), None)) for i in range(40)]
    assert list(zip(first, last, strict=True)) == [pair for pair in slow if pair[1] is not None]


def test_frames_without_truth_are_left_out():
    truth, estimate = walk(3), shaken(walk(3), 1)
    known = ALL.copy()
    known[[4, 9]] = False
    spoilt = estimate.copy()
    spoilt[[4, 9], :3, 3] += 100
    assert trajectory_errors(spoilt, np.where(known[:, None, None], truth, np.nan), known) == trajectory_errors(
        estimate, truth, known
    )


def test_a_camera_that_stands_still_has_no_drift():
    truth = np.stack([np.eye(4)] * 4)
    errors = trajectory_errors(truth, truth, np.ones(4, bool))
    assert (errors.ate, errors.rpe_translation, errors.segments) == (0, 0, 0)
    assert np.isnan(errors.drift)


def test_motions_are_in_the_frame_that_they_start_from():
    truth = np.stack([np.eye(4), motion([0, 1, 0], [0, 0, 1])])
    estimate = motion([0, 0, 1], [5, 0, 0]) @ np.stack([np.eye(4), motion([0, 1.1, 0], [0, 0.3, 1])])
    translation, rotation = motion_errors(estimate, truth, np.array([0]), np.array([1]))
    assert translation[0] == pytest.approx(0.3)
    assert rotation[0] == pytest.approx(np.degrees(0.1))
