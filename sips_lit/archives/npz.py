"""Numpy's npz archives of strangers: numbers and text only, sizes checked before anything is unpacked."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sips_lit.archives.zip_members import check_member, is_bomb, list_members, read_member
from sips_lit.errors import BadInputError

PLAIN = "biufU"  # kinds of values: truth, whole numbers, floating-point numbers, text; never objects, which are code


def npz_members(path: Path) -> dict[str, zipfile.ZipInfo]:
    """What holds the arrays of an archive, by their names, for `read_array`; no array is read.

    Raises BadInputError for what is no such archive, and a member that is encrypted, strangely packed or too large.
    """
    members = {m.filename.removesuffix(".npy"): m for m in list_members(path, "an npz archive")}
    for member in members.values():
        check_member(path, member, "write it again with numpy.savez")
    return members


def read_array(path: Path, member: zipfile.ZipInfo) -> NDArray[Any]:
    """An array of an archive. Raises BadInputError where it is damaged, or is none of numbers or text."""
    data = read_member(path, member)
    file = io.BytesIO(data)
    try:
        read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
        shape, by_column, dtype = read_header[np.lib.format.read_magic(file)](file)
        if dtype.kind not in PLAIN or math.prod(shape) * dtype.itemsize != len(data) - file.tell():
            raise ValueError(f"an array {shape} of {dtype}")
        values = np.frombuffer(bytearray(data), dtype, offset=file.tell())  # of bytes it would be read-only
        return values.reshape(shape, order="F" if by_column else "C")
    except Exception as error:  # a damaged header makes numpy raise almost anything
        raise BadInputError(
            f"{member.filename} in {path} is not a plain array of numbers, or is damaged: get the file again"
        ) from error


def read_npz(path: Path, names: Container[str] | None = None) -> dict[str, NDArray[Any]]:
    """The arrays of an archive, all of them or those of ``names`` that it has.

    Raises BadInputError as `npz_members` and `read_array` do, and where all together are too large.
    """
    members = {name: member for name, member in npz_members(path).items() if names is None or name in names}
    if is_bomb(path, members.values()):
        raise BadInputError(f"{path} claims more bytes than there can be: get the file again")
    return {name: read_array(path, member) for name, member in members.items()}
