import cv2
import numpy as np
import pytest
from hpatches_files import SIZES, photometric_error, write_sequence
from textured_scenes import keypoints

from sips_lit.datasets.hpatches import hpatches
from sips_lit.datasets.split_lists import split_names
from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey
from sips_lit.geometry.projection import apply_homography
from sips_lit.inliers.homography import HomographyInliers
from sips_lit.pairs.overlap import OverlapParameters, measure_overlap
from sips_lit.pairs.sampler import read_pair
from sips_lit.types import Matches


@pytest.fixture(scope="module")
def root(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hpatches")
    write_sequence(folder, "v_one")
    write_sequence(folder, "i_two", seed=1, viewpoint=False, suffix="png")
    (folder / "notes").mkdir()
    return folder


def test_sequences_as_published(root):
    sequences = hpatches(root)
    assert [sequence.name for sequence in sequences] == ["i_two", "v_one"]
    for sequence in sequences:
        assert len(sequence) == 6
        assert [sequence.frame(i).shape[::-1] for i in range(6)] == SIZES
        assert not sequence.temporal
    assert sequences[1].frame_name(0) == "v_one_1"
    np.testing.assert_array_equal(sequences[1].frame(3), read_grey(root / "v_one" / "4.ppm"))
    (alone,) = hpatches(root / "v_one")
    assert (alone.name, alone.fingerprint) == ("v_one", sequences[1].fingerprint)


@pytest.mark.parametrize("max_side", [None, 160, 100, 51])
def test_homographies_join_what_the_images_show(root, max_side):
    (sequence,) = hpatches(root, sequences=["v_one"], max_side=max_side)
    for i, j in [(0, 5), (5, 0), (1, 4), (3, 2)]:
        image0, image1, H = sequence.frame(i), sequence.frame(j), sequence.homography(i, j)
        assert max(image0.shape) <= (max_side or 160)
        right = photometric_error(image0, image1, H)
        off = np.array([[1, 0, 2.0], [0, 1, 0], [0, 0, 1]])
        assert right < 0.55 * photometric_error(image0, image1, off @ H)
    np.testing.assert_allclose(sequence.homography(2, 2), np.eye(3), atol=1e-9)


@pytest.mark.parametrize(("max_side", "scales"), [(100, []), (None, [0.5, 1.41]), (110, [0.71])])
def test_homographies_are_exact_at_every_size(root, tmp_path, max_side, scales):
    stored = write_sequence(tmp_path, "v_other", seed=3)
    (sequence,) = hpatches(tmp_path, max_side=max_side, synthetic_scales=scales)
    assert len(sequence) == 6 * (1 + len(scales))
    place = np.array([[200.0, 200], [180, 230], [225, 190]])  # on the plane
    seen = []
    for index in range(len(sequence)):
        before = SIZES[index % 6]
        height, width = sequence.frame(index).shape
        in_file = apply_homography(stored[index % 6], place)
        # as fractions of the image, measured from its outer edge, a place stays where it is
        seen.append((in_file + 0.5) / before * [width, height] - 0.5)
    for i in range(len(sequence)):
        for j in range(len(sequence)):
            moved = apply_homography(sequence.homography(i, j), seen[i])
            np.testing.assert_allclose(moved, seen[j], atol=1e-6)


def test_copies_at_other_scales(root):
    (sequence,) = hpatches(root, sequences=["v_one"], synthetic_scales=[0.5, 1.4])
    assert [sequence.frame_name(i) for i in (0, 6, 17)] == ["v_one_1", "v_one_1_x0.5", "v_one_6_x1.4"]
    assert sequence.frame(6).shape == (60, 80)
    assert sequence.frame(12).shape == (168, 224)
    for i, j in [(0, 6), (6, 12), (12, 1), (8, 15)]:
        assert photometric_error(sequence.frame(i), sequence.frame(j), sequence.homography(i, j)) < 9
    assert sequence.fingerprint != hpatches(root, sequences=["v_one"])[0].fingerprint


def test_shrinking_does_not_alias(tmp_path):
    write_sequence(tmp_path)
    stripes = np.tile(np.array([[0, 255]], np.uint8), (120, 80))
    cv2.imwrite(str(tmp_path / "v_made" / "1.ppm"), cv2.cvtColor(stripes, cv2.COLOR_GRAY2BGR))
    (sequence,) = hpatches(tmp_path, max_side=80)
    assert np.ptp(sequence.frame(0)) == 0


def test_resized_images_are_kept(root, tmp_path, monkeypatch):
    def open_it(**options):
        return hpatches(root, sequences=["v_one"], cache_dir=tmp_path, **options)[0]

    expected = [hpatches(root, sequences=["v_one"], max_side=100)[0].frame(i) for i in range(6)]
    for frames in (open_it(max_side=100), open_it(max_side=100)):
        for i in range(6):
            np.testing.assert_array_equal(frames.frame(i), expected[i])
        monkeypatch.setattr(cv2, "resize", None)  # the second time nothing is resized
    monkeypatch.undo()
    kept = set(tmp_path.rglob("*.pgm"))
    assert len(kept) == 5  # one image is small enough
    assert open_it(max_side=50).frame(0).shape == (38, 50)  # no other size is taken for it
    assert set(tmp_path.rglob("*.pgm")) > kept


def test_a_changed_file_is_another_sequence(tmp_path):
    write_sequence(tmp_path)
    before = hpatches(tmp_path)[0].fingerprint
    assert hpatches(tmp_path)[0].fingerprint == before
    assert hpatches(tmp_path, max_side=99)[0].fingerprint != before
    with (tmp_path / "v_made" / "H_1_3").open("a") as file:
        file.write("\n")
    assert hpatches(tmp_path)[0].fingerprint != before


def test_pairs_carry_the_homography_and_are_labelled(root):
    (sequence,) = hpatches(root, sequences=["v_one"])
    pair = read_pair(sequence, 0, 4, between=False)
    x, y = np.meshgrid(np.arange(30, 130, 10.0), np.arange(30, 100, 10.0))
    start = np.stack([x, y], -1).reshape(-1, 2)
    goal = apply_homography(sequence.homography(0, 4), start)
    matches = Matches(np.arange(len(start)), np.arange(len(start)))
    assert HomographyInliers()(pair, keypoints(start), keypoints(goal), matches).inlier.all()
    with pytest.raises(BadInputError, match=r"v_one are in no order.*inliers=homography"):
        read_pair(sequence, 0, 4)


def test_kinds_and_splits(tmp_path, monkeypatch):
    published = {"train": ["v_a", "i_b"], "test": ["v_c", "v_d"]}
    monkeypatch.setattr("sips_lit.datasets.hpatches.split_names", lambda dataset, split: published[split])
    for name in ("v_a", "i_b", "v_c"):
        write_sequence(tmp_path, name)

    def names(**options):
        return [sequence.name for sequence in hpatches(tmp_path, **options)]

    assert names(kind="viewpoint") == ["v_a", "v_c"]
    assert names(kind="illumination") == ["i_b"]
    assert names(split="train") == ["i_b", "v_a"]
    assert names(split="train", kind="viewpoint") == ["v_a"]
    assert names(split="test", sequences=["v_c", "v_a"]) == ["v_c"]
    with pytest.raises(BadInputError, match=r"lacks 1 of the 2 HPatches sequences .* such as v_d"):
        names(split="test")
    with pytest.raises(BadInputError, match=r"lacks 1 of the 1 .* v_x"):
        names(sequences=["v_x"])
    with pytest.raises(BadInputError, match="none is left"):
        names(split="test", kind="illumination")
    with pytest.raises(BadInputError, match="kind is scenery"):
        names(kind="scenery")


def test_the_published_split_has_all_sequences():
    train, test = split_names("hpatches", "train"), split_names("hpatches", "test")
    counts = [sum(name.startswith(kind) for name in names) for names in (train, test) for kind in ("v_", "i_")]
    assert counts == [39, 37, 20, 20]  # 59 of viewpoint and 57 of illumination
    assert "v_churchill" in train


@pytest.mark.parametrize("missing", ["3.ppm", "H_1_6"])
def test_a_half_downloaded_sequence(tmp_path, missing):
    write_sequence(tmp_path)
    (tmp_path / "v_made" / missing).unlink()
    with pytest.raises(BadInputError, match=rf"there is no .*{missing}.*v_made has .*H_1_2 to H_1_6"):
        hpatches(tmp_path)


@pytest.mark.parametrize("make", ["nothing", "empty", "other", "file"])
def test_not_hpatches(tmp_path, make):
    root = tmp_path / "root"
    if make in ("empty", "other"):
        root.mkdir()
    if make == "other":
        (root / "sequences").mkdir()
    if make == "file":
        root.write_text("no folder")
    with pytest.raises(BadInputError, match=r"there is no HPatches sequence .*root.*hpatches-sequences-release"):
        hpatches(root)


WRONG = {
    "singular": (np.diag([1.0, 0, 1]), "singular"),
    "zero": (np.zeros((3, 3)), "singular"),
    "far": (np.array([[1, 0, 5000.0], [0, 1, 0], [0, 0, 1]]), "maps nothing"),
    "mirror": (np.diag([-1.0, 1, 1]), "maps nothing"),
    "two rows": (np.eye(3)[:2], "2 rows"),
    "four columns": (np.ones((3, 4)), "line 1 of .* 4 values"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_homography_that_cannot_be_one(tmp_path, case):
    write_sequence(tmp_path)
    matrix, message = WRONG[case]
    np.savetxt(tmp_path / "v_made" / "H_1_4", matrix)
    with pytest.raises(BadInputError, match=message) as caught:
        hpatches(tmp_path)
    assert "H_1_4" in str(caught.value)


@pytest.mark.parametrize("scales", [[0.5, 0.5], [1], [0], [-1], [9]])
def test_scales_that_make_no_sense(root, scales):
    with pytest.raises(BadInputError, match="synthetic_scales"):
        hpatches(root, synthetic_scales=scales)


@pytest.mark.parametrize("number", [1, 3])
@pytest.mark.parametrize("length", [0, 5, 500])  # nothing, half a header, half an image
@pytest.mark.parametrize("scales", [(), (0.5,)])
def test_a_truncated_image_is_left_out_of_the_pairs(tmp_path, number, length, scales):
    write_sequence(tmp_path, "v_whole")
    write_sequence(tmp_path)
    file = tmp_path / "v_made" / f"{number}.ppm"
    file.write_bytes(file.read_bytes()[:length])
    damaged, whole = hpatches(tmp_path, synthetic_scales=scales)
    bad = list(range(number - 1, len(damaged), 6))
    for index in bad:
        with pytest.raises(BadInputError, match=rf"{number}\.ppm is not an image"):
            damaged.frame(index)
    np.testing.assert_allclose(damaged.homography(1, 4), whole.homography(1, 4), rtol=1e-9, atol=1e-9)
    index, undamaged = (measure_overlap(sequence, OverlapParameters()) for sequence in (damaged, whole))
    assert list(index.unreadable) == bad
    for frame in range(len(damaged)):
        partners = undamaged.partners(frame, 0.3)
        assert index.partners(frame, 0.3).tolist() == [p for p in partners if frame not in bad and p not in bad]


@pytest.mark.shared_data
@pytest.mark.parametrize("max_side", [None, 700])
def test_real_homographies_have_their_origin_at_a_pixel_centre(shared_data, max_side):
    (sequence,) = hpatches(shared_data / "hpatches", max_side=max_side)
    assert sequence.name == "v_churchill"
    sift = cv2.SIFT_create(2000)
    (found0, described0), (found1, described1) = (sift.detectAndCompute(sequence.frame(i), None) for i in (0, 4))
    matched = cv2.BFMatcher(crossCheck=True).match(described0, described1)
    xy0 = np.array([found0[match.queryIdx].pt for match in matched])
    xy1 = np.array([found1[match.trainIdx].pt for match in matched])
    off = xy1 - apply_homography(sequence.homography(0, 4), xy0)
    near = np.linalg.norm(off, axis=1) < 4
    assert near.sum() > 400
    assert np.abs(np.median(off[near], 0)).max() < 0.1


@pytest.mark.parametrize("suffix", ["jpg", "png", "jpeg"])
def test_other_formats_of_the_images(tmp_path, suffix):
    write_sequence(tmp_path, "v_made", suffix=suffix)
    (sequence,) = hpatches(tmp_path)
    assert (len(sequence), sequence.frame(3).shape) == (6, (121, 160))
    write_sequence(tmp_path / "both", "v_made")
    for number in (1, 4):
        (tmp_path / "v_made" / f"{number}.{suffix}").rename(tmp_path / "both" / "v_made" / f"{number}.{suffix}")
    (sequence,) = hpatches(tmp_path / "both")
    assert [image.file.suffix for image in sequence.images] == [".ppm"] * 6
