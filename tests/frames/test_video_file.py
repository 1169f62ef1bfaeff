"""Damage of videos, and what is no damage, in the containers and codecs that people have."""

import functools
import struct
from collections.abc import Callable
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from textured_scenes import flight
from video_files import decoded

from sips_lit.errors import BadInputError, InputWarning
from sips_lit.frames.span import FULL
from sips_lit.frames.video_file import VideoFile

FRAMES, GROUP = 60, 12  # a keyframe every 12 frames


@functools.cache
def marked() -> list[np.ndarray]:
    """Frames that tell their own number in binary, by blocks of 16 pixels in the first rows."""
    images = [frame.copy() for frame in flight(FRAMES, size=(320, 240)).frames]
    for number, image in enumerate(images):
        for bit in range(6):
            image[:16, 16 * bit : 16 * bit + 16] = 255 * (number >> bit & 1)
    return images


def numbers(video: VideoFile) -> list[int]:
    """The numbers that the frames of a video tell."""
    blocks = [frame.grey(FULL)[4:12, 4:96].reshape(8, -1) for frame in video]
    return [sum(int(block[:, 16 * bit : 16 * bit + 8].mean() > 127) << bit for bit in range(6)) for block in blocks]


def holes(video: VideoFile) -> list[int]:
    return [index for index, frame in enumerate(video) if frame.after_hole]


def damaged(path: Path, change: Callable[[bytearray], None]) -> VideoFile:
    data = bytearray(path.read_bytes())
    change(data)
    broken = path.with_name(f"broken{path.suffix}")
    broken.write_bytes(data)
    return VideoFile(broken)


def cut(share: float) -> Callable[[bytearray], None]:
    def change(data: bytearray) -> None:
        del data[int(share * len(data)) :]

    return change


def zero(share: float, count: int = 3000) -> Callable[[bytearray], None]:
    def change(data: bytearray) -> None:
        start = int(share * len(data))
        data[start : start + count] = bytes(count)

    return change


OPEN_GROUPS = f"keyint={GROUP}:min-keyint={GROUP}:scenecut=0:open-gop=1:bframes=3:b-adapt=0"
OPTIONS = {
    "libx264": {"x264-params": OPEN_GROUPS},
    "libx265": {"x265-params": f"log-level=none:{OPEN_GROUPS}", "preset": "ultrafast"},
    "closed": {"x264-params": OPEN_GROUPS.replace("open-gop=1", "open-gop=0")},
    "libvpx": {"deadline": "realtime", "cpu-used": "8", "threads": "1"},
    "libvpx-vp9": {"deadline": "realtime", "cpu-used": "8"},
}
CONTAINERS = [
    ("mp4", "libx264"),
    ("h264", "libx264"),
    ("mov", "libx265"),
    ("webm", "libvpx"),
    ("mkv", "ffv1"),
    ("mkv", "libx264"),
    ("ts", "libx264"),
    ("flv", "libx264"),
    ("avi", "mpeg4"),
    ("avi", "mjpeg"),
    ("webm", "libvpx-vp9"),
    ("mpg", "mpeg2video"),
]


def encode(path: Path, codec: str) -> Path:
    """The marked frames as a video."""
    flags = {"movflags": "faststart"} if path.suffix in (".mp4", ".mov") else {}
    with av.open(str(path), "w", options=flags) as container:
        stream = container.add_stream("libx264" if codec == "closed" else codec, rate=30)
        stream.width, stream.height, stream.gop_size, stream.bit_rate = 320, 240, GROUP, 2_000_000
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        stream.options = OPTIONS.get(codec, {})
        for image in marked():
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, "gray").reformat(format=stream.pix_fmt)))
        container.mux(stream.encode(None))
    return path


@pytest.fixture(scope="module", params=CONTAINERS, ids="-".join)
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    suffix, codec = request.param
    return encode(tmp_path_factory.mktemp("whole") / f"whole.{suffix}", codec)


def test_a_whole_file(whole: Path):
    video = VideoFile(whole)
    assert numbers(video) == list(range(FRAMES))
    assert (video.damage, holes(video), video.total) == (None, [], FRAMES)
    assert video.fps == pytest.approx(30, rel=0.01)


