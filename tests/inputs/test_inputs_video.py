"""Video: one file a side, or both side by side in one; frames read where they lie."""

import os
import re
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import cv2
import numpy as np
import pytest
from calibration_binaries import small_rig
from conftest import contents

from stereo_seecolor.commands.run import run
from stereo_seecolor.commands.stereo_inputs import StereoInputs
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.videos import pairs
from stereo_seecolor.extras.streams.videos.pairs import Videos
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import Pairing
from stereo_seecolor.inputs.video_file import VideoFile, video_file
from stereo_seecolor.inputs.video_frames import frame_path, is_video, pixels

TICKS = 90_000
EXACT = {
    "libx264rgb": {"crf": "0"},
    "libx264": {"crf": "0", "g": "6"},
    # Without B-frames: x265 reads the decoding time of videos of one or two frames from memory that
    # it never set, and the muxer refuses such a packet by chance.
    "libx265": {"x265-params": "lossless=1:bframes=0:log-level=none"},
}


def write_video(
    path: Path,
    frames: list[np.ndarray],
    codec: str = "mjpeg",
    pix: str = "yuvj420p",
    times_s=None,
    **about,
) -> Path:
    """RGB frames, of 8 or 16 bits; codecs of EXACT lose nothing but by chroma. about: metadata,
    flags.
    """
    height, width = frames[0].shape[:2]
    with av.open(str(path), "w") as container:
        container.metadata.update(about.get("metadata", {}))
        stream = container.add_stream(
            codec, rate=10, options=about.get("options", EXACT.get(codec, {}))
        )
        stream.width, stream.height, stream.pix_fmt = width, height, pix
        stream.codec_context.time_base = Fraction(1, 10 if times_s is None else TICKS)
        stream.codec_context.sample_aspect_ratio = about.get("pixel", Fraction(1))
        for number, image in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(
                np.ascontiguousarray(image),
                format="rgb24" if image.dtype == np.uint8 else "rgb48le",
            )
            frame.time_base = stream.codec_context.time_base
            frame.pts = number if times_s is None else round(times_s[number] * TICKS)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def smooth_frames(count: int, seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [
        cv2.resize(
            rng.integers(0, 256, (6, 8, 3), dtype=np.uint8), (96, 64), interpolation=cv2.INTER_CUBIC
        )
        for _ in range(count)
    ]


def paired(left: Path, right: Path, every: int = 1) -> Pairing:
    videos = Videos(left, right)
    return videos.pairing(videos.choice(InputConfig(video_step=every)))


def near(path: Path, rgb: np.ndarray) -> bool:
    return float(np.abs(read_image(path).astype(int) - rgb).mean()) < 8


def test_one_file_a_side(tmp_path: Path) -> None:
    lefts = smooth_frames(5)
    rights = [np.roll(image, 20, axis=1) for image in lefts]  # both move alike
    videos = write_video(tmp_path / "l.avi", lefts), write_video(tmp_path / "r.avi", rights)
    pairs = paired(*videos, every=2).pairs
    assert [(pair.name, pair.timestamp_s) for pair in pairs] == [
        ("000000", 0.0),
        ("000002", 0.2),
        ("000004", 0.4),
    ]
    assert near(pairs[1].left, lefts[2])
    assert near(pairs[2].right, rights[4])
    write_video(videos[0], rights)
    assert near(paired(*videos, every=2).pairs[1].left, rights[2]), (
        "another video under the same name"
    )


def test_side_by_side(tmp_path: Path) -> None:
    lefts, rights = smooth_frames(2), smooth_frames(2, seed=1)
    both = write_video(
        tmp_path / "both.avi", [np.hstack(pair) for pair in zip(lefts, rights, strict=True)]
    )
    pair = paired(both, both).pairs[1]
    assert near(pair.left, lefts[1])
    assert near(pair.right, rights[1])
    odd = write_video(
        tmp_path / "odd.mkv", [frame[:, :95] for frame in lefts], "libx264rgb", "rgb24"
    )
    with pytest.raises(
        InputError, match="an odd number: it does not show left and right in halves"
    ):
        read_image(paired(odd, odd).pairs[0].left)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suffix", "codec", "pix"),
    [
        ("mp4", "libx264", "yuv420p"),
        ("mpg", "mpeg2video", "yuv420p"),
        ("avi", "mjpeg", "yuvj420p"),
        ("mkv", "libx265", "yuv420p"),
    ],
)
def test_frames_in_any_order_are_the_same_as_in_a_row(
    tmp_path: Path, suffix: str, codec: str, pix: str
) -> None:
    path = write_video(tmp_path / f"v.{suffix}", smooth_frames(60), codec, pix, options={"g": "12"})
    with av.open(str(path)) as container:
        wanted = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(wanted) == len(video_file(path).index.pts) == 60
    for number in [*range(60), *np.random.default_rng(0).permutation(60).tolist(), 59, 0]:
        video = VideoFile(path) if number % 7 == 0 else video_file(path)
        found = video.read(number, lambda frame: frame.to_ndarray(format="rgb24"))
        assert np.array_equal(found, wanted[number]), number


