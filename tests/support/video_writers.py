"""Two cameras without a wire: videos of one moving scene, each on its own clock."""

from fractions import Fraction
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import av
import cv2
import numpy as np

WIDTH, HEIGHT, TICKS = 256, 192, 90_000
RATE_HZ = 30


@cache
def texture(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    coarse = cv2.resize(
        rng.uniform(0, 1, (60, 80)).astype(np.float32), (640, 480), interpolation=cv2.INTER_CUBIC
    )
    fine = cv2.GaussianBlur(rng.uniform(0, 1, (480, 640)).astype(np.float32), (0, 0), 1.5)
    gray = 0.6 * coarse + 1.2 * (fine - fine.mean())
    return np.clip(gray * 255, 0, 255).astype(np.float32)


def swell(times_s: np.ndarray, seed: int = 0) -> np.ndarray:
    """(n, 2) pixels: where a rig that drifts in waves points to."""
    rng = np.random.default_rng(seed)
    shift = np.zeros((len(times_s), 2))
    # many: a few waves would repeat themselves
    for frequency in np.exp(rng.uniform(np.log(0.1), np.log(2.0), 16)):
        phase, size = rng.uniform(0, 2 * np.pi, 2), rng.uniform(1, 3, 2) / frequency**0.5
        shift += size * np.sin(2 * np.pi * frequency * times_s[:, None] + phase)
    return shift


def write_pair(
    folder: Path,
    offset_s: float,
    drift: float = 0.0,
    seconds: float = 6.0,
    *,
    moves: bool = True,
    sound: bool = False,
    sound_offset_s: float | None = None,
    flash_s: float | None = None,
    rate_hz: float = RATE_HZ,
    speed: float = 1.0,
    blurred: tuple[int, ...] = (),
    time_codes: tuple[str, str] = ("", ""),
    suffix: str = ".mp4",
    lost: int = 0,
    frozen: int = 0,
    place: float = 0.5,
) -> tuple[Path, Path]:
    """An event at t on the left clock is at t + offset_s + drift t on the right one. blurred:
    numbers of frames. lost: frames that the right file lacks in its middle, or at another place of
    it. frozen: frames for which it repeats one there instead.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for code, lacking, side, clock, sound_s in zip(
        time_codes,
        ((0, 0, 0.5), (lost, frozen, place)),
        ("left", "right"),
        ((0.0, 0.0, 0.0), (offset_s, drift, 14.0)),
        (0.0, offset_s if sound_offset_s is None else sound_offset_s),
        strict=True,
    ):
        files.append(folder / f"{side}{suffix}")
        files[-1].write_bytes(
            _encoded(
                clock,
                seconds,
                speed if moves else 0.0,
                sound_s if sound else None,
                flash_s,
                rate_hz,
                blurred,
                code,
                suffix,
                lacking,
            )
        )
    return files[0], files[1]


@cache
def _encoded(
    clock, seconds, speed, sound_s, flash_s, rate_hz, blurred, time_code, suffix, lacking
) -> bytes:
    """A video; the left ones of many pairs are the same. clock: offset, drift, and how many pixels
    to the side the camera is.
    """
    own_s = np.arange(round(seconds * rate_hz)) / rate_hz
    true_s = (own_s - clock[0]) / (1 + clock[1])
    lost, frozen, at = lacking
    first = int(at * len(true_s))
    true_s[first:] += lost / rate_hz
    true_s[first : first + frozen] = true_s[first - 1]
    noise = None if sound_s is None else hum(own_s[-1], sound_s, clock[1])
    place = speed * swell(true_s) + np.array([clock[2], 0.0])
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"video{suffix}"
        return _write(
            path, texture(), own_s, place, noise, true_s, flash_s, blurred, time_code
        ).read_bytes()


def hum(seconds: float, offset_s: float, drift: float) -> np.ndarray:
    """8 kHz: clicks and noise that both cameras hear."""
    rng = np.random.default_rng(3)
    start_s, rate = -3.0, 8000
    heard = rng.normal(0, 0.05, round((seconds + 8) * rate)) * (
        1 + 3 * (rng.uniform(0, 1, 400).repeat(rate // 20)[: round((seconds + 8) * rate)] > 0.8)
    )
    heard = np.convolve(heard, np.ones(3) / 3, "same")
    own_s = np.arange(round(seconds * rate)) / rate
    return np.interp(
        (own_s - offset_s) / (1 + drift), start_s + np.arange(len(heard)) / rate, heard
    ).astype(np.float32)


def _write(path: Path, scene, own_s, shifts, noise, true_s, flash_s, blurred, time_code) -> Path:
    with av.open(str(path), "w") as container:
        video = container.add_stream(
            "libx264", rate=RATE_HZ, options={"crf": "14", "preset": "ultrafast"}
        )
        video.width, video.height, video.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        video.codec_context.time_base = Fraction(1, TICKS)
        video.metadata.update({"timecode": time_code} if time_code else {})
        audio = container.add_stream("aac", rate=8000, layout="mono") if noise is not None else None
        planes = np.full((HEIGHT * 3 // 2, WIDTH), 128, np.uint8)  # a gray picture has no color
        for number, (time_s, (x_px, y_px), moment_s) in enumerate(
            zip(own_s, shifts, true_s, strict=True)
        ):
            place = np.float32([[1, 0, x_px - 180], [0, 1, y_px - 140]])
            image = cv2.warpAffine(
                scene, place, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
            )
            if number in blurred:
                image = cv2.blur(image, (9, 1))  # the rig jerked sideways
            if flash_s is not None and flash_s <= moment_s < flash_s + 0.1:
                image = image + 80
            planes[:HEIGHT] = np.round(16 + np.clip(image, 0, 255) * (219 / 255))
            frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
            frame.pts, frame.time_base = round(time_s * TICKS), video.codec_context.time_base
            container.mux(video.encode(frame))
        container.mux(video.encode())
        if audio is not None:
            for start in range(0, len(noise) - 1024, 1024):
                block = av.AudioFrame.from_ndarray(
                    noise[None, start : start + 1024], format="fltp", layout="mono"
                )
                block.sample_rate, block.pts = 8000, start
                container.mux(audio.encode(block))
            container.mux(audio.encode())
    return path
