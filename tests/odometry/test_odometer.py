import numpy as np
import pytest
from seen_points import only, pose, seen, world

from sips_lit.errors import BadInputError
from sips_lit.geometry.pose import rotation_error, translation_error
from sips_lit.odometry.odometer import Odometer, OdometrySettings, State

SETTINGS = OdometrySettings(iterations=100)


def follow(frames, settings=SETTINGS, seed=0, start=None):
    odometer = Odometer(settings, seed, start)
    return [odometer(frame) for frame in frames]


def far_apart(located, index) -> tuple[float, float]:
    return translation_error(located.pose, pose(index)), rotation_error(located.pose, pose(index))


def test_a_camera_is_found_where_it_was():
    located = follow([seen(i, world()) for i in range(12)])
    assert [one.state for one in located] == [State.FIRST] + [State.TRACKED] * 11
    for index, one in enumerate(located):
        assert far_apart(one, index) < (1e-3, 1e-2)  # places are float32
    assert min(one.inliers for one in located[1:]) > 40


def test_noise_and_wrong_matches_cost_millimetres():
    located = follow([seen(i, world(), noise=0.2, wrong=0.3) for i in range(8)], OdometrySettings(iterations=300))
    for index, one in enumerate(located):
        assert np.all(np.array(far_apart(one, index)) < (0.015, 0.1))
    assert 20 < located[-1].inliers < 60


def test_the_world_is_that_of_the_start():
    start = np.linalg.inv(pose(5))
    located = follow([seen(i, world()) for i in range(3)], start=start)
    np.testing.assert_allclose(located[2].pose, start @ pose(2), atol=1e-3)


def test_a_frame_without_points_moves_as_the_one_before_and_is_told():
    frames = [seen(i, world()) for i in range(8)]
    frames[4] = only(frames[4], [])
    located = follow(frames, OdometrySettings(iterations=100, keyframe_motion=1, keyframe_inliers=0))
    assert [one.state == State.BRIDGED for one in located] == [index == 4 for index in range(8)]
    assert located[4].inliers == 0
    assert not located[4].keyframe
    for index in (4, 5, 7):  # the motion is the same in all frames, and the keyframe is still there afterwards
        assert far_apart(located[index], index) < (2e-3, 2e-2)


def test_the_first_frames_without_points_stay_at_the_start():
    located = follow([seen(0, world()), only(seen(1, world()), range(5)), seen(2, world())])
    np.testing.assert_array_equal(located[1].pose, np.eye(4))
    assert located[2].state == State.TRACKED


def test_where_the_keyframe_is_out_of_sight_the_frame_before_helps():
    first, later = world(40, 1), world(40, 2)
    both = np.concatenate([first, later])
    sight = range(40), range(80), range(40, 80), range(40, 80)
    frames = [only(seen(i, both), numbers) for i, numbers in enumerate(sight)]
    located = follow(frames, OdometrySettings(iterations=100, keyframe_motion=1, keyframe_inliers=0))
    assert [one.keyframe for one in located] == [True, False, True, False]
    assert {one.state for one in located[1:]} == {State.TRACKED}
    assert far_apart(located[3], 3) < (2e-3, 2e-2)


def keyframes(count=10, **rule) -> list[int]:
    located = follow([seen(i, world()) for i in range(count)], OdometrySettings(iterations=50, **rule))
    return [index for index, one in enumerate(located) if one.keyframe]


def test_keyframes_follow_the_rules():
    assert keyframes(keyframe_inliers=0, keyframe_motion=1) == [0]
    assert keyframes(keyframe_inliers=0, keyframe_motion=0) == list(range(10))
    by_motion = keyframes(keyframe_inliers=0, keyframe_motion=0.02)
    assert 2 < len(by_motion) < 9
    assert len(keyframes(keyframe_inliers=0, keyframe_motion=0.06)) < len(by_motion)


def test_a_keyframe_comes_when_its_share_of_inliers_is_below_the_first():
    counts = [60, 60, 50, 43, 41, 41, 41]
    frames = [seen(i, world(200)) for i in range(7)]
    common = sorted(set.intersection(*({*frame.features.descriptors.argmax(1)} for frame in frames)))
    some = [only(frame, common[:count]) for frame, count in zip(frames, counts, strict=True)]
    located = follow(some, OdometrySettings(iterations=50, keyframe_motion=1, keyframe_inliers=0.7))
    assert [one.inliers for one in located] == [0, *counts[1:]]
    assert [one.keyframe for one in located] == [True, False, False, False, True, False, False]  # 41 < 0.7 x 60


def test_a_frame_without_depth_is_located_but_is_no_keyframe():
    frames = [seen(i, world(), depth=i != 1) for i in range(3)]
    located = follow(frames, OdometrySettings(iterations=50, keyframe_motion=0))
    assert [one.keyframe for one in located] == [True, False, True]
    assert far_apart(located[1], 1) < (1e-3, 1e-2)


def test_samples_depend_on_the_seed_alone():
    frames = [seen(i, world(), noise=0.5, wrong=0.5) for i in range(5)]
    few = OdometrySettings(iterations=3)
    poses = [np.stack([one.pose for one in follow(frames, few, seed)]) for seed in (0, 0, 1)]
    np.testing.assert_array_equal(poses[0], poses[1])
    assert not np.array_equal(poses[0], poses[2])


@pytest.mark.parametrize(
    "bad",
    [
        {"threshold": 0},
        {"threshold": float("nan")},
        {"iterations": 0},
        {"min_inliers": 3},
        {"keyframe_inliers": 1.1},
        {"keyframe_motion": -1},
        {"keyframe_motion": float("nan")},
    ],
)
def test_settings_that_can_not_be_are_refused(bad):
    (name,) = bad
    with pytest.raises(BadInputError, match=f"{name} is "):
        OdometrySettings(**bad)
