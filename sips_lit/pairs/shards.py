"""Shares of a data set for several machines."""

from __future__ import annotations

import re
from collections.abc import Iterable

from sips_lit.errors import BadInputError
from sips_lit.frames.recording import Recording


def share(recordings: Iterable[Recording], shard: str) -> list[Recording]:
    """Share ``i/n`` of the recordings in the order of ``where``: number i, i + n, i + 2n, ..., counted from 1.

    Every recording is in exactly one of the shares 1/n to n/n. Raises BadInputError for anything but 1 <= i <= n.
    """
    written = re.fullmatch(r"(\d+)/(\d+)", shard)
    number, count = (int(written[1]), int(written[2])) if written else (0, 0)
    if not 1 <= number <= count:
        raise BadInputError(
            f"shard is {shard}: give a part and the number of parts, 1/4, 2/4, 3/4 or 4/4 for four of them"
        )
    return sorted(recordings, key=lambda recording: recording.where)[number - 1 :: count]
