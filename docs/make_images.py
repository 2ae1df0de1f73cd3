"""Renew the pictures of the documentation by running the program on the sample dive: python
docs/make_images.py [NAME ...].

Needs the dev extra (matplotlib). Each picture stays below 200 kB. Drawings (SVG) that need no run
are made by drawings.py.
"""

import io
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt
from numpy.typing import NDArray
from rich.console import Console
from rich.text import Text

from calibration import Rectification
from calibration.formats import load_rig
from stereo_seecolor.extras.evaluation.baselines import METHODS

mpl.use("Agg")
mpl.rcParams |= {
    "font.size": 9,
    "axes.titlesize": 9,
    "savefig.bbox": "tight",
    "svg.hashsalt": "seecolor",
    "svg.fonttype": "none",
}

HERE = Path(__file__).parent
DIVE = HERE.parent / "data_samples" / "reef"
IMAGES = HERE / "images"
FRAME = "reef_1790000003000"
PAIR = ["--left", DIVE / "left", "--right", DIVE / "right", "--calib", DIVE / "cam.yaml"]

Image = NDArray[np.uint8]


def program(*words: object) -> str:
    """What the program prints; the pictures show what it gives today."""
    command = [
        sys.executable,
        "-c",
        "from stereo_seecolor.cli import main; main()",
        *map(str, words),
    ]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def read(path: Path) -> Image:
    """An image as RGB, or a map as it is."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, path
    return np.asarray(image[..., 2::-1] if image.ndim == 3 else image)


def rectified(name: str = FRAME) -> tuple[Image, Image]:
    """The pair of a frame, rectified."""
    rectification = Rectification.from_rig(load_rig(DIVE / "cam.yaml"))
    left, right = (read(DIVE / side / f"{name}.png") for side in ("left", "right"))
    return np.asarray(rectification.apply_left(left)), np.asarray(rectification.apply_right(right))


def save(name: str, image: Image, width: int = 1100) -> None:
    scale = width / image.shape[1]
    small = cv2.resize(
        image,
        None,
        fx=scale,
        fy=scale,
        interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC,
    )
    cv2.imwrite(str(IMAGES / name), small[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 84])


def panels(name: str, content: list[tuple[str, Image, str | None]], width: float = 10.0) -> None:
    """Pictures side by side, each with its title; maps with a color scale."""
    height = width / len(content) * content[0][1].shape[0] / content[0][1].shape[1]
    figure, axes = plt.subplots(
        1, len(content), figsize=(width, height + 0.35), layout="constrained"
    )
    for axis, (title, image, unit) in zip(axes, content, strict=True):
        shown = axis.imshow(
            image, cmap=None if unit is None else "viridis", interpolation="antialiased"
        )
        if unit is not None:
            figure.colorbar(shown, ax=axis, label=unit, shrink=0.85)
        axis.set_title(title)
        axis.axis("off")
    figure.savefig(IMAGES / name, dpi=110, pil_kwargs={"quality": 84})
    plt.close(figure)


def before_after(out: Path) -> None:
    save("before_after.jpg", np.hstack([rectified()[0], read(out / "corrected" / f"{FRAME}.png")]))


def ranges(out: Path) -> None:
    images = [("left image, rectified", rectified()[0], None)]
    images.append(("range", read(out / "range" / f"{FRAME}.tiff"), "m"))
    images.append(
        ("standard error of the range", 1000 * read(out / "range_std" / f"{FRAME}.tiff"), "mm")
    )
    panels("ranges.jpg", images, 12)


def rows(out: Path) -> None:
    both = np.hstack(rectified())
    for y in range(20, both.shape[0], 40):
        cv2.line(both, (0, y), (both.shape[1], y), (255, 220, 60), 1)
    save("rows.jpg", both)


def methods(out: Path) -> None:
    image, range_m = rectified()[0], read(out / "range" / f"{FRAME}.tiff")
    known = np.isfinite(range_m)
    shown: list[tuple[str, Image, str | None]] = []
    for name in ("raw", "gray world", "sea-thru"):
        method: Callable[..., NDArray[np.float64]] = METHODS[name]
        result = np.nan_to_num(method(image / 255.0, range_m.astype(np.float64)))
        shown.append(
            (name, np.uint8(255 * np.clip(np.where(known[..., None], result, 0), 0, 1)), None)
        )
    shown.append(("stereo-seecolor", read(out / "corrected" / f"{FRAME}.png"), None))
    shown.append(("truth", read(DIVE / "truth" / "color" / f"{FRAME}.png"), None))
    panels("methods.jpg", shown, 12)


def sample_map(out: Path) -> None:
    slant, top = read(out / "map" / "preview.png"), read(out / "map" / "orthomosaic_preview.png")
    height = 420
    pictures = [
        cv2.resize(
            p, (round(p.shape[1] * height / p.shape[0]), height), interpolation=cv2.INTER_AREA
        )
        for p in (slant, top)
    ]
    save("map_sample.jpg", np.hstack(pictures))


def synthetic(out: Path) -> None:
    truth = DIVE / "truth"
    images = [
        ("left image", read(DIVE / "left" / f"{FRAME}.png"), None),
        ("true color", read(truth / "color" / f"{FRAME}.png"), None),
    ]
    panels(
        "synthetic.jpg", [*images, ("true range", read(truth / "range" / f"{FRAME}.tiff"), "m")], 12
    )


def water(out: Path) -> None:
    """Attenuation and backscatter over range: fitted to the survey, and true."""
    range_m = np.linspace(0.5, 4, 25)
    names = (
        "attenuation A(z), fraction of the light left",
        "backscatter B(z), fraction of full scale",
    )
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    for path, style in ((out / "water.json", "-"), (DIVE / "truth" / "water.json", "--")):
        content = json.loads(path.read_text())["water"]
        found = {
            key: np.array(content[key], float)
            for key in ("gamma_inf", "beta", "eta", "alpha", "w", "v", "y", "x")
        }
        for c, color in enumerate(("#c92a2a", "#2b8a3e", "#1864ab")):
            p = {key: value[c] for key, value in found.items()}
            rate = p["w"] * np.exp(-p["v"] * range_m) + p["y"] * np.exp(-p["x"] * range_m)
            backscatter = -p["gamma_inf"] * np.expm1(-p["beta"] * range_m) + p["eta"] * np.exp(
                -p["alpha"] * range_m
            )
            axes[0].plot(range_m, np.exp(-rate * range_m), style, color=color)
            axes[1].plot(range_m, backscatter, style, color=color)
    for axis, title in zip(axes, names, strict=True):
        axis.set(title=title, xlabel="range, m")
        axis.grid(alpha=0.3)
    axes[0].plot([], [], "k-", label="fitted")
    axes[0].plot([], [], "k--", label="true")
    axes[0].legend(frameon=False)
    figure.savefig(IMAGES / "water.svg", metadata={"Date": None})
    plt.close(figure)


def stages(out: Path) -> None:
    """How the processor time of the sample dive divides among the stages, from run.json."""
    seconds = json.loads((out / "run.json").read_text())["totals"]["stage_seconds"]
    figure, axis = plt.subplots(figsize=(7, 1.9), layout="constrained")
    names = sorted(seconds, key=seconds.get)
    bars = axis.barh(
        names, [100 * seconds[name] / sum(seconds.values()) for name in names], color="#0b7285"
    )
    axis.bar_label(bars, fmt="%.0f %%", padding=3)
    axis.set(
        xlabel="percent of the processor time of a run on the sample dive (12 pairs of 576x448)"
    )
    axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(IMAGES / "stages.svg", metadata={"Date": None})
    plt.close(figure)


def terminal(name: str, command: str, printed: str) -> None:
    console = Console(record=True, width=124, file=io.StringIO(), force_terminal=True)
    console.print(Text(f"$ {command}", style="bold"))
    console.print(Text(printed.rstrip()))
    picture = re.sub(
        r"@font-face \{.*?\}",
        "",
        console.export_svg(title="stereo-seecolor", unique_id="terminal"),
        flags=re.DOTALL,
    )
    (IMAGES / name).write_text(picture, encoding="utf-8")  # without fonts from the network


def terminals(out: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        printed = program("run", *PAIR, "--out", Path(folder) / "out").replace(f"{folder}/", "")
    terminal(
        "terminal_run.svg",
        "stereo-seecolor run --left left --right right --calib cam.yaml --out out",
        printed,
    )
    terminal("terminal_doctor.svg", "stereo-seecolor doctor", program("doctor"))


PICTURES = (before_after, ranges, rows, methods, sample_map, synthetic, water, stages, terminals)


def main(names: list[str]) -> None:
    """Run the sample dive once, and make the pictures that were asked for, or all."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        program(
            "run",
            *PAIR,
            "--out",
            out,
            "--set",
            "color.lock=survey",
            "--poses",
            DIVE / "trajectory.tum",
            "--fuse",
        )
        for picture in PICTURES:
            if not names or picture.__name__ in names:
                picture(out)


if __name__ == "__main__":
    main(sys.argv[1:])