def test_a_download_cut_short(whole: Path):
    video = damaged(whole, cut(0.6))
    found = numbers(video)
    steps = np.diff(found)
    assert 20 < len(found) < 50
    assert (steps > 0).all()
    assert set(np.flatnonzero(steps > 1) + 1) <= set(
        holes(video)
    )  # frames that are shown before the last come after it
    assert found[: len(found) - 1] == list(range(len(found) - 1))
    assert video.damage is not None
    assert f"it ends early, after {len(found)} frames" in video.damage


def test_a_damaged_middle(whole: Path):
    """Every frame that is given is right in each pixel: none needs what is damaged, not even one that is shown before it."""
    video = damaged(whole, zero(0.5))
    found = numbers(video)
    right = [frame.grey(FULL) for frame in VideoFile(whole)]
    np.testing.assert_array_equal([frame.grey(FULL) for frame in video], [right[number] for number in found])
    assert found[-1] == FRAMES - 1
    assert len(found) < FRAMES
    steps = np.diff(found)
    assert (steps > 0).all()
    assert video.damage is not None
    gaps = (np.flatnonzero(steps > 1) + 1).tolist()
    assert holes(video) == gaps
    assert f"missing in {len(gaps)} place" in video.damage
    assert steps.max() <= 2 * GROUP  # frames are read again from the next keyframe or cluster on


def test_a_damaged_beginning_is_told(tmp_path: Path):
    video = damaged(encode(tmp_path / "whole.mp4", "libx264"), zero(0.06))
    found = numbers(video)
    assert found == list(range(found[0], FRAMES))
    assert found[0] > 0
    assert holes(video) == []
    assert video.damage is not None
    assert "in 1 place (after 0 frames)" in video.damage


def test_where_no_keyframe_follows_it_is_said(tmp_path: Path):
    video = damaged(encode(tmp_path / "whole.avi", "mpeg4"), zero(0.95, 500))
    assert len(numbers(video)) > FRAMES - GROUP
    assert video.damage is not None
    assert "no keyframe follows the last, so that later frames may be wrong in parts" in video.damage


def remuxed(source: Path, path: Path, skip: int = 0, leave_out: int = -1) -> Path:
    """The packets of a video in another file, without the first ``skip`` and the one of number ``leave_out``."""
    with av.open(str(source)) as given, av.open(str(path), "w") as made:
        stream = made.add_stream_from_template(given.streams.video[0])
        packets = [packet for packet in given.demux(video=0) if packet.dts is not None]
        for number, packet in enumerate(packets):
            if number >= skip and number != leave_out:
                packet.stream = stream
                made.mux(packet)
    return path


def test_a_recording_that_begins_between_keyframes_is_whole(tmp_path: Path):
    video = VideoFile(remuxed(encode(tmp_path / "whole.ts", "libx264"), tmp_path / "joined.ts", skip=5))
    found = numbers(video)
    assert found == list(range(found[0], FRAMES))
    assert found[0] <= GROUP
    assert (video.damage, holes(video)) == (None, [])


def test_a_keyframe_that_is_cut_out(tmp_path: Path):
    """The decoder gives none of the frames that it can't place, and doesn't complain."""
    made = encode(tmp_path / "whole.mp4", "closed")
    video = VideoFile(remuxed(made, tmp_path / "cut.mp4", leave_out=2 * GROUP))
    assert numbers(video) == [*range(2 * GROUP), *range(3 * GROUP, FRAMES)]
    assert holes(video) == [2 * GROUP]
    assert video.damage is not None
    assert "in 1 place (after 24 frames)" in video.damage


def test_of_several_videos_the_largest_is_read(tmp_path: Path):
    path = tmp_path / "two.mp4"
    with av.open(str(path), "w") as container:
        streams = [container.add_stream("mpeg4", rate=10) for _ in range(2)]
        for stream, size in zip(streams, [(96, 64), (160, 120)], strict=True):
            stream.width, stream.height, stream.pix_fmt = *size, "yuv420p"
        for stream in streams:
            image = av.VideoFrame.from_ndarray(flight(1, size=(stream.width, stream.height)).frames[0], "gray")
            container.mux(stream.encode(image.reformat(format="yuv420p")))
            container.mux(stream.encode(None))
    with pytest.warns(InputWarning, match=r"two\.mp4 has 2 videos in it: the first of the largest is read, stream 1"):
        assert next(iter(VideoFile(path))).size == (160, 120)


