from dataclasses import replace

import numpy as np
from golden_results import golden

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.protocol import (
    protocol_differences,
    protocol_rows,
    protocol_sentences,
    shared_protocol,
    verifications,
)


def test_what_all_methods_agree_on_is_shared():
    shared = shared_protocol(golden())
    assert shared["search"] == "exact"
    assert shared["overlap"] == 0.25
    assert not {"own", "detector"} & set(shared)
    result = golden()
    one = replace(result, detectors=(replace(result.detectors[0], protocol={"seed": 9, "a": 1}),))
    assert shared_protocol(one)["seed"] == 3  # the pair set's own
    assert shared_protocol(one)["a"] == 1


def test_numbers_are_shared_whatever_holds_them():
    result = golden()
    protocols = {"size": (1, 2), "limit": 2.0, "other": 1}, {"size": [1, 2], "limit": np.float64(2), "other": 2}
    methods = tuple(replace(m, protocol=p) for m, p in zip(result.detectors, protocols, strict=True))
    assert set(shared_protocol(replace(result, protocol={}, detectors=methods))) == {"size", "limit"}


def test_differences():
    assert protocol_differences(golden()) == (
        ["detector", "own"],
        {"Alpha + RootSIFT": ["Alpha + RootSIFT", "0"], "Beta": ["Beta", "1"]},
    )
    first, second = golden().detectors
    lacking = replace(golden(), detectors=(first, replace(second, protocol={})))
    keys, rows = protocol_differences(lacking)
    assert "rotation limit" in keys
    assert set(rows["Beta"]) == {"-"}
    assert protocol_differences(replace(golden(), detectors=(first,)))[0] == []


def test_rows_are_flat():
    entries = {
        "n_max": 200,
        "image_size": ["640x480", "320x240"],
        "camera": {"focal": {"x": 1.5}},
        "same": [{"a": 1}, {"a": 1}],
        "other": [{"a": 1}, {"a": 2}],
        "file": None,
    }
    assert protocol_rows(entries) == [
        ("most points per image, n_max", "200"),
        ("image size", "640x480, 320x240"),
        ("camera focal x", "1.5"),
        ("same a", "1"),
        ("other 1 a", "1"),
        ("other 2 a", "2"),
        ("file", "none"),
    ]


def test_each_verification_once_without_details():
    checks = [{"inliers": "klt", "tracker": {"window": 21}}, {"inliers": "klt"}, {"inliers": "homography"}]
    assert verifications({"verification": checks}) == [{"inliers": "klt"}, {"inliers": "homography"}]
    assert verifications({"verification": checks[0]}) == [{"inliers": "klt"}]
    assert verifications({}) == []


def test_sentences_for_several_methods():
    assert protocol_sentences(golden()) == (
        "6 pairs of images with an overlap of at least 0.25, drawn with seed 3, the same for all methods. "
        "The median pair is 3 frames, 24.5 px, 1.48 m, 19.3 degrees apart. "
        "Each detector was asked for at least its 90 best points per image. "
        "n_k is the smallest number of points per image that gives k inliers. "
        "The truth about 53.9 % to 57.1 % of the points (mean over the pairs) is not known: "
        "n_k counts these, judged n_k does not. "
        "Verification: inliers stereo_p3p, threshold 2.5. "
        "The verification is random and was repeated 4 times with other seeds. Numbers are means over the repeats. "
        "Tables and curves are for k = 7 and, where points are limited, for the 60 best of each image."
    )


def test_sentences_for_one_method_measured_once():
    result = golden()
    first = result.detectors[0]
    once = replace(first, n_k=first.n_k[:, :1], unknown=np.zeros(6), budgets={}, protocol={"k": 4, "seed": 8})
    protocol = {"left_out": ["a:1-2"], "kind": "first_to_others"}
    words = protocol_sentences(replace(result, protocol=protocol, detectors=(once,)))
    assert words == (
        "6 pairs of images. The median pair is 3 frames, 24.5 px, 1.48 m, 19.3 degrees apart. "
        "1 pair left out, as the verification needs a depth or pose that is not known: a:1-2. "
        "The detector was asked for at least its 90 best points per image. "
        "n_k is the smallest number of points per image that gives k inliers. Tables and curves are for k = 4."
    )


def test_the_share_of_unknown_points():
    def said(*shares):
        methods = [replace(golden().detectors[0], unknown=np.array(of_pairs)) for of_pairs in shares]
        words = protocol_sentences(replace(golden(), detectors=tuple(methods)))
        return words.partition("The truth about ")[2].partition(" of the points")[0]

    assert said([0.25, 0.5, np.nan]) == said([0.375] * 3, [0.3754] * 3) == "37.5 %"
    assert said([0.25] * 3, [0.0] * 3, [np.nan] * 3) == "0.0 % to 25.0 %"
    assert said([0.0] * 3) == said([np.nan] * 3) == ""


def test_nothing_was_measured():
    assert protocol_sentences(PairSetResult("e", "empty", {}, (), {})) == "No method was measured."
