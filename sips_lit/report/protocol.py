"""How the numbers of a pair set were obtained: in words, and key by key."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.stored import plain
from sips_lit.report.summary import apart, main_budget, main_k, unknown_share

_WORDS = {
    "n_max": "most points per image, n_max",
    "ks": "values of k",
    "k": "inliers that a pair needs, k",
    "n": "points per image, n",
}


def shared_protocol(result: PairSetResult) -> dict[str, Any]:
    """The pair set's protocol with what the protocols of all its methods agree on."""
    shared = dict(result.protocol)
    protocols = [method.protocol for method in result.detectors]
    for key, value in (protocols[0] if protocols else {}).items():
        if all(key in protocol and plain(protocol[key]) == plain(value) for protocol in protocols):
            shared.setdefault(key, value)
    return shared


def protocol_rows(entries: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Keys and values in words, entries of entries in their own rows."""
    return [(_WORDS.get(key, key.replace("_", " ")), value) for key, value in _flat(plain(entries))]


def protocol_differences(result: PairSetResult) -> tuple[list[str], dict[str, list[str]]]:
    """Of what the methods' protocols do not share the keys, and each method's values by its name; empty without any."""
    shared = plain(shared_protocol(result))
    own = {
        method.name: dict(_flat({k: v for k, v in plain(method.protocol).items() if k not in shared or shared[k] != v}))
        for method in result.detectors
    }
    keys = list(dict.fromkeys(key for entries in own.values() for key in entries))
    rows = {name: [entries.get(key, "-") for key in keys] for name, entries in own.items()}
    return [key.replace("_", " ") for key in keys], rows


def protocol_sentences(result: PairSetResult) -> str:
    """A paragraph: the pairs, the points, the verification, its repeats, and what the tables are for."""
    return " ".join(_sentences(result, shared_protocol(result)))


def verifications(protocol: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The plain entries of the different verifications; the protocol has one for each source of pairs."""
    checks = protocol.get("verification", ())
    several: Sequence[Any] = [checks] if isinstance(checks, Mapping) else checks
    entries = [
        {key: value for key, value in check.items() if not isinstance(value, Mapping)}
        for check in several
        if isinstance(check, Mapping)
    ]
    return _different(entries)


def _sentences(result: PairSetResult, shared: Mapping[str, Any]) -> Iterator[str]:
    if not result.detectors:
        yield "No method was measured."
        return
    first, several = result.detectors[0], len(result.detectors) > 1
    pairs = _counted(len(first.pairs), "pair")
    overlap = f" with an overlap of at least {shared['overlap']}" if "overlap" in shared else ""
    if "overlap_below" in shared:
        overlap += f" and less than {shared['overlap_below']}"
    seed = f", drawn with seed {shared['seed']}" if overlap and "seed" in shared else ""
    yield f"{pairs} of images{overlap}{seed}{', the same for all methods' if several else ''}."
    if apart(first.pairs):
        yield f"The median pair is {apart(first.pairs)} apart."
    left_out = shared.get("left_out", ())
    if left_out:
        yield (
            f"{_counted(len(left_out), 'pair')} left out, as the verification needs a depth or pose that is not known: "
            f"{', '.join(left_out)}."
        )
    yield f"{'Each' if several else 'The'} detector was asked for at least its {first.n_max} best points per image."
    yield "n_k is the smallest number of points per image that gives k inliers."
    shares = [share for method in result.detectors if not math.isnan(share := unknown_share(method))]
    if any(shares):
        between = dict.fromkeys(f"{100 * share:.1f} %" for share in (min(shares), max(shares)))
        yield (
            f"The truth about {' to '.join(between)} of the points (mean over the pairs) is not known: n_k counts these, "
            "judged n_k does not."
        )
    for check in verifications(shared):
        yield "Verification: " + ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in check.items()) + "."
    repeats = first.n_k.shape[1]
    if repeats > 1:
        yield f"The verification is random and was repeated {repeats} times with other seeds."
        yield "Numbers are means over the repeats."
    n = main_budget(first)
    at = f" and, where points are limited, for the {n} best of each image" if n else ""
    yield f"Tables and curves are for k = {main_k(first)}{at}."


def _counted(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _different(entries: Sequence[Any]) -> list[Any]:
    return [entry for index, entry in enumerate(entries) if entry not in entries[:index]]


def _flat(entries: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    for key, value in entries.items():
        name = f"{above} {key}".strip()
        if isinstance(value, Mapping):
            yield from _flat(value, name)
        elif isinstance(value, list) and value and all(isinstance(entry, Mapping) for entry in value):
            different = _different(value)
            for index, entry in enumerate(different, 1):
                yield from _flat(entry, name if len(different) == 1 else f"{name} {index}")
        else:
            yield name, _text(value)


def _text(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    return "none" if value is None else str(value)
