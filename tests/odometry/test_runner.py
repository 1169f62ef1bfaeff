import numpy as np
import pytest
from stereo_scenes import StereoScene
from textured_scenes import ArraySequence, flight
from tiny_methods import method, sips

from sips_lit.baselines.orb import OrbDetector
from sips_lit.baselines.sift import SiftDetector
from sips_lit.describe.sift import RootSift
from sips_lit.errors import BadInputError
from sips_lit.geometry.pose import rotation_error, translation_error
from sips_lit.odometry.odometer import OdometrySettings, State
from sips_lit.odometry.runner import Plan, run_sequence

SIFT = method(SiftDetector(), RootSift(), "sift")
FEW = OdometrySettings(iterations=200)


@pytest.fixture(scope="module", params=["stereo", "depth"])
def scene(request) -> StereoScene:
    return StereoScene(4, request.param)


def test_the_camera_before_the_boards_is_followed(scene):
    result = run_sequence(scene, [SIFT], Plan((200,), FEW, repeats=2))
    (one,) = result.results
    for run in one.runs:
        for index, T in enumerate(run.poses):
            assert translation_error(T, scene.poses[index]) < 0.04  # of 0.85 m
            assert rotation_error(T, scene.poses[index]) < 0.25
        assert run.errors is not None
        assert run.errors.drift < 5
        assert list(run.state) == [State.FIRST] + [State.TRACKED] * 3
    assert one.points == 200
    assert one.bytes == 200 * (4 + 512)
    assert set(one.milliseconds) == {"detect", "describe", "depth", "pose"}
    assert result.protocol["depth"]["source"] == {"stereo": "stereo", "depth": "maps"}[scene.tells]


def test_every_method_with_every_number_of_points_as_alone(tmp_path):
    scene, orb = StereoScene(3, "depth"), method(OrbDetector(), None, "orb")
    together = run_sequence(scene, [SIFT, orb], Plan((60, 150), FEW, repeats=1), tmp_path)
    assert [(one.key, one.n) for one in together.results] == [("sift", 60), ("sift", 150), ("orb", 60), ("orb", 150)]
    alone = run_sequence(scene, [orb], Plan((150,), FEW, repeats=1))
    np.testing.assert_array_equal(alone.results[0].runs[0].poses, together.results[3].runs[0].poses)
    assert list(tmp_path.glob("*/*.npz"))


def test_probabilities_need_one_pass_for_all_numbers_of_points(tmp_path):
    scene, plan = StereoScene(2, "depth"), Plan((40, 90), FEW, repeats=1)
    result = run_sequence(scene, [method(sips(), RootSift(), "sips")], plan, tmp_path)
    assert len(list(tmp_path.glob("*/*.npz"))) == 2  # one a frame
    alone = run_sequence(scene, [method(sips(), RootSift(), "sips")], Plan((40,), FEW, repeats=1))
    assert [one.points for one in result.results] == [40, 90]
    np.testing.assert_array_equal(alone.results[0].runs[0].inliers, result.results[0].runs[0].inliers)


def test_every_second_frame_and_no_more_than_asked():
    scene = StereoScene(4, "depth")
    result = run_sequence(scene, [SIFT], Plan((100,), FEW, repeats=1, stride=2, max_frames=2))
    assert list(result.times) == [0, 2]
    np.testing.assert_array_equal(result.truth, [scene.poses[0], scene.poses[2]])
    assert translation_error(result.results[0].runs[0].poses[1], scene.poses[2]) < 0.05


def test_the_world_is_that_of_the_first_true_pose():
    scene = StereoScene(2, "depth")
    scene.poses = [np.array(T) for T in scene.poses]
    for T in scene.poses:
        T[:3, 3] += [10, 20, 30]
    result = run_sequence(scene, [SIFT], Plan((100,), FEW, repeats=1))
    np.testing.assert_array_equal(result.results[0].runs[0].poses[0], scene.poses[0])


class Failing(SiftDetector):
    def detect(self, image, n):
        raise BadInputError("no weights")


def test_a_method_that_fails_is_left_out_and_told():
    told = {}
    methods = [method(Failing(), RootSift(), "failing"), SIFT]
    result = run_sequence(StereoScene(2, "depth"), methods, Plan((30,), FEW, repeats=1), on_skip=told.__setitem__)
    assert [one.key for one in result.results] == ["sift"]
    assert result.skipped == told == {"failing": "no weights"}


def refused(sequence, plan=None) -> str:
    with pytest.raises(BadInputError) as error:
        run_sequence(sequence, [SIFT], plan or Plan((30,), FEW))
    return str(error.value)


class Posed(StereoScene):
    def camera(self, index):
        return None


def test_sequences_that_can_not_be_followed_are_refused():
    assert "there is no camera calibration of flight" in refused(flight(3))
    assert "no camera calibration" in refused(Posed(2))
    assert "no depth maps and no right images" in refused(StereoScene(2, "nothing"))
    assert "one frame" in refused(StereoScene(3, "depth"), Plan((30,), FEW, stride=5))
    stills = ArraySequence(flight(2).frames)
    stills.temporal = False
    assert "no order in time" in refused(stills)
    scene = StereoScene(2, "depth")
    scene.poses[1] = np.full((4, 4), np.inf)
    assert refused(scene).startswith("the pose of frame 1 of boards is not finite")


def test_without_true_poses_a_trajectory_is_there_all_the_same():
    scene = StereoScene(2, "depth")
    scene.poses = [None, None]
    result = run_sequence(scene, [SIFT], Plan((100,), FEW, repeats=1))
    assert not result.judged
    assert result.results[0].runs[0].errors is None
    np.testing.assert_array_equal(result.results[0].runs[0].poses[0], np.eye(4))


@pytest.mark.parametrize(
    "bad",
    [
        {"ns": ()},
        {"ns": (50, 50)},
        {"ns": (3,)},
        {"repeats": 0},
        {"stride": 0},
        {"max_frames": 1},
        {"seed": -1},
        {"segment": 0.0},
    ],
)
def test_plans_that_can_not_be_are_refused(bad):
    with pytest.raises(BadInputError, match=f"^{next(iter(bad)).rstrip('s') if 'ns' in bad else next(iter(bad))} is "):
        Plan(**bad)
