"""The frames of a video file, as far as its data go: damage is told apart from the end, and counted."""

from __future__ import annotations

import bisect
import functools
import itertools
import logging
import re
import shlex
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import cast

import av
from av.codec.context import Flags
from av.container import InputContainer
from av.stream import Disposition
from av.video.reformatter import VideoReformatter
from av.video.stream import VideoStream

from sips_lit.errors import BadInputError, warn_input
from sips_lit.frames.span import FULL, SAMPLE, Span, find_span
from sips_lit.frames.video_frame import VideoFrame

logging.getLogger("libav").setLevel(logging.CRITICAL + 1)  # what other threads say meanwhile is not for the user
MOST_PIXELS = 2**26  # of a frame; a damaged header may ask for memory without end
MOST_REORDERED = 16  # packets between a frame and one that is shown before it
TELLERS = frozenset({"mjpeg", "ffv1", "hevc"})  # codecs whose decoders mark no broken frame, but say so in a message
TRUSTING = frozenset({"h264", "hevc", "vp8", "vp9"})  # codecs whose decoders notice less, or little
ZEROS = bytes(64)  # within a packet of theirs: a part of the file that was never written
_CODEC = re.compile(r"Video: (?:none \()?([^,/]+)")
_LOGGING = threading.Lock()  # the level of libav's messages belongs to the process


@dataclass(slots=True)
class _Survey:
    """The packets of a file, numbered from 0: how many carry a frame, which are keyframes, which are damaged.

    ``complaints``: the numbers of the packets that the container damaged, or before which it lost others. ``edge``: time of
    the last frame of a file that was cut, where frames that are shown before it may have come after it.
    """

    frames: int = 0
    keys: list[int] = field(default_factory=list)
    complaints: set[int] = field(default_factory=set)
    edge: int | None = None


@dataclass(frozen=True, slots=True)
class _Decoded:
    """After packet ``number``, whose frame is shown at ``time``: frames, each with the number of the packet it was in.

    ``broken``: the packet is damaged; ``shown``: it is a packet whose frame should come out, now or later.
    """

    number: int
    time: int | None
    frames: list[tuple[int, av.VideoFrame]]
    broken: bool
    shown: bool


