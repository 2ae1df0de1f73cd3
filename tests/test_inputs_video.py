"""Video: one file a side, or both side by side in one."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_seecolor.commands.run import run
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.video import is_video, unpack


def write_video(path: Path, frames: list[np.ndarray]) -> Path:
    height, width = frames[0].shape[:2]
    video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (width, height))
    assert video.isOpened()
    for frame in frames:
        video.write(np.ascontiguousarray(frame))
    video.release()
    return path


def smooth_frames(count: int, seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [
        cv2.resize(rng.integers(0, 256, (6, 8, 3), dtype=np.uint8), (96, 64), interpolation=cv2.INTER_CUBIC) for _ in range(count)
    ]


def unpacked(left: Path, right: Path, folder: Path, every: int) -> tuple[Path, Path]:
    found = unpack(left, right, folder, InputConfig(video_every=every))
    return found.left, found.right


def near(path: Path, bgr: np.ndarray) -> bool:
    return float(np.abs(read_image(path).astype(int) - bgr[..., ::-1]).mean()) < 8


def test_one_file_a_side(tmp_path: Path) -> None:
    lefts, rights = smooth_frames(5), smooth_frames(5, seed=1)
    videos = write_video(tmp_path / "l.avi", lefts), write_video(tmp_path / "r.avi", rights)
    left, right = unpacked(*videos, tmp_path / "frames", every=2)
    assert [path.name for path in sorted(left.iterdir())] == ["000000.png", "000001.png", "000002.png"]
    assert near(left / "000001.png", lefts[2])
    assert near(right / "000002.png", rights[4])
    before = (left / "000000.png").stat().st_mtime_ns
    unpacked(*videos, tmp_path / "frames", every=2)
    assert (left / "000000.png").stat().st_mtime_ns == before, "what is unpacked is kept"
    write_video(videos[0], rights)
    other, _ = unpacked(*videos, tmp_path / "frames", every=2)
    assert near(other / "000001.png", rights[2]), "another video under the same name is unpacked too"
    assert near(left / "000001.png", lefts[2]), "and the frames of the first are still there"


def test_nothing_else_in_the_folder_is_touched(tmp_path: Path) -> None:
    video = write_video(tmp_path / "v.avi", smooth_frames(2))
    mine = tmp_path / "frames" / "mine" / "notes.txt"
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    unpacked(video, video, tmp_path / "frames", every=1)
    with pytest.raises(InputError):
        unpacked(tmp_path / "gone.avi", video, tmp_path / "frames", every=1)
    assert mine.read_text() == "mine"


def stop_after(frames: int, monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    written = []

    def write(path: Path, content: bytes) -> None:
        if len(written) == frames:
            raise error
        written.append(path)
        write_atomic(path, content)

    monkeypatch.setattr("stereo_seecolor.inputs.video.write_atomic", write)


@pytest.mark.parametrize(
    "error", [KeyboardInterrupt(), OutputError("a.png: cannot be written: no space left on device")], ids=["Ctrl-C", "full disk"]
)
def test_an_unpacking_that_was_stopped_begins_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException) -> None:
    video = write_video(tmp_path / "v.avi", smooth_frames(4))
    with monkeypatch.context() as patch, pytest.raises(type(error)):
        stop_after(3, patch, error)
        unpacked(video, video, tmp_path / "frames", every=1)
    assert not list((tmp_path / "frames").iterdir())
    left, right = unpacked(video, video, tmp_path / "frames", every=1)
    assert [len(list(side.iterdir())) for side in (left, right)] == [4, 4]


@pytest.mark.slow
def test_an_unpacking_that_was_killed_begins_again(tmp_path: Path) -> None:
    video = write_video(tmp_path / "v.avi", smooth_frames(3))
    script = (
        "import os, sys; from pathlib import Path\n"
        "from stereo_seecolor.config import InputConfig; from stereo_seecolor.inputs import video as v; whole = v.write_atomic\n"
        "v.write_atomic = lambda path, content: os._exit(9) if path.name == '000002.png' else whole(path, content)\n"
        "v.unpack(Path(sys.argv[1]), Path(sys.argv[1]), Path(sys.argv[2]), InputConfig())"
    )
    assert subprocess.run([sys.executable, "-c", script, video, tmp_path / "frames"], check=False).returncode == 9
    assert len(list((tmp_path / "frames").iterdir())) == 1
    left, _ = unpacked(video, video, tmp_path / "frames", every=1)
    assert len(list(left.iterdir())) == 3
    assert len(list((tmp_path / "frames").iterdir())) == 1, "nothing is left of the killed one"


@pytest.mark.posix
def test_a_named_pipe_is_no_video(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "v.avi")
    with pytest.raises(InputError, match="is a named pipe, not a video"):
        unpacked(tmp_path / "v.avi", tmp_path / "v.avi", tmp_path / "frames", every=1)


def test_side_by_side(tmp_path: Path) -> None:
    lefts, rights = smooth_frames(2), smooth_frames(2, seed=1)
    both = write_video(tmp_path / "both.avi", [np.hstack(pair) for pair in zip(lefts, rights, strict=True)])
    left, right = unpacked(both, both, tmp_path / "frames", every=1)
    assert near(left / "000001.png", lefts[1])
    assert near(right / "000001.png", rights[1])


def test_what_is_no_video(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"no video")
    assert is_video(tmp_path / "a.mp4")
    assert not is_video(tmp_path)
    with pytest.raises(InputError, match=r"a\.mp4: is no video that OpenCV can open"):
        unpacked(tmp_path / "a.mp4", tmp_path / "a.mp4", tmp_path / "frames", every=1)
    with pytest.raises(InputError, match=r"b\.mp4: the video cannot be read: No such file"):
        unpacked(tmp_path / "b.mp4", tmp_path / "b.mp4", tmp_path / "frames", every=1)


@pytest.mark.slow
def test_a_run_takes_videos(make_dive, tmp_path) -> None:
    dive = make_dive(2)
    for side in "LR":
        frames = [cv2.imread(str(path)) for path in sorted((dive.root / side).iterdir())]
        write_video(dive.root / f"{side}.avi", frames)
    summary = run(dive.root / "L.avi", dive.root / "R.avi", dive.root / "cam.yaml", tmp_path / "out")
    assert summary.count("ok") == 2
    assert (tmp_path / "out/corrected/000001.png").exists()
