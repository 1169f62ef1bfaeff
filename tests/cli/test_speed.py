import csv
import json

import pytest
import torch

import sips_lit.cli.speed
from sips_lit.errors import BadInputError
from sips_lit.evaluate.speed import Speed

FAST = ["size=[64,48]", "rounds=2", "n=20", "memory=false"]


@pytest.fixture
def detectors(checkpoint) -> str:
    return f"detectors=[{{sips: {{path: {checkpoint}}}}},orb]"


def test_a_table_and_the_same_numbers_in_files(command, detectors, frames, tmp_path):
    result = command("speed", f"input={frames}", "images=3", detectors, *FAST, f"output={tmp_path / 'out'}")
    assert result.code == 0, result.err
    assert "| SIPs (path untrained.safetensors) |" in result.out
    assert "plane, 64x48, at most 20 points" in result.out
    stored = json.loads((tmp_path / "out" / "speed.json").read_text())
    assert stored["protocol"]["images"] == 3
    assert stored["protocol"]["decode_ms"] > 0
    sips, orb = stored["detectors"]
    assert len(sips["milliseconds"]["network"]) == 2
    assert "network" not in orb["milliseconds"]
    rows = list(csv.DictReader((tmp_path / "out" / "speed.csv").open()))
    assert [(row["name"], row["round"]) for row in rows] == [
        (name, turn) for name in (sips["name"], "ORB") for turn in "01"
    ]
    assert float(rows[1]["network_ms"]) == sips["milliseconds"]["network"][1]
    assert rows[2]["network_ms"] == ""


def test_without_input_and_scikit_image_an_image_is_made_up(command, detectors, monkeypatch, tmp_path):
    def missing() -> None:
        raise BadInputError("no scikit-image")

    monkeypatch.setattr(sips_lit.cli.speed, "demo_photograph", missing)
    result = command("speed", detectors, *FAST, f"output={tmp_path}")
    assert result.code == 0, result.err
    assert "an image that is made up" in result.out
    assert "decoding" not in result.out


def test_runtime_and_threads_reach_the_detector(command, checkpoint, frames, monkeypatch, tmp_path):
    made = []

    def measured(methods, *rest):
        made.extend((method.detector, torch.get_num_threads()) for method in methods)
        return [Speed(method.key, method.name) for method in methods]

    before = torch.get_num_threads()
    monkeypatch.setattr(sips_lit.cli.speed, "measure_speed", measured)
    monkeypatch.setattr(sips_lit.cli.speed, "write", lambda *_: None)
    entries = f"detectors=[sips,{{sips: {{path: {checkpoint}, runtime: torch}}}}]"
    try:
        result = command(
            "speed", entries, "runtime=openvino", "threads=1", *FAST, f"input={frames}", f"output={tmp_path}"
        )
    finally:
        torch.set_num_threads(before)
    assert result.code == 0, result.err
    assert [(detector.runtime.name, threads) for detector, threads in made] == [("openvino", 1), ("torch", 1)]


def test_descriptors_of_their_own_and_what_is_skipped(command, detectors, frames, tmp_path):
    result = command("speed", f"input={frames}", detectors, "descriptor=own", *FAST, f"output={tmp_path}")
    assert result.code == 0, result.err
    assert "skipped sips_path_untrained.safetensors: SIPs does not describe its points" in result.out
    assert "| ORB " in result.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rounds=0"], "rounds is 0: give a number from 1"),
        (["size=640"], "size is 640: give width and height"),
        (["size=[640,0]"], "size is [640, 0]: give width and height"),
        (["detectors=[{sips: {path: none.ckpt}}]"], "none of the detectors can be made"),
        (["input=nowhere.png"], "there is no nowhere.png"),
        (["detectors=[kaze]"], "there is no detector kaze"),
    ],
)
def test_bad_input_is_one_sentence(command, arguments, message, tmp_path):
    result = command("speed", *arguments, f"output={tmp_path}")
    assert result.code == 1
    assert message in result.err
