"""The frames of a video file, as far as its data go: damage is told apart from the end, and counted."""

from __future__ import annotations

import bisect
import functools
import itertools
import logging
import re
import shlex
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any, cast

import av
import numpy as np
from av.container import InputContainer
from av.stream import Disposition
from av.video.stream import VideoStream
from numpy.typing import NDArray

from sips_lit.errors import BadInputError
from sips_lit.frames.images import to_grey
from sips_lit.frames.span import FULL, SAMPLE, Span, find_span
from sips_lit.types import GreyImage

logging.getLogger("libav").setLevel(logging.CRITICAL + 1)  # what other threads say meanwhile is not for the user
MOST_PIXELS = 2**26  # of a frame; a damaged header may ask for memory without end
_CODEC = re.compile(r"Video: (?:none \()?([^,/]+)")
_LOGGING = threading.Lock()  # the level of libav's messages belongs to the process


@dataclass(frozen=True, slots=True)
class VideoFrame:
    """A decoded frame; ``after_hole``: frames between it and the one before it could not be decoded."""

    decoded: av.VideoFrame
    after_hole: bool

    @property
    def size(self) -> tuple[int, int]:
        """(W, H) in pixels, upright."""
        width, height = self.decoded.width, self.decoded.height
        return (height, width) if self.decoded.rotation % 180 else (width, height)

    def colour(self) -> NDArray[np.uint8]:
        """BGR (H, W, 3) as OpenCV decodes it, turned upright where the file says how the camera was held."""
        return np.asarray(self._upright(self._as("bgr24")), np.uint8)

    @property
    def deep(self) -> bool:
        """Whether it is grey of more than 8 bits, as of thermal cameras."""
        form = self.decoded.format
        return form.name.startswith("gray") and form.components[0].bits > 8

    def values(self) -> NDArray[Any]:
        """BGR as `colour` gives it; of a deep grey frame its 16-bit values (H, W), scaled by the decoder to all 16 bits."""
        if not self.deep:
            return self.colour()
        return self._upright(self._as("gray16le"))

    def grey(self, span: Span) -> GreyImage:
        """Grey (H, W), upright; deep values are scaled by ``span``."""
        return to_grey(self.values(), "a frame", span)

    def _as(self, form: str) -> NDArray[Any]:
        return self.decoded.reformat(format=form, interpolation="BICUBIC").to_ndarray()  # as OpenCV has it

    def _upright(self, image: NDArray[Any]) -> NDArray[Any]:
        return np.ascontiguousarray(np.rot90(image, round(self.decoded.rotation / 90)))


@dataclass(slots=True)
class _Survey:
    """The packets of a file, numbered from 0: how many carry a frame, which are keyframes, which are damaged.

    ``complaints``: the numbers of the packets that the container damaged, or before which it lost others.
    """

    frames: int = 0
    keys: list[int] = field(default_factory=list)
    complaints: set[int] = field(default_factory=set)


@dataclass(frozen=True, slots=True)
class _Decoded:
    """After packet ``number``, whose frame is shown at ``time``: frames, each with the number of the packet it was in."""

    number: int
    time: int | None
    frames: list[tuple[int, av.VideoFrame]]
    broken: bool


