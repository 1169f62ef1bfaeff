"""How the numbers of a pair set were obtained, in words and then key by key."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from typing import Any

from sips_lit.evaluate.result import PairSetResult
from sips_lit.report.stored import plain
from sips_lit.report.summary import main_budget, main_k

_WORDS = {"n_max": "most points an image, n_max", "ks": "values of k", "k": "inliers asked for, k"}


def protocol_html(result: PairSetResult) -> str:
    """A paragraph, a table of everything that all detectors share, and what is each detector's own."""
    shared = _shared(result)
    words = " ".join(sentence for sentence in _sentences(result, shared))
    return f"<p>{escape(words)}</p>\n{definition_table(shared)}\n{_differences(result, shared)}"


def definition_table(entries: Mapping[str, Any]) -> str:
    """Keys and values as a table, entries of entries in their own rows."""
    rows = "".join(
        f'<tr><th scope="row">{escape(_WORDS.get(key, key.replace("_", " ")))}</th><td>{escape(value)}</td></tr>'
        for key, value in _flat(plain(entries))
    )
    return f'<div class="scroll"><table class="plain"><tbody>{rows}</tbody></table></div>' if rows else ""


def _shared(result: PairSetResult) -> dict[str, Any]:
    """The pair set's protocol with what the protocols of all its detectors agree on."""
    shared = dict(result.protocol)
    protocols = [detector.protocol for detector in result.detectors]
    for key, value in (protocols[0] if protocols else {}).items():
        if all(key in protocol and plain(protocol[key]) == plain(value) for protocol in protocols):
            shared.setdefault(key, value)
    return shared


def _differences(result: PairSetResult, shared: Mapping[str, Any]) -> str:
    """A table of what the protocols of the detectors do not agree on."""
    own = [
        (d.name, dict(_flat({k: v for k, v in plain(d.protocol).items() if plain(shared.get(k)) != v})))
        for d in result.detectors
    ]
    keys = list(dict.fromkeys(key for _, entries in own for key in entries))
    if not keys:
        return ""
    heads = "".join(f'<th scope="col">{escape(key.replace("_", " "))}</th>' for key in keys)
    rows = "".join(
        f"<tr><td>{escape(name)}</td>" + "".join(f"<td>{escape(entries.get(key, '-'))}</td>" for key in keys) + "</tr>"
        for name, entries in own
    )
    table = (
        f'<table class="plain"><thead><tr><th scope="col">name</th>{heads}</tr></thead><tbody>{rows}</tbody></table>'
    )
    return f'<details><summary>What differs between the detectors</summary><div class="scroll">{table}</div></details>'


def _sentences(result: PairSetResult, shared: Mapping[str, Any]) -> Iterator[str]:
    if not result.detectors:
        yield "No detector was run."
        return
    first = result.detectors[0]
    overlap = f" with an overlap of at least {shared['overlap']}" if "overlap" in shared else ""
    seed = f", drawn with seed {shared['seed']}" if "seed" in shared else ""
    yield f"{len(first.pairs)} pairs of images{overlap}{seed}, the same for all detectors."
    left_out = shared.get("left_out", ())
    if left_out:
        pairs = f"{len(left_out)} pair{'s' if len(left_out) > 1 else ''}"
        yield f"{pairs} left out, as depth or pose is not known, which the verification needs: {', '.join(left_out)}."
    yield f"Each detector was asked for its {first.n_max} best points an image or more."
    yield "n_k is the fewest points an image with k inliers."
    for check in _checks(shared):
        numbers = {key: value for key, value in check.items() if not isinstance(value, Mapping)}  # the table has all
        yield "Verification: " + ", ".join(f"{key.replace('_', ' ')} {value}" for key, value in numbers.items()) + "."
    repeats = first.n_k.shape[1]
    if repeats > 1:
        yield f"The verification is random and was repeated {repeats} times with other seeds."
        yield "Numbers are means over the repeats."
    yield f"Tables and curves are for k = {main_k(first)}"
    n = main_budget(first)
    yield f"and, where points are limited, for the {n} best of each image." if n else "."


def _checks(shared: Mapping[str, Any]) -> Sequence[Mapping[str, Any]]:
    """The different verifications; the protocol has one for each source of pairs."""
    checks = shared.get("verification", ())
    several = [checks] if isinstance(checks, Mapping) else checks
    return [check for index, check in enumerate(several) if isinstance(check, Mapping) and check not in several[:index]]


def _flat(entries: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    for key, value in entries.items():
        name = f"{above} {key}".strip()
        if isinstance(value, Mapping):
            yield from _flat(value, name)
        elif isinstance(value, list) and value and all(isinstance(entry, Mapping) for entry in value):
            different = [entry for index, entry in enumerate(value) if entry not in value[:index]]
            for index, entry in enumerate(different, 1):
                yield from _flat(entry, name if len(different) == 1 else f"{name} {index}")
        else:
            yield name, _text(value)


def _text(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    return "none" if value is None else str(value)