class VideoFile:
    """A video, whose iteration gives every frame that can be decoded.

    Damage (a packet that is lost, cut or not decodable) does not end it: frames are taken again from the next keyframe on,
    and until then none that needs what is damaged; or where no keyframe follows, as soon as the decoder finds no fault.
    After an iteration ``damage`` says in a sentence what is missing, None if nothing is. Numbers that the container promises
    don't count: dropped, trimmed and empty frames are no damage, nor is a beginning before the first keyframe.

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
            stream = max(videos, key=lambda s: s.width * s.height if s.codec_context else 0)  # not a preview
            self._index = stream.index
            if len(videos) > 1:
                warn_input(
                    f"{path} has {len(videos)} videos in it: the first of the largest is read, stream {stream.index}"
                )
            if stream.codec_context is None:  # then only libav's warning tells what it is
                named = [match for *_, text in messages if (match := _CODEC.search(text))]
                self.codec = named[0][1].strip() if named else self.codec
                raise self._not_decodable()
            self.codec = stream.codec.name
            rates: tuple[Fraction | None, ...] = (stream.average_rate, stream.guessed_rate)
            rate = next(filter(None, rates if container.duration else rates[::-1]), None)  # raw streams: in the codec
            self.fps = float(rate) if rate else None
            self._survey = self._read_packets(container, stream, messages)
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
        self.damage, keys, reformatter = None, self._survey.keys, VideoReformatter()
        faults: list[int] = []  # numbers of damaged packets, sorted
        start = 0  # faults before this packet do no harm any more
        given, holes, guessed = 0, list[int](), False  # frames given so far; how many were given before each hole
        lost: list[int] = []  # times of frames that are not given
        for packet in self._settled(faults):
            if packet.broken and packet.time is not None:
                lost.append(packet.time)
            for origin, frame in packet.frames:
                fault = _last(faults, start, origin)
                keyless = fault is not None and keys[-1:] <= [fault]
                if frame.is_corrupt or fault == origin or not (fault is None or keyless or origin in keys):
                    lost += [] if frame.pts is None else [frame.pts]
                    continue
                # a frame that was decoded before the damage may be shown after those that are lost
                edge = frame.pts is not None and frame.pts == self._survey.edge
                passed = [time for time in lost if frame.pts is not None and time < frame.pts]
                lost = [time for time in lost if time not in passed]
                if fault is not None or (given and (passed or edge)):
                    holes.append(given)
                if fault is not None:
                    start, guessed = origin, guessed or keyless
                yield VideoFrame(frame, given > 0 and given in holes[-1:], reformatter)
                given += 1
        if not given:
            raise self._not_decodable()
        ends_early = bool(faults) and faults[-1] >= start
        self.damage = self._describe(given, holes, ends_early, guessed)

    def _settled(self, faults: list[int]) -> Iterator[_Decoded]:
        """What `_decode` gives, each when the packets that its frames may need have come out; ``faults`` grows ahead of it.

        A frame is shown before others that it needs, whose damage is known only as they come out. Until a first frame is
        decoded only damaged keyframes count: a recording may have been joined between or begin with frames of another.
        """
        waiting, inside, begun, fields = deque[_Decoded](), set[int](), False, self.codec != "h264"
        for packet in self._decode():
            frames = {origin: frame.is_corrupt for origin, frame in packet.frames}
            fields |= any(frame.interlaced_frame for _, frame in packet.frames)  # two packets may make one frame
            inside = (inside | ({packet.number} if packet.shown else set())) - frames.keys()
            gone = {n for n in inside if n <= packet.number - MOST_REORDERED}
            inside -= gone
            corrupt = {origin for origin, is_corrupt in frames.items() if is_corrupt}
            for fault in corrupt | ({packet.number} if packet.broken else set()) | (set() if fields else gone):
                if (begun or fault in self._survey.keys) and _last(faults, fault, fault) is None:
                    bisect.insort(faults, fault)
            begun |= frames.keys() > corrupt
            waiting.append(packet)
            while waiting and not any(n < origin for n in inside for origin, _ in waiting[0].frames):
                yield waiting.popleft()
        yield from waiting

    def _decode(self) -> Iterator[_Decoded]:
        """What comes out of the decoder after each packet, and at the end."""
        complaints, number = self._survey.complaints, -1
        with self._open() as container:
            stream = self._stream(container)
            stream.thread_type = "NONE"  # threads mark damaged frames later, or not at all
            stream.codec_context.copy_opaque = True
            stream.codec_context.flags |= Flags.output_corrupt  # else some decoders leave such frames out silently
            stream.codec_context.options = {"max_pixels": str(MOST_PIXELS)}
            for number, packet in enumerate(_packets(container, stream)):
                packet.opaque = (number,)  # PyAV tells objects apart by their identity, and equal integers share theirs
                frames = [] if packet.is_corrupt else self._guarded(packet.decode)
                broken, shown = frames is None or number in complaints, not packet.is_discard
                yield _Decoded(number, packet.pts, frames or [], broken, shown)
            frames = self._guarded(functools.partial(stream.codec_context.decode, None))
            yield _Decoded(number + MOST_REORDERED, None, frames or [], broken=False, shown=False)
        if number + 1 in complaints:  # what the container says after the last packet
            yield _Decoded(number + 1, None, [], broken=True, shown=False)

    def _guarded(self, decode: Callable[[], list[av.VideoFrame]]) -> list[tuple[int, av.VideoFrame]] | None:
        """The frames that the decoder gives, each with the number of its packet; None where the packet is damaged."""
        try:
            if self.codec in TELLERS:
                with _errors() as messages:
                    decoded = decode()
                if _taken(messages, self.codec):
                    return None
            else:
                decoded = decode()
            return [(cast(tuple[int], frame.opaque)[0], frame) for frame in decoded]
        except av.FFmpegError:
            return None

    def _describe(self, given: int, holes: list[int], ends_early: bool, guessed: bool) -> str | None:
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
        rest = "; no keyframe follows the last, so that later frames may be wrong in parts" if guessed else ""
        return f"{self.path} is damaged: {' and '.join(said)}; at least {missing} can't be decoded{rest}"

    def _read_packets(
        self, container: InputContainer, stream: VideoStream, messages: list[tuple[int, str, str]]
    ) -> _Survey:
        """Reads all packets without decoding them; what a container complains of is known from libav's messages only."""
        survey, number, times, name = _Survey(), 0, list[int](), container.format.name
        again = _taken(messages, name)
        if again:  # libav has read ahead to open it: read that again, to learn which packet the message is about
            try:
                container.seek(0, stream=stream)
            except av.FFmpegError:  # then nothing tells; the first is as likely as any
                survey.complaints.add(0)
        for packet in _packets(container, stream):
            said = _taken(messages, name)
            if said and (number or not again):  # the packet before may have been read too far
                survey.complaints |= {number - 1, number}
            if packet.is_corrupt or (self.codec in TRUSTING and ZEROS in bytes(packet).rstrip(b"\0")):
                survey.complaints.add(number)
            if packet.pts is not None:
                times.append(packet.pts)
            if packet.is_keyframe:
                survey.keys.append(number)
            survey.frames += not packet.is_discard
            number += 1
        if _taken(messages, name):
            survey.complaints.add(number)
        if survey.complaints & {number - 1, number} and times != sorted(times):
            survey.edge = max(times)
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
    """Whether ``name`` is among those who told an error; empties the list."""
    said = any(level <= av.logging.ERROR and who == name for level, who, _ in messages)
    messages.clear()
    return said


def _packets(container: InputContainer, stream: VideoStream) -> Iterator[av.Packet[VideoStream]]:
    """The packets of a stream that hold something, up to the end of the file or an error of reading."""
    try:
        yield from (packet for packet in container.demux(stream) if packet.size)
    except av.FFmpegError as error:
        av.logging.log(av.logging.ERROR, container.format.name, str(error))
    except IndexError:  # at the end PyAV flushes all streams, also one that began on the way, which it does not know
        return


def _last(numbers: list[int], low: int, high: int) -> int | None:
    """The last of sorted numbers from ``low`` to ``high``, if there is one."""
    at = bisect.bisect_right(numbers, high) - 1
    return numbers[at] if at >= 0 and numbers[at] >= low else None