def test_no_two_threads_convert_a_frame_at_once(tmp_path: Path) -> None:
    """PyAV changes a frame while it converts it: two threads would end the program."""
    video = video_file(write_video(tmp_path / "v.mp4", smooth_frames(2)))
    both = threading.Barrier(2, timeout=0.2)

    def meets_another(_: Any) -> bool:
        try:
            both.wait()
        except threading.BrokenBarrierError:
            return False
        return True

    with ThreadPoolExecutor(2) as pool:
        assert not any(pool.map(video.read, [1, 1], [meets_another] * 2))


def test_times_are_those_of_the_file(tmp_path: Path) -> None:
    """A frame rate that varies, and a camera that says when it began."""
    times_s = np.cumsum(np.random.default_rng(0).uniform(0.02, 0.3, 20))
    began = "2026-05-04T03:02:01.000000Z"
    path = write_video(
        tmp_path / "v.mp4",
        smooth_frames(20),
        "libx264",
        "yuv420p",
        times_s,
        metadata={"creation_time": began},
    )
    begin_s = datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC).timestamp()
    found = np.array([pair.timestamp_s for pair in paired(path, path).pairs]) - begin_s
    assert np.abs(np.diff(found) - np.diff(times_s)).max() < 2 / TICKS


def test_ten_bits_become_sixteen(tmp_path: Path) -> None:
    ramp = (
        np.linspace(20_000, 24_000, 96)[None, :, None].repeat(64, 0).repeat(3, 2).astype(np.uint16)
    )
    ramp[:8], ramp[-8:] = 0, 65535
    path = write_video(tmp_path / "v.mkv", [ramp], "libx265", "yuv444p10le")
    image = read_image(frame_path(path, 0))
    assert image.dtype == np.uint16
    assert len(np.unique(image[8:-8])) > 50  # of 8 bits there would be 17
    assert np.abs(image.astype(float) - ramp).max() < 65535 * 4 / 1023


def test_colors_are_not_shifted(tmp_path: Path) -> None:
    """Gray stays gray, white stays white, and colors are read as they were coded."""
    for value in (0, 37, 128, 255):
        path = write_video(
            tmp_path / f"{value}.mp4", [np.full((64, 96, 3), value, np.uint8)], "libx264", "yuv420p"
        )
        assert np.abs(read_image(frame_path(path, 0)).astype(int) - value).max() <= 1
    color = smooth_frames(1)[0]
    path = write_video(tmp_path / "color.mkv", [color], "libx264", "yuv444p")
    assert (
        np.abs((read_image(frame_path(path, 0)).astype(float) - color).mean(axis=(0, 1))).max()
        < 1.2
    )


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_a_picture_is_turned_as_its_flag_says(tmp_path: Path, turns: int) -> None:
    """The matrix of the track's header (ISO 14496-12, tkhd) is the first that the file holds after
    the movie's own.
    """
    frame = smooth_frames(1)[0]
    path = write_video(tmp_path / "v.mp4", [frame], "libx264", "yuv444p")
    content = bytearray(path.read_bytes())
    at = content.index(b"tkhd") + 4 + 40
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[turns]
    for place, value in enumerate(
        (cos << 16, sin << 16, 0, -sin << 16, cos << 16, 0, 0, 0, 1 << 30)
    ):
        content[at + 4 * place : at + 4 * place + 4] = value.to_bytes(4, "big", signed=True)
    path.write_bytes(content)
    # the matrix turns clockwise, since y points down
    assert near(frame_path(path, 0), np.rot90(frame, -turns))


