from dataclasses import replace

from benchmark_examples import NAMES, pair_set

from sips_lit.report.facts import facts, pair_statistics


def with_sequences(result, *names):
    """Pairs that go round the sequences."""
    pairs = replace(
        result.detectors[0].pairs,
        name=tuple(f"{names[at % len(names)]}:{at}-{at + 1}" for at in range(len(result.detectors[0].pairs))),
    )
    return replace(result, detectors=tuple(replace(method, pairs=pairs) for method in result.detectors))


def test_the_head_of_a_pair_set():
    result = with_sequences(pair_set(NAMES[:2], 5), "a", "b")
    first, *others = result.detectors
    first = replace(first, protocol=first.protocol | {"checkpoint": "best.ckpt (sha256 12)"})
    result = replace(result, detectors=(first, *others), protocol=result.protocol | {"image_size": ["1241x376"]})
    assert facts(result) == [
        ("sequences (pairs)", "a (3), b (2)"),
        ("images", "1241x376"),
        ("pairs", "5, of overlap 0.5 or more, drawn with seed 0"),
        ("checkpoint", f"best.ckpt (sha256 12) ({first.name})"),
    ]


def test_many_sequences_are_counted():
    (_, text), *_ = facts(with_sequences(pair_set(NAMES[:1], 20), *"abcdefghij"))
    assert text == "a (2), b (2), c (2), d (2), e (2), f (2) and 4 more"


def test_other_choices_of_pairs():
    result = pair_set(NAMES[:1], 4)
    for protocol, text in (
        ({"pairs_file": "mine.csv"}, "4, listed in mine.csv"),
        ({"kind": "first_to_others"}, "4, the first image of each sequence with its others"),
        (
            {"overlap": 0.3, "overlap_below": 0.5, "seed": 7},
            "4, of overlap 0.3 or more, less than 0.5, drawn with seed 7",
        ),
        ({}, "4"),
    ):
        assert dict(facts(replace(result, protocol=protocol)))["pairs"] == text


def test_nothing_was_measured():
    assert facts(replace(pair_set(NAMES[:1], 4), detectors=())) == []


def test_only_what_is_known_has_statistics():
    heads, rows = pair_statistics(pair_set(NAMES[:1], 4, poses=False).detectors[0].pairs)
    assert heads == ["least", "25 %", "median", "75 %", "most"]
    assert list(rows) == ["overlap", "frames apart"]
    assert rows["frames apart"] == ["7"] * 5