def test_an_interlaced_frame_is_its_luma(tmp_path: Path):
    path = tmp_path / "fields.mpg"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg2video", rate=25)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = 320, 240, "yuv420p", 4_000_000
        stream.options = {"flags": "+ildct+ilme"}
        for image in marked()[:6]:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, "gray").reformat(format="yuv420p")))
        container.mux(stream.encode(None))
    for frame in VideoFile(path):
        assert frame.decoded.interlaced_frame
        luma = (frame.decoded.to_ndarray()[:240].astype(float) - 16) * 255 / 219
        assert np.abs(frame.grey(FULL) - luma).mean() < 1


def test_frames_equal_those_of_opencv(whole: Path):
    np.testing.assert_array_equal([frame.grey(FULL) for frame in VideoFile(whole)], decoded(whole))


@pytest.mark.parametrize("size", [(319, 240), (320, 239), (321, 237)])
def test_odd_sizes_equal_those_of_opencv(tmp_path: Path, size: tuple[int, int]):
    """Their chroma is interpolated."""
    path = tmp_path / "odd.mpg"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg2video", rate=25)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = *size, "yuv420p", 2_000_000
        for image in flight(6, size=size).frames:
            colour = cv2.applyColorMap(image, cv2.COLORMAP_JET)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(colour, "bgr24").reformat(format="yuv420p")))
        container.mux(stream.encode(None))
    np.testing.assert_array_equal([frame.grey(FULL) for frame in VideoFile(path)], decoded(path))


@pytest.mark.shared_data
@pytest.mark.parametrize("name", ["base.mp4", "gap.mp4", "vfr.webm", "drop.avi", "av1.mp4", "cam.MTS", "pi.h264"])
def test_whole_files_that_cameras_write(shared_cases: Path, name: str):
    video = VideoFile(shared_cases / name)
    frames = [frame.grey(FULL) for frame in video]
    assert (len(frames), video.total, video.damage) == (60, 60, None)
    if name in ("gap.mp4", "cam.MTS", "vfr.webm", "av1.mp4"):  # the same scene by another codec
        for frame, base in zip(frames[::10], list(VideoFile(shared_cases / "base.mp4"))[::10], strict=True):
            assert np.abs(frame.astype(int) - base.grey(FULL)).mean() < 6


@pytest.mark.shared_data
def test_a_download_cut_short_by_name(shared_cases: Path):
    video = VideoFile(shared_cases / "trunc.mp4")
    whole = [frame.grey(FULL) for frame in VideoFile(shared_cases / "base.mp4")]
    frames = [frame.grey(FULL) for frame in video]
    assert 34 <= len(frames) <= 37
    np.testing.assert_array_equal(frames, whole[: len(frames)])
    assert video.damage is not None
    assert "trunc.mp4 is damaged: it ends early" in video.damage


def test_what_is_no_video(tmp_path: Path):
    sound = tmp_path / "sound.wav"
    with av.open(str(sound), "w") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), layout="mono")
        frame.sample_rate = 8000
        container.mux(stream.encode(frame))
    with pytest.raises(BadInputError, match=r"sound\.wav has no video in it"):
        VideoFile(sound)
    (tmp_path / "text.mp4").write_text("no video at all\n" * 500)
    with pytest.raises(BadInputError, match=r"text\.mp4 is no video that can be read"):
        VideoFile(tmp_path / "text.mp4")
    with pytest.raises(BadInputError, match=r"cannot read the video .*gone\.mp4: No such file"):
        VideoFile(tmp_path / "gone.mp4")


def test_a_codec_that_is_not_known(tmp_path: Path, clip: Path):
    path = tmp_path / "my film.avi"
    path.write_bytes(clip.read_bytes().replace(b"MJPG", b"XYZ1"))
    advice = r"ffmpeg -i '.*my film\.avi'.*'my film_h264\.mp4'"
    with pytest.raises(BadInputError, match=rf"no frame of .*my film\.avi \(XYZ1\).*{advice}"):
        list(VideoFile(path))


def test_a_relative_name_with_a_colon(clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "12:30.avi").write_bytes(clip.read_bytes())
    monkeypatch.chdir(tmp_path)
    assert len(list(VideoFile(Path("12:30.avi")))) == 12


