import numpy as np
import pytest
from rgbd_files import depth_of, pose, render, write_image
from rgbd_layouts import COLOUR_7, DEPTH_7, SIZE, write_pose, write_seven_scenes

from sips_lit.datasets.seven_scenes import seven_scenes
from sips_lit.errors import BadInputError, InputWarning

XY = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), -1).reshape(-1, 2)


def test_colour_depth_and_poses(tmp_path):
    (sequence,) = seven_scenes(write_seven_scenes(tmp_path / "chess" / "seq-01"))
    assert (sequence.name, len(sequence), sequence.frame_name(2)) == ("seq-01", 4, "seq-01_frame-000002.color")
    np.testing.assert_array_equal(sequence.camera(1).matrix, COLOUR_7)
    for i in range(4):
        np.testing.assert_array_equal(sequence.frame(i), render(i, COLOUR_7, SIZE)[0])
        np.testing.assert_allclose(sequence.pose(i), pose(i))
        depth = sequence.depth(i).ravel()
        known = np.isfinite(depth)
        assert known.mean() == pytest.approx((525 / 585) ** 2, abs=0.01)  # the colour camera sees more
        assert not known.reshape(120, 160)[16, 28]  # where 65535 is stored
        # of the pixel's direction, half a pixel of the depth camera off at most
        np.testing.assert_allclose(depth[known], depth_of(XY, pose(i), COLOUR_7)[0][known], atol=6e-3)


def test_intrinsics_of_both_cameras(tmp_path):
    folder = write_seven_scenes(tmp_path, 2)
    (sequence,) = seven_scenes(folder, intrinsics=[585, 585, 320, 240])
    np.testing.assert_array_equal(sequence.camera(0).matrix, DEPTH_7)
    depth = render(1, DEPTH_7, SIZE)[1]
    known = np.isfinite(sequence.depth(1))
    assert (~known).sum() == 20
    np.testing.assert_allclose(sequence.depth(1)[known], depth[known], atol=6e-4)  # registered: pixel by pixel
    for key in ("intrinsics", "depth_intrinsics"):
        for wrong in ([1.0, 2.0], [0.0, 500.0, 320.0, 240.0]):
            with pytest.raises(BadInputError, match=f"data.{key} is"):
                seven_scenes(folder, **{key: wrong})


def test_depth_and_poses_that_are_missing(tmp_path):
    folder = write_seven_scenes(tmp_path / "seq-01")
    (folder / "frame-000001.depth.png").unlink()
    (folder / "frame-000002.pose.txt").unlink()
    write_pose(folder / "frame-000003.pose.txt", np.full((4, 4), -np.inf))
    with pytest.warns(InputWarning, match="of 4 images of .* 1 have no depth map and 2 no pose"):
        (sequence,) = seven_scenes(folder)
    assert [sequence.depth(i) is None for i in range(4)] == [False, True, False, False]
    assert [sequence.pose(i) is None for i in range(4)] == [False, False, True, True]
    write_pose(folder / "frame-000002.pose.txt", 2 * pose(2))
    with pytest.raises(BadInputError, match=r"frame-000002\.pose\.txt is no pose"):
        seven_scenes(folder)
    (folder / "frame-000002.pose.txt").write_text("1 2 3\n4")
    with pytest.raises(BadInputError, match=r"frame-000002\.pose\.txt is no pose"):
        seven_scenes(folder)


def test_scenes_and_their_sequences(tmp_path):
    for name in ("chess/seq-01", "chess/seq-02", "fire/seq-01"):
        write_seven_scenes(tmp_path / "all" / name, 2)
    assert [s.name for s in seven_scenes(tmp_path / "all")] == [
        "all_chess_seq-01",
        "all_chess_seq-02",
        "all_fire_seq-01",
    ]
    assert [s.name for s in seven_scenes(tmp_path / "all" / "chess")] == ["chess_seq-01", "chess_seq-02"]
    assert len({s.fingerprint for s in seven_scenes(tmp_path / "all")}) == 3
    (tmp_path / "none").mkdir()
    with pytest.raises(BadInputError, match=r"no sequence of 7-Scenes at .*none.*frame-000000\.color\.png"):
        seven_scenes(tmp_path / "none")


def test_a_damaged_depth_map(tmp_path):
    folder = write_seven_scenes(tmp_path)
    (folder / "frame-000000.depth.png").write_bytes(b"nothing")
    write_image(folder / "frame-000002.depth.png", np.ones((6, 8), np.uint16))
    (sequence,) = seven_scenes(folder)
    for index, message in ((0, "damaged"), (2, "is 8x6, but its image is 160x120")):
        with pytest.raises(BadInputError, match=message):
            sequence.depth(index)
