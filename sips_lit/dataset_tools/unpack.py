"""Unpacking archives from strangers: nothing lands outside the target, and nothing fills the disk unasked."""

from __future__ import annotations

import gzip
import shutil
import stat
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import IO

from tqdm import tqdm

from sips_lit.errors import BadInputError
from sips_lit.files import make_folder

MAX_RATIO = 200  # images hardly shrink: an archive that grows so much is a bomb
SPARE_BYTES = 200_000_000  # left free on the disk
CHUNK = 1 << 20


def unpack(archive: Path, target: Path) -> int:
    """Unpacks a zip or tar archive into the folder ``target`` and returns how many files it wrote.

    Raises BadInputError, before anything is written, for a member whose path or link leads out of the target, for an
    archive that would grow more than `MAX_RATIO` times or not fit on the disk; and for a damaged one.
    """
    make_folder(target)
    try:
        if zipfile.is_zipfile(archive):
            with zipfile.ZipFile(archive) as opened:
                return _unpack_zip(opened, archive, target)
        with tarfile.open(archive) as packed:
            return _unpack_tar(packed, archive, target)
    except (tarfile.TarError, zipfile.BadZipFile, zlib.error, gzip.BadGzipFile, EOFError) as error:
        raise BadInputError(f"{archive} is damaged ({error}): remove it and download it again") from error


def _unpack_zip(opened: zipfile.ZipFile, archive: Path, target: Path) -> int:
    members = [member for member in opened.infolist() if not member.is_dir()]
    for member in members:
        _check_name(member.filename, archive)
        if stat.S_ISLNK(member.external_attr >> 16):
            raise BadInputError(f"{archive} holds the link {member.filename}: refused, since links may lead anywhere")
    _check_size(sum(member.file_size for member in members), archive, target)
    for member in tqdm(members, desc=f"unpacking {archive.name}", unit="file", delay=2):
        with opened.open(member) as source:
            _write(source, target, member.filename, member.file_size, archive)
    return len(members)


def _unpack_tar(packed: tarfile.TarFile, archive: Path, target: Path) -> int:
    members = list(_files(packed, archive))
    _check_size(sum(member.size for member in members), archive, target)
    for member in tqdm(members, desc=f"unpacking {archive.name}", unit="file", delay=2):
        source = packed.extractfile(member)
        if source is not None:
            with source:
                _write(source, target, member.name, member.size, archive)
    return len(members)


def _files(packed: tarfile.TarFile, archive: Path) -> Iterator[tarfile.TarInfo]:
    for member in packed:
        if member.isdir():
            continue
        _check_name(member.name, archive)
        if not member.isfile():
            raise BadInputError(f"{archive} holds {member.name}, which is a link or a device: refused")
        yield member


def _check_name(name: str, archive: Path) -> None:
    path = PurePosixPath(name.replace("\\", "/"))
    if path.is_absolute() or ".." in path.parts or ":" in path.parts[0]:
        raise BadInputError(f"{archive} holds {name!r}, which would be written outside of the target folder: refused")


def _check_size(size: int, archive: Path, target: Path) -> None:
    if size > MAX_RATIO * max(archive.stat().st_size, 1):
        raise BadInputError(f"{archive} would grow to {size / 1e9:.1f} GB, over {MAX_RATIO} times its size: refused")
    free = shutil.disk_usage(target).free - SPARE_BYTES
    if size > free:
        raise BadInputError(f"{archive} needs {size / 1e9:.1f} GB, but {target} has {max(free, 0) / 1e9:.1f} GB free")


def _write(source: IO[bytes], target: Path, name: str, size: int, archive: Path) -> None:
    """Writes one member; a header that lies about its size is found out here, and a link that was in the target before."""
    path = target / name
    if not path.resolve().is_relative_to(target.resolve()):
        raise BadInputError(f"{path} would be written through a link to {path.resolve()}: remove the link")
    make_folder(path.parent)
    left = size
    with path.open("wb") as out:
        while chunk := source.read(min(CHUNK, left + 1)):
            left -= len(chunk)
            if left < 0:
                raise BadInputError(f"{archive} holds {path.name} with more than the {size} bytes it declares: refused")
            out.write(chunk)