class VideoFile:
    """A video, whose iteration gives every frame that can be decoded.

    Damage (a packet that is lost, cut or not decodable) does not end it: frames are taken again from the next keyframe on,
    or where none follows, as soon as the decoder finds no fault. After an iteration ``damage`` says in a sentence what is
    missing, None if nothing is. Numbers that the container promises don't count: dropped, trimmed and empty frames are
    no damage, nor is a beginning before the first keyframe.

    ``total``: how many frames the packets should give; ``fps``: frames per second, None if the file does not say;
    ``codec``: its name. Raises BadInputError when the file can't be opened, has no video, or is of a codec that can't be
    decoded, and while iterating when not a single frame can be.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage: str | None = None
        self.codec = "an unknown codec"
        with _errors(av.logging.WARNING) as messages, self._open() as container:
            # the picture on the cover of a record is no video
            videos = [s for s in container.streams.video if not s.disposition & Disposition.attached_pic]
            if not videos:
                raise BadInputError(f"{path} has no video in it: give a file with pictures, or a folder of images")
            stream, self._index = videos[0], videos[0].index
            if stream.codec_context is None:  # then only libav's warning tells what it is
                named = [match for *_, text in messages if (match := _CODEC.search(text))]
                self.codec = named[0][1].strip() if named else self.codec
                raise self._not_decodable()
            self.codec = stream.codec.name
            rate: Fraction | None = stream.average_rate or stream.guessed_rate
            self.fps = float(rate) if rate else None
        self._survey = self._read_packets()
        self.total = self._survey.frames

    @functools.cached_property
    def span(self) -> Span:
        """Which values of deep grey frames become 0 to 255, by a sample of all: one span for the video."""
        first = next(iter(self))
        if not first.deep:
            return FULL
        step = max(1, self.total // SAMPLE)
        sample = [frame.values() for frame in itertools.islice(self, 0, None, step)]
        return find_span(len(sample), lambda index: sample[index])

    def __iter__(self) -> Iterator[VideoFrame]:
        survey, self.damage = self._survey, None
        given, holes = 0, list[int]()  # frames given so far; how many were given before each hole
        # packets from ``bad_from`` on are passed over until the keyframe of packet ``key`` is out
        bad_from: int | None = None
        key: int | None = None
        lost: list[int] = []  # times of frames that are passed over
        # a stream that was recorded from somewhere within: what comes before its first keyframe is no damage
        joined = not survey.keys or survey.keys[0] > 0
        for packet in self._decode():
            faults = [packet.number] * packet.broken + [origin for origin, frame in packet.frames if frame.is_corrupt]
            for fault in faults:
                if (given or not joined) and (bad_from is None or (key is not None and fault >= key)):
                    bad_from, key = fault, _next_key(survey.keys, fault)
            if bad_from is not None and packet.broken and packet.time is not None:
                lost.append(packet.time)
            for origin, frame in packet.frames:
                after_damage = bad_from is not None and origin > bad_from
                if frame.is_corrupt or origin == bad_from or (after_damage and key is not None and origin != key):
                    lost += [] if frame.pts is None else [frame.pts]
                    continue
                if after_damage:
                    bad_from = key = None
                # a frame that was decoded before the damage may be shown after those that are lost
                passed = [time for time in lost if frame.pts is not None and time < frame.pts]
                after_hole = given > 0 and (after_damage or bool(passed))
                lost = [time for time in lost if time not in passed]
                if after_hole:
                    holes.append(given)
                given += 1
                yield VideoFrame(frame, after_hole)
        if not given:
            raise self._not_decodable()
        self.damage = self._describe(given, holes, ends_early=bad_from is not None)

    def _decode(self) -> Iterator[_Decoded]:
        """What comes out of the decoder after each packet, and at the end."""
        complaints, number = self._survey.complaints, -1
        with self._open() as container:
            stream = self._stream(container)
            stream.thread_type = "NONE"  # threads mark damaged frames later, or not at all
            stream.codec_context.copy_opaque = True
            stream.codec_context.options = {"max_pixels": str(MOST_PIXELS)}
            for number, packet in enumerate(_packets(container, stream)):
                packet.opaque = (number,)  # PyAV tells objects apart by their identity, and equal integers share theirs
                frames = [] if packet.is_corrupt else self._guarded(packet.decode)
                yield _Decoded(number, packet.pts, frames or [], broken=frames is None or number in complaints)
            frames = self._guarded(functools.partial(stream.codec_context.decode, None))
            yield _Decoded(number, None, frames or [], broken=False)
        if number + 1 in complaints:  # what the container says after the last packet
            yield _Decoded(number + 1, None, [], broken=True)

    def _guarded(self, decode: Callable[[], list[av.VideoFrame]]) -> list[tuple[int, av.VideoFrame]] | None:
        """The frames that the decoder gives, each with the number of its packet; None where the packet is damaged."""
        try:
            if self.codec == "mjpeg":  # this decoder marks no broken picture, and says so only in a message
                with _errors() as messages:
                    decoded = decode()
                if _taken(messages, self.codec):
                    return None
            else:
                decoded = decode()
            return [(cast(tuple[int], frame.opaque)[0], frame) for frame in decoded]
        except av.FFmpegError:
            return None

    def _describe(self, given: int, holes: list[int], ends_early: bool) -> str | None:
        """What is missing, in a sentence; None for nothing."""
        missing = max(self.total - given, len(holes) + ends_early)
        said = []
        if holes:
            places = ", ".join(map(str, holes[:3])) + (", ..." if len(holes) > 3 else "")
            said.append(f"frames are missing in {len(holes)} place{'s' * (len(holes) > 1)} (after {places} frames)")
        if ends_early:
            said.append(f"it ends early, after {given} frames")
        if not said:
            return None
        return f"{self.path} is damaged: {' and '.join(said)}; at least {missing} can't be decoded"

    def _read_packets(self) -> _Survey:
        """Reads all packets without decoding them; what a container complains of is known from libav's messages only."""
        survey, number = _Survey(), 0
        with _errors() as messages, self._open() as container:
            stream, name = self._stream(container), container.format.name
            again = _taken(messages, name)
            if again:  # libav has read ahead to open it: read that again, to learn which packet the message is about
                try:
                    container.seek(0, stream=stream)
                except av.FFmpegError:  # then nothing tells; the first is as likely as any
                    survey.complaints.add(0)
            for packet in _packets(container, stream):
                said = _taken(messages, name) and not (again and number == 0)
                if packet.is_corrupt or said:
                    survey.complaints.add(number)
                if packet.is_keyframe:
                    survey.keys.append(number)
                survey.frames += not packet.is_discard
                number += 1
            if _taken(messages, name):
                survey.complaints.add(number)
        return survey

    def _stream(self, container: InputContainer) -> VideoStream:
        stream = container.streams[self._index]
        assert isinstance(stream, VideoStream)
        return stream

    def _open(self) -> InputContainer:
        try:
            return av.open(str(self.path.absolute()), metadata_errors="replace")
        except av.FFmpegError as error:
            if isinstance(error, OSError) and not self.path.is_file():
                raise BadInputError(f"cannot read the video {self.path}: {error.strerror}") from error
            raise BadInputError(
                f"{self.path} is no video that can be read: it is damaged, empty or something else; check it or get it again"
            ) from error

    def _not_decodable(self) -> BadInputError:
        better = self.path.with_name(f"{self.path.stem}_h264.mp4").name
        return BadInputError(
            f"no frame of {self.path} ({self.codec}) can be decoded: it is damaged, or of an unknown kind; try to "
            f"convert it: ffmpeg -i {shlex.quote(str(self.path))} -c:v libx264 -crf 16 {shlex.quote(better)}"
        )


