"""How large an image is, from the first bytes of its file."""

from __future__ import annotations

import re
from pathlib import Path

from sips_lit.errors import BadInputError
from sips_lit.frames.images import read_grey

# PPM, PGM: magic, width, height, apart by white space and comments; PNG: signature, then the header chunk
_PNM = re.compile(rb"P[1-6](?:\s+|\s*#[^\n]*\n)+(\d+)(?:\s+|\s*#[^\n]*\n)+(\d+)\s")
_PNG = b"\x89PNG\r\n\x1a\n"


def image_size(path: Path) -> tuple[int, int]:
    """(W, H) of an image file. PPM, PGM and PNG tell it in their first bytes; others are decoded.

    Raises BadInputError when the file can't be read or is not an image.
    """
    try:
        with path.open("rb") as file:
            head = file.read(1024)
    except OSError as error:
        raise BadInputError(f"cannot read the image {path}: {error.strerror}") from error
    pnm = _PNM.match(head)
    if pnm:
        return int(pnm[1]), int(pnm[2])
    if head.startswith(_PNG) and len(head) >= 24:
        return int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")
    height, width = read_grey(path).shape
    return width, height