def test_one_range_for_a_thermal_video(tmp_path: Path):
    """14 bits of which a tenth is used: the contrast of the scene stays, and is the same in all frames."""
    path, frames = tmp_path / "thermal.mkv", flight(20, size=(320, 240)).frames
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=10)
        stream.width, stream.height, stream.pix_fmt = 320, 240, "gray16le"
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(28900 + image.astype(np.uint16) * 4, "gray16le")))
        container.mux(stream.encode(None))
    video = VideoFile(path)
    for given, image in zip(video, frames, strict=True):
        grey = given.grey(video.span)
        assert np.corrcoef(grey.ravel(), image.ravel())[0, 1] > 0.999
        assert grey.std() == pytest.approx(image.std() * 4 * 255 / (video.span.high - video.span.low), rel=0.02)
        assert grey.std() > 0.5 * image.std()


def test_two_readers_of_one_file_do_not_disturb_each_other(tmp_path: Path):
    """Read in turn, with others that begin and end meanwhile."""
    path = encode(tmp_path / "whole.mp4", "libx264")
    first, second = VideoFile(path), VideoFile(path)
    pairs = 0
    for one, other in zip(first, second, strict=True):
        assert not one.after_hole
        assert not other.after_hole
        pairs += 1
        if pairs % 10 == 0:
            next(iter(VideoFile(path)))
    assert (pairs, first.damage, second.damage) == (FRAMES, None, None)


@pytest.mark.parametrize("skipped", [5, 12, 30])
def test_frames_that_an_edit_list_trims_are_no_damage(tmp_path: Path, skipped: int):
    """As phones write it when one cuts a video: the packets before stay in the file, for decoding alone."""
    data = bytearray(encode(tmp_path / "whole.mp4", "libx264").read_bytes())
    at = data.index(b"elst") + 16  # version and flags, count, duration, then where the media begin
    rate = data.index(b"mdhd") + 16
    (begin,), (ticks,) = struct.unpack_from(">i", data, at), struct.unpack_from(">i", data, rate)
    struct.pack_into(">i", data, at, begin + skipped * ticks // 30)
    (tmp_path / "trimmed.mp4").write_bytes(data)
    video = VideoFile(tmp_path / "trimmed.mp4")
    assert numbers(video) == list(range(skipped, FRAMES))
    assert (video.damage, video.total, holes(video)) == (None, FRAMES - skipped, [])


@pytest.mark.parametrize("damaged", [7, 12, 40, 59])
def test_a_packet_that_the_decoder_refuses_is_a_hole(tmp_path: Path, damaged: int):
    path = tmp_path / "broken.webm"
    with (
        av.open(str(encode(tmp_path / "whole.webm", "libvpx-vp9"))) as whole,
        av.open(str(path), "w") as container,
    ):
        source = whole.streams.video[0]
        stream = container.add_stream_from_template(source)
        for number, packet in enumerate(p for p in whole.demux(source) if p.size):
            content = bytes(packet)
            copy = av.Packet(bytes([content[0] ^ 0xC0]) + content[1:] if number == damaged else content)
            copy.pts, copy.dts, copy.time_base, copy.stream = packet.pts, packet.dts, packet.time_base, stream
            copy.is_keyframe = packet.is_keyframe
            container.mux(copy)
    video = VideoFile(path)
    found = numbers(video)
    assert found == [n for n in range(FRAMES) if not damaged <= n < GROUP * -(-(damaged + 1) // GROUP)]
    assert video.damage is not None


def test_a_stream_that_begins_on_the_way_is_no_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """PyAV then fails after the last packet, depending on memory that it does not own: here it always does."""
    whole = VideoFile._open

    class Growing:
        def __init__(self, container):
            self.container = container

        def __getattr__(self, name):
            return getattr(self.container, name)

        def __enter__(self):
            return self

        def __exit__(self, *error):
            self.container.close()

        def demux(self, stream):
            yield from self.container.demux(stream)
            raise IndexError("list index out of range")

    path = encode(tmp_path / "sound_later.flv", "libx264")
    monkeypatch.setattr(VideoFile, "_open", lambda self: Growing(whole(self)))
    video = VideoFile(path)
    assert numbers(video) == list(range(FRAMES))
    assert (video.damage, video.total) == (None, FRAMES)
