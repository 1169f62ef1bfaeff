"""What methods are called: by their detector and descriptor, by the user's labels, and never two by one name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from sips_lit.errors import BadInputError
from sips_lit.evaluate.result import MethodResult, PairSetResult
from sips_lit.files import safe_name
from sips_lit.render import styles
from sips_lit.render.styles import Style, detector_styles


def labelled(result: PairSetResult, labels: Mapping[str, str]) -> PairSetResult:
    """The result with methods called as ``labels`` says, by the method's key or by its detector's.

    A method's key (``sips_rootsift``, as files are named) replaces the whole name. A detector's key (``sips``) replaces the
    detector in the names of its methods: "ours + RootSIFT".
    """
    methods = tuple(replace(method, name=_label(method, labels)) for method in result.detectors)
    return replace(result, detectors=methods)


def refuse_unknown_labels(
    labels: Mapping[str, str], keys: Iterable[tuple[str, str]], skipped: Iterable[str] = ()
) -> None:
    """Raises BadInputError for a label of none of the methods, given by their keys and the names of their descriptors."""
    known = dict.fromkeys(known for key, descriptor in keys for known in (detector_key(key, descriptor), key))
    unknown = next((name for name in labels if name not in known and name not in set(skipped)), None)
    if unknown is not None:
        raise BadInputError(f"labels names {unknown}, which is no method here: give labels to {', '.join(known)}")


def told_apart(result: PairSetResult) -> PairSetResult:
    """The result with the key added to names that several methods share, as figures tell them apart by name."""
    count = Counter(method.name for method in result.detectors)
    methods = tuple(
        replace(method, name=f"{method.name} ({method.key})") if count[method.name] > 1 else method
        for method in result.detectors
    )
    return replace(result, detectors=methods)


def styles_of(results: Sequence[PairSetResult]) -> dict[str, Style]:
    """The style of each method of some pair sets by its name."""
    names = {method.name: original_name(method) for result in results for method in result.detectors}
    return detector_styles(names, names)


def is_control(method: MethodResult) -> bool:
    """Whether a method's points ignore the image, whatever it is called."""
    return styles.is_control(method.name) or styles.is_control(original_name(method))


def original_name(method: MethodResult) -> str:
    """A method's name without labels: that of the detector, with that of a common descriptor."""
    detector, descriptor = (str(method.protocol.get(part, "")) for part in ("detector", "descriptor"))
    return (detector or method.name) + (f" + {descriptor}" if descriptor not in ("", "own") else "")


def detector_key(key: str, descriptor: str) -> str:
    """The detector's part of a method's key, given the name of the descriptor."""
    return key.removesuffix(f"_{safe_name(descriptor).lower()}")


def _label(method: MethodResult, labels: Mapping[str, str]) -> str:
    descriptor = str(method.protocol.get("descriptor", "own"))
    detector = detector_key(method.key, descriptor)
    if method.key in labels and (method.key != detector or descriptor == "own"):
        return labels[method.key]
    if detector in labels:
        return labels[detector] + ("" if descriptor == "own" else f" + {descriptor}")
    return method.name
