"""Unpacking archives from strangers: nothing lands outside the target, and nothing fills the disk unasked."""

from __future__ import annotations

import errno
import shutil
import stat
import tarfile
import zipfile
from pathlib import Path, PurePosixPath

from sips_lit.errors import BadInputError
from sips_lit.files import make_folder
from sips_lit.progress import progress

MAX_RATIO = 200  # images hardly shrink: an archive that grows so much is a bomb
SPARE_BYTES = 200_000_000  # left free on the disk


def unpack(archive: Path, target: Path) -> int:
    """Unpacks a zip or tar archive into the folder ``target`` and returns how many files it wrote.

    Raises BadInputError, before anything is written, for a link, a member whose path leads out of the target (by itself or
    through a link there), an archive that would grow more than `MAX_RATIO` times or not fit on the disk; and for a damaged
    one, such as one with a member larger than declared.
    """
    make_folder(target)
    try:
        if zipfile.is_zipfile(archive):
            with zipfile.ZipFile(archive) as opened:
                return _unpack_zip(opened, archive, target)
        with tarfile.open(archive) as packed:
            return _unpack_tar(packed, archive, target)
    except BadInputError:
        raise
    except Exception as error:  # damaged bytes make zipfile and tarfile raise almost anything
        if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL, errno.ENAMETOOLONG):
            raise  # of the disk
        reason = str(error).partition("\n")[0].rstrip(":")
        raise BadInputError(f"{archive} is damaged ({reason}): remove it and download it again") from error


def _unpack_zip(opened: zipfile.ZipFile, archive: Path, target: Path) -> int:
    members = [member for member in opened.infolist() if not member.is_dir()]
    for member in members:
        _check_member(member.filename, stat.S_ISLNK(member.external_attr >> 16), archive, target)
    _check_size(sum(member.file_size for member in members), archive, target)
    for member in progress(members, desc=f"unpacking {archive.name}", unit="file"):
        opened.extract(member, target)
    return len(members)


def _unpack_tar(packed: tarfile.TarFile, archive: Path, target: Path) -> int:
    members, size = list[tarfile.TarInfo](), 0
    for member in packed:  # which unpacks what is between their headers: a bomb must end it
        if not member.isdir():
            _check_member(member.name, not member.isfile(), archive, target)
            size += member.size
            _check_size(size, archive, target)
            members.append(member)
    for member in progress(members, desc=f"unpacking {archive.name}", unit="file"):
        packed.extract(member, target, filter="data")
    return len(members)


def _check_member(name: str, special: bool, archive: Path, target: Path) -> None:
    """The libraries would write some of these under another name, and zipfile follows links in the target."""
    path = PurePosixPath(name.replace("\\", "/"))
    if path.is_absolute() or ".." in path.parts or not path.parts or ":" in path.parts[0]:
        raise BadInputError(f"{archive} holds {name!r}, which would be written outside of the target folder: refused")
    if special:
        raise BadInputError(
            f"{archive} holds {name}, which is a link or a device: refused, since links may lead anywhere"
        )
    place = (target / name).resolve()
    if not place.is_relative_to(target.resolve()):
        raise BadInputError(f"{target / name} would be written through a link to {place}: remove the link")


def _check_size(size: int, archive: Path, target: Path) -> None:
    if size > MAX_RATIO * max(archive.stat().st_size, 1):
        raise BadInputError(f"{archive} would grow to {size / 1e9:.1f} GB, over {MAX_RATIO} times its size: refused")
    check_space(target, size, f"{archive} needs {size / 1e9:.1f} GB")


def check_space(folder: Path, needed: int, problem: str) -> None:
    """Raises BadInputError, with the problem in words, where a folder's disk has not so many bytes free."""
    free = shutil.disk_usage(folder).free - SPARE_BYTES
    if needed > free:
        raise BadInputError(f"{problem}, but {folder} has {max(free, 0) / 1e9:.1f} GB free")