def test_videos_that_are_interlaced_cut_or_of_other_rates_are_named(tmp_path: Path) -> None:
    flags = {"x264-params": "tff=1", "crf": "10"}
    left = write_video(tmp_path / "l.mkv", smooth_frames(4), "libx264", "yuv420p", options=flags)
    right = write_video(
        tmp_path / "r.mkv", smooth_frames(8), "libx264", "yuv420p", np.arange(8) / 20
    )
    assert paired(left, left).notes == (
        f"{left}: is interlaced: its rows were exposed at two moments; deinterlace it first",
    )
    with pytest.raises(InputError):
        paired(left, right)
    cut = write_video(tmp_path / "cut.mkv", smooth_frames(30), "libx264rgb", "rgb24")
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size // 2])
    assert re.fullmatch(
        rf"{cut}: ends after 1\.\d of 3\.0 s: it was cut", paired(cut, cut).notes[0]
    )


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ("transfer=arib-std-b67:colorprim=bt2020", "high dynamic range (HLG) and primaries of BT."),
        ("transfer=smpte2084", "high dynamic range (PQ), but"),
        ("colorprim=smpte432", "primaries of P3"),
        ("transfer=bt709:colorprim=bt709", ""),
    ],
)
def test_videos_of_other_colors_than_srgb_are_named(tmp_path: Path, stated: str, said: str) -> None:
    options = {"x265-params": f"bframes=0:log-level=none:{stated}"}
    path = write_video(
        tmp_path / "v.mkv", smooth_frames(3), "libx265", "yuv420p10le", options=options
    )
    found = paired(path, path)
    assert len(found.notes) == bool(said)
    assert all(f"{path}: states {said}" in note for note in found.notes)
    assert found.wrong == (frozenset({"colors"}) if said else frozenset())


@pytest.mark.parametrize(
    ("pixel", "fx", "is_named"),
    [(Fraction(4, 3), 100, True), (Fraction(4, 3), 75.5, False), (Fraction(1), 75, False)],
)
def test_pixels_of_another_shape_than_the_calibration_has_are_named(
    tmp_path: Path, pixel: Fraction, fx: float, is_named: bool
) -> None:
    """Which is right, files that state no shape do not tell."""
    for suffix in (".mp4", ".mkv"):
        video = write_video(
            tmp_path / f"a{suffix}", smooth_frames(2), "libx264", "yuv420p", pixel=pixel
        )
        note = video_file(video).other_pixels(np.diag([fx, 100.0, 1.0]))
        assert ("1.333 times as wide as high" in note, "fx / fy would be 0.750" in note) == (
            is_named,
            is_named,
        )


def test_a_run_names_pixels_of_another_shape(tmp_path: Path, monkeypatch) -> None:
    rig = small_rig()
    monkeypatch.setattr(pairs, "load_rig_of_images", lambda *_: rig)
    sides = [
        write_video(tmp_path / name, smooth_frames(2), "libx264", "yuv420p", pixel=Fraction(4, 3))
        for name in ("l.mp4", "r.mp4")
    ]
    folder = SimpleNamespace(root=tmp_path)
    found = pairs.video_pairing(*sides, "", folder, InputConfig())  # type: ignore[arg-type]
    named = [note.split(": ")[0] for note in found.notes if "sample aspect ratio" in note]
    assert named == [str(path) for path in sides]


