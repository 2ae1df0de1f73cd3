"""How time and memory of `run` grow with the number of pairs, and with their size; everything is
written.

    python benchmarks/growth.py --picture docs/images/growth.svg

Pairs: 320x256 pixels, six rendered ones used over and over. Size: four pairs, rendered at 640x512
and enlarged, with a camera's noise added after; their focal length grows with them, and so does the
number of disparities that are looked through. Each measurement is a process of its own, with two
workers: processor seconds (user and system) and peak resident memory.
"""

import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml
from arguments import parser_of, sides
from compare import REPOSITORY, execute, machine

PAIRS = (10, 30, 100, 300, 1000, 2000)
SMALL, ENLARGED = (320, 256), (640, 512)
SCALES = (1, 2, 4, 6, 8)
"""Of 640x512 pixels: 0.3 to 21 megapixels."""
NOISE = 2.0
"""Of 8-bit values, standard deviation."""


@dataclass(frozen=True)
class Point:
    """grows: number of pairs, or megapixels. seconds: of processors. peak_mib: resident."""

    grows: float
    seconds: float
    peak_mib: float


def over_pairs(work: Path, numbers: Sequence[int]) -> list[Point]:
    """Ever longer dives of small pairs."""
    points = []
    made = work / "made"
    rig = rendered(made, SMALL) / "cam.yaml"
    # compiles what is compiled once
    execute(REPOSITORY, "run", *sides(made, rig), "--out", work / "warm")
    for number in numbers:
        dive = work / f"pairs_{number}"
        for side in ("left", "right"):
            (dive / side).mkdir(parents=True)
            files = sorted((made / side).iterdir())
            for k in range(number):
                (dive / side / f"{k:06d}.png").hardlink_to(files[k % len(files)])
        points.append(measured(dive, rig, number))
        shutil.rmtree(dive)
    return points


def over_sizes(work: Path, scales: Sequence[int]) -> list[Point]:
    """Ever larger pairs."""
    points = []
    made = rendered(work / "made", ENLARGED)
    for scale in scales:
        dive = work / f"scale_{scale}"
        for side in ("left", "right"):
            (dive / side).mkdir(parents=True)
            for seed, file in enumerate(sorted((made / side).iterdir())[:4]):
                cv2.imwrite(
                    str(dive / side / file.name), enlarged(cv2.imread(str(file)), scale, seed)
                )
        (dive / "cam.yaml").write_text(enlarged_rig((made / "cam.yaml").read_text(), scale))
        points.append(measured(dive, dive / "cam.yaml", ENLARGED[0] * ENLARGED[1] * scale**2 / 1e6))
        shutil.rmtree(dive)
    return points


def rendered(dive: Path, size: tuple[int, int]) -> Path:
    """Six pairs, by a process of its own: the peak memory of this one counts in the processes that
    it starts.
    """
    execute(REPOSITORY, "synthesize", "--pairs", 6, "--size", f"{size[0]}x{size[1]}", "--out", dive)
    return dive


def enlarged(image: np.ndarray, scale: int, seed: int) -> np.ndarray:
    """An image so many times as wide and high, with noise of its own."""
    large = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    noise = np.empty(large.shape, np.int16)
    cv2.setRNGSeed(seed)
    cv2.randn(noise, 0, NOISE)
    return np.clip(large + noise, 0, 255).astype(np.uint8)


def enlarged_rig(text: str, scale: int) -> str:
    """The calibration of cameras with so many times the pixels."""
    rig = yaml.safe_load(text)
    for side in ("left", "right"):
        camera = rig[side]
        camera["image_size"] = [scale * pixels for pixels in camera["image_size"]]
        for row, axis in enumerate(camera["K"][:2]):
            camera["K"][row] = [scale * value for value in axis]
            camera["K"][row][2] += (scale - 1) / 2  # pixel centers are whole numbers
    return yaml.safe_dump(rig)


def measured(dive: Path, rig: Path, grows: float) -> Point:
    """One run, and a line that tells of it."""
    timing = execute(REPOSITORY, "run", *sides(dive, rig), "--out", dive / "out", "--workers", 2)
    print(f"| {grows:g} | {timing.processor_s:.1f} | {timing.peak_mib:.0f} |", flush=True)
    return Point(grows, timing.processor_s, timing.peak_mib)


def draw(pairs: list[Point], sizes: list[Point], picture: Path) -> None:
    """Both growths, seconds on the left and memory on the right."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(8, 4.6), layout="constrained")
    for row, points, name in zip(
        axes, (pairs, sizes), ("pairs of 320x256", "megapixels of each of 4 pairs"), strict=True
    ):
        grows = [point.grows for point in points]
        row[0].plot(grows, [point.seconds for point in points], "o-", color="#0b7285")
        row[1].plot(grows, [point.peak_mib for point in points], "o-", color="#c92a2a")
        row[0].set(xlabel=name, ylabel="processor seconds", ylim=(0, None))
        row[1].set(xlabel=name, ylabel="peak memory, MiB", ylim=(0, None))
    for axis in axes.flat:
        axis.grid(alpha=0.3)
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(picture, metadata={"Date": None})


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--pairs", type=int, nargs="+", default=PAIRS)
    parser.add_argument("--scales", type=int, nargs="+", default=SCALES)
    parser.add_argument("--picture", type=Path, help="SVG or PNG to write")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        print(
            f"{machine()}\n\n| pairs or megapixels | processor s | peak MiB |\n|---|---|---|",
            flush=True,
        )
        pairs = over_pairs(work / "pairs", options.pairs)
        sizes = over_sizes(work / "sizes", options.scales)
    if options.picture:
        draw(pairs, sizes, options.picture)


if __name__ == "__main__":
    main()