@contextmanager
def _errors(level: int = av.logging.ERROR) -> Iterator[list[tuple[int, str, str]]]:
    """A list that receives libav's messages of this thread, down to ``level``, as (level, who says it, text)."""
    with _LOGGING:
        before, skip = av.logging.get_level(), av.logging.get_skip_repeated()
        av.logging.set_level(level)
        av.logging.set_skip_repeated(False)
        try:
            with av.logging.Capture() as messages:
                yield messages
        finally:
            av.logging.set_level(before)
            av.logging.set_skip_repeated(skip)


def _taken(messages: list[tuple[int, str, str]], name: str) -> bool:
    """Whether ``name`` is among those who said something; empties the list."""
    said = any(who == name for _, who, _ in messages)
    messages.clear()
    return said


def _packets(container: InputContainer, stream: VideoStream) -> Iterator[av.Packet[VideoStream]]:
    """The packets of a stream that hold something, up to the end of the file or an error of reading."""
    try:
        yield from (packet for packet in container.demux(stream) if packet.size)
    except av.FFmpegError as error:
        av.logging.log(av.logging.ERROR, container.format.name, str(error))


def _next_key(keys: list[int], after: int) -> int | None:
    """The number of the first keyframe's packet after another packet, if one follows."""
    at = bisect.bisect_right(keys, after)
    return keys[at] if at < len(keys) else None
