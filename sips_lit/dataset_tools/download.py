"""Fetching large files: resumed after a lost connection, checked, and never half a file under its final name.

Own code, since pooch and urllib don't resume: pooch 1.9 sends no Range and deletes its temporary file when the connection
is lost, so that 23 GB of KITTI would start from zero; and it doesn't look at the free disk space.
"""

from __future__ import annotations

import hashlib
import http.client
import time
import urllib.error
import urllib.request
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from sips_lit.dataset_tools.unpack import check_space
from sips_lit.errors import BadInputError
from sips_lit.files import make_folder
from sips_lit.progress import progress

CATALOGUE = Path(__file__).with_name("catalogue.yaml")
CHUNK = 1 << 20
LOST = (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError)


@dataclass(frozen=True, slots=True)
class RemoteFile:
    """A file to fetch; ``bytes`` is about its size, ``sha256`` its checksum where one is known."""

    url: str
    bytes: int
    sha256: str | None = None

    @property
    def name(self) -> str:
        """What it is called here."""
        return self.url.rsplit("/", 1)[-1]


@dataclass(frozen=True, slots=True)
class Offer:
    """A data set that can be fetched; after unpacking, it lies at ``path`` in its folder."""

    name: str
    title: str
    page: str
    path: str
    files: tuple[RemoteFile, ...]

    @property
    def bytes(self) -> int:
        """About how much is fetched."""
        return sum(file.bytes for file in self.files)


def read_catalogue(path: Path = CATALOGUE) -> dict[str, Offer]:
    """What can be fetched, by name."""
    entries: Mapping[str, Any] = yaml.safe_load(path.read_text())
    return {
        name: Offer(name, e["title"], e["page"], e["path"], tuple(RemoteFile(**f) for f in e["files"]))
        for name, e in entries.items()
    }


def remote_size(url: str, timeout: float = 20) -> int | None:
    """How many bytes the server says a file has; None if it doesn't say.

    Raises BadInputError when the server can't be reached, or has no such file.
    """
    try:
        with urllib.request.urlopen(urllib.request.Request(url, method="HEAD"), timeout=timeout) as answer:
            length = answer.headers.get("Content-Length")
    except urllib.error.HTTPError as error:
        raise _refused(url, error) from error
    except LOST as error:
        raise BadInputError(
            f"{url} can't be reached ({_reason(error)}): check the network, or fetch it by hand"
        ) from error
    return int(length) if length else None


def fetch(file: RemoteFile, folder: Path, attempts: int = 5, pause: float = 2.0, timeout: float = 30) -> Path:
    """Fetches a file into ``folder`` unless it is there, going on with a part that an interrupted run left.

    A lost connection is taken up again, up to ``attempts`` times without any progress, after ``pause`` seconds. Raises
    BadInputError when the server refuses, the disk is too full, or the checksum is wrong (the file is then removed).
    """
    make_folder(folder)
    path, part = folder / file.name, folder / f"{file.name}.part"
    failures = 0
    while not path.exists():
        before, reason = _size(part), "the connection was closed early"
        try:
            if _go_on(file.url, part, timeout):
                _verify(part, file)
                part.replace(path)
                break
        except urllib.error.HTTPError as error:
            raise _refused(file.url, error) from error
        except LOST as error:
            reason = _reason(error)
        failures = 1 if _size(part) > before else failures + 1
        if failures >= attempts:
            raise BadInputError(f"{file.url} can't be fetched ({reason}): run the command again to go on from {part}")
        time.sleep(pause)
    return path


def _go_on(url: str, part: Path, timeout: float) -> bool:
    """Appends what is missing of a file; whether it is whole now."""
    tag_file = part.with_suffix(".tag")
    have, tag = _size(part), tag_file.read_text() if tag_file.exists() else ""
    request = urllib.request.Request(url)
    if have and tag:
        request.add_header("Range", f"bytes={have}-")
        request.add_header("If-Range", tag)  # a file that has changed comes whole
    try:
        answer = urllib.request.urlopen(request, timeout=timeout)
    except urllib.error.HTTPError as error:
        if error.code == http.HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE and have:
            return True  # everything was there already
        raise
    with answer:
        have = have if answer.status == http.HTTPStatus.PARTIAL_CONTENT else 0
        length = answer.headers.get("Content-Length")
        total = have + int(length) if length else None
        needed = (total or have) - have
        check_space(part.parent, needed, f"{part.stem} needs {needed / 1e9:.1f} GB more")
        tag_file.write_text(answer.headers.get("ETag") or answer.headers.get("Last-Modified") or "")
        with (
            part.open("ab" if have else "wb") as out,
            progress(desc=part.stem, unit="B", total=total, initial=have) as bar,
        ):
            while chunk := answer.read(CHUNK):
                out.write(chunk)
                bar.update(len(chunk))
    whole = total is None or _size(part) == total
    if whole:
        tag_file.unlink(missing_ok=True)
    return whole


def _verify(part: Path, file: RemoteFile) -> None:
    if file.sha256 is None:
        return
    with part.open("rb") as handle:
        found = hashlib.file_digest(handle, "sha256").hexdigest()
    if found != file.sha256.lower():
        part.unlink()
        raise BadInputError(
            f"{file.url} has the checksum {found}, not {file.sha256}: it was damaged or replaced, and is removed"
        )


def _refused(url: str, error: urllib.error.HTTPError) -> BadInputError:
    return BadInputError(f"{url} answers {error.code} ({error.reason}): the data may have moved")


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _reason(error: Exception) -> str:
    return str(getattr(error, "reason", error)) or type(error).__name__