def test_what_is_no_video(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"no video")
    assert is_video(tmp_path / "a.mp4")
    assert not is_video(tmp_path)
    with pytest.raises(InputError, match=r"a\.mp4: is not a video that FFmpeg can read"):
        paired(tmp_path / "a.mp4", tmp_path / "a.mp4")
    missing = tmp_path / "b.mp4"
    whole = write_video(tmp_path / "whole.mp4", smooth_frames(2))
    for read in (
        lambda: paired(missing, missing),
        lambda: run(missing, whole, tmp_path / "cam.yaml", tmp_path / "out"),
        lambda: run(whole, missing, tmp_path / "cam.yaml", tmp_path / "out"),
    ):
        with pytest.raises(InputError, match=r"b\.mp4: the video cannot be read: No such file"):
            read()
    path = write_video(tmp_path / "c.mp4", smooth_frames(2))
    for inner in ("000002.tif", "up/000000.tif", "notes.txt"):
        with pytest.raises(InputError, match=r"c\.mp4: holds no "):
            read_image(path / inner)
    mixed = write_video(
        tmp_path / "d.avi", smooth_frames(30), "libx264", "yuv420p", options={"bf": "2"}
    )
    with pytest.raises(InputError, match="does not store the times of reordered frames"):
        paired(mixed, mixed)


def test_a_frame_that_is_damaged_is_named_and_later_ones_are_read(tmp_path: Path) -> None:
    frames = smooth_frames(30)
    path = write_video(
        tmp_path / "v.mkv", frames, "libx264rgb", "rgb24", options={"crf": "0", "g": "5", "bf": "0"}
    )
    with av.open(str(path)) as container:
        packets = [packet for packet in container.demux(video=0) if packet.size]
    content = bytearray(path.read_bytes())
    at = content.index(bytes(packets[12])[:64])
    content[at : at + packets[12].size] = bytes(packets[12].size)
    path.write_bytes(content)
    video = video_file(path)
    with pytest.raises(InputError, match=r"v\.mkv: frame 12, at 1\.200 s, cannot be decoded"):
        video.read(12, pixels)
    assert near(frame_path(path, 20), frames[20])


@pytest.mark.posix
def test_a_named_pipe_is_no_video(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "v.avi")
    with pytest.raises(InputError, match="is a named pipe, not a video"):
        paired(tmp_path / "v.avi", tmp_path / "v.avi")


@pytest.mark.slow
def test_a_run_takes_videos(make_dive, tmp_path: Path) -> None:
    """Nothing is unpacked; a rerun keeps all; other processes read the frames by their paths."""
    dive = make_dive(3)
    for side in "LR":
        frames = [cv2.imread(str(path))[..., ::-1] for path in sorted((dive.root / side).iterdir())]
        write_video(dive.root / f"{side}.mkv", frames, "libx264rgb", "rgb24")
    given = dive.root / "L.mkv", dive.root / "R.mkv", dive.root / "cam.yaml"
    summary = run(*given, tmp_path / "out")
    assert summary.count("ok") == 3
    assert any("frames of the same number are paired" in note for note in summary.notes)
    folders = run(dive.root / "L", dive.root / "R", given[2], tmp_path / "folders")
    found = (
        [content for path, content in sorted(contents(tmp_path / out).items()) if "/" in path]
        for out in ("out", "folders")
    )
    assert next(found) == next(found)
    assert folders.count("ok") == 3
    before = contents(tmp_path / "out")
    assert [row.kept for row in run(*given, tmp_path / "out").rows] == [True] * 3
    assert contents(tmp_path / "out").keys() == before.keys()
    assert not any(path.endswith(".tif") for path in before)
    script = (
        "import sys; from pathlib import Path; from stereo_seecolor.inputs.images import "
        "read_image\n"
        "print(read_image(Path(sys.argv[1])).shape)"
    )
    elsewhere = [sys.executable, "-c", script, given[0] / "000002.tif"]
    printed = subprocess.run(elsewhere, capture_output=True, text=True, check=True).stdout
    assert printed.strip() == str(cv2.imread(str(dive.root / "L/0000.png")).shape)


def test_a_video_on_one_side_alone_is_named(tmp_path: Path) -> None:
    video = write_video(tmp_path / "l.MTS", smooth_frames(2), "libx264", "yuv420p")
    assert is_video(video)
    (tmp_path / "right").mkdir()
    for other in (tmp_path / "right", tmp_path / "r.dav"):
        with pytest.raises(InputError, match=r"l\.MTS is a video, and .* is none that is read"):
            StereoInputs(video, other, "cam.yaml")
