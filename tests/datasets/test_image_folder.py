from sips_lit.datasets.image_folder import SPEC


def test_visible_images_of_a_folder(tmp_path):
    assert SPEC.sign(tmp_path) is None
    for name in ("1.png", "2.JPG", ".3.png", "notes.txt"):
        (tmp_path / name).touch()
    assert SPEC.sign(tmp_path) == "2 images"
    assert SPEC.sign(tmp_path / "1.png") is None
