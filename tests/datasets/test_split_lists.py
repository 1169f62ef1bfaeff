import itertools

import pytest
import yaml

from sips_lit.datasets.split_lists import FOLDER, split_names
from sips_lit.errors import BadInputError

FILES = sorted(FOLDER.glob("*.yaml"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_no_sequence_is_in_two_splits(file):
    splits = yaml.safe_load(file.read_text())
    assert set(splits) <= {"train", "validation", "test"}
    names = {split: split_names(file.stem, split) for split in splits}
    assert any(names.values())
    for split, own in names.items():
        assert len(set(own)) == len(own), split
    for one, other in itertools.combinations(names, 2):
        assert not set(names[one]) & set(names[other]), (one, other)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_names_stay_as_they_are_written(file):
    # 00 without quotes would be the number 0
    for split, names in yaml.safe_load(file.read_text()).items():
        assert all(isinstance(name, str) and name == name.strip() != "" for name in names or []), split


def test_an_unknown_split_is_told_the_choices(tmp_path, monkeypatch):
    (tmp_path / "made.yaml").write_text('train: ["01", "02"]\nvalidation: []\ntest: ["00"]\n')
    monkeypatch.setattr("sips_lit.datasets.split_lists.FOLDER", tmp_path)
    assert split_names("made", "train") == ["01", "02"]
    assert split_names("made", "validation") == []
    with pytest.raises(BadInputError, match=r"made has no split dev: choose one of train, validation, test"):
        split_names("made", "dev")
