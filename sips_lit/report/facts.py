"""The head of a pair set: its data, its pairs, the weights that were measured, and how difficult the pairs are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Final

import numpy as np

from sips_lit.evaluate.result import PairSetResult, PairTable

QUANTILES: Final = {"least": 0.0, "25 %": 0.25, "median": 0.5, "75 %": 0.75, "most": 1.0}
_LISTED: Final = 6  # sequences that are named


def facts(result: PairSetResult) -> list[tuple[str, str]]:
    """Names and texts, those that are known."""
    return list(_facts(result))


def pair_statistics(pairs: PairTable) -> tuple[list[str], dict[str, list[str]]]:
    """Quantiles, as titles, and by what is known of the pairs their values: overlap, and how far the frames are apart."""
    known = {
        "overlap": pairs.overlap,
        "frames apart": pairs.gap,
        "moved in the image, px": pairs.pixels,
        "distance, m": pairs.translation,
        "angle, degrees": pairs.rotation,
    }
    rows = {
        title: [f"{value:.3g}" for value in np.nanquantile(values, list(QUANTILES.values()))]
        for title, values in known.items()
        if not np.isnan(values).all()
    }
    return list(QUANTILES), rows


def _facts(result: PairSetResult) -> Iterator[tuple[str, str]]:
    if not result.detectors:
        return
    counts = Counter(result.detectors[0].pairs.sequences)
    named = [f"{name} ({count})" if len(counts) > 1 else name for name, count in counts.items() if name]
    more = f" and {len(named) - _LISTED} more" if len(named) > _LISTED else ""
    sizes = result.protocol.get("image_size", ())
    if named:
        yield "sequence" if len(named) == 1 else "sequences (pairs)", ", ".join(named[:_LISTED]) + more
    if sizes and all(isinstance(size, str) for size in sizes):
        yield "images", ", ".join(sizes)
    yield "pairs", f"{len(result.detectors[0].pairs)}{_chosen(result)}"
    weights = {m.name: str(m.protocol["checkpoint"]) for m in result.detectors if "checkpoint" in m.protocol}
    for checkpoint in dict.fromkeys(weights.values()):
        names = ", ".join(name for name, own in weights.items() if own == checkpoint)
        yield "checkpoint", f"{checkpoint} ({names})"


def _chosen(result: PairSetResult) -> str:
    """How the pairs were chosen, as far as the protocol says it."""
    p = result.protocol
    if "pairs_file" in p:
        return f", listed in {p['pairs_file']}"
    if p.get("kind") == "first_to_others":
        return ", the first image of each sequence with its others"
    parts = [f"of overlap {p['overlap']} or more"] if "overlap" in p else []
    parts += [f"less than {p['overlap_below']}"] if "overlap_below" in p else []
    parts += [f"drawn with seed {p['seed']}"] if "overlap" in p and "seed" in p else []
    return "".join(f", {part}" for part in parts)
