"""An output folder and its map as a few numbers, read from the files alone, and how far such
numbers may differ.

Ranges and colors are reduced to percentiles, means and medians of blocks: one pixel that another
processor rounds differently does not show, a twelfth of a frame that moves does. Checksums would
fail on the former.
"""

import csv
import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

Numbers = dict[str, Any]

PERCENTILES = (1, 5, 25, 50, 75, 95, 99)
BLOCK_ROWS, BLOCK_COLUMNS = 3, 4


@dataclass(frozen=True)
class Tolerances:
    """Greatest allowed differences. absolute: by the name of a number, in its unit. relative: of
    all other numbers, as a ratio of the number, or of SMALLEST_SCALE for numbers near zero.
    """

    absolute: dict[str, float]
    relative: float


SMALLEST_SCALE = 0.01

# On x86-64 with and without AVX2 and FMA all of these are the same, but for the waters, where the
# fits end within 1e-12 of each other. The room left is for other compilers (arm64), and is far
# below what a user would see.
SAME_FILES = Tolerances(
    {
        # one step of disparity (1/16 px) is 4e-3 m at 2 m; a shift of 1e-4 m must fail
        "range_m": 2e-5,
        "range_std_m": 2e-5,  # as range_m
        # 26 of the 258,048 pixels of a frame, where a threshold is crossed by rounding
        "coverage": 1e-4,
        "mask_shares": 1e-4,  # as coverage
        "confidence_mean": 0.1,  # of 255
        "cloud_points": 26,  # as coverage
        "color_mean": 0.5,  # of 255; a shift of 2 must fail
        "color_percentiles": 1.0,  # of 255: they are whole numbers
    },
    relative=1e-4,
)

# Which features are found depends on the processor's instructions: without AVX2 the track moves by
# 1.1 mm, the box by a voxel, and the metrics by 0.09 %. Each tolerance is two to five times that.
OWN_TRACK = Tolerances(
    {
        "map_low_m": 0.025,  # voxels are 0.01 m
        "map_high_m": 0.025,
        "track_end": 0.003,  # m, and parts of a quaternion
        "aspect_deg": 0.4,
        "color_mean": 0.5,  # of 255
    },
    relative=0.004,
)


def read_image(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None, path
    return image


def block_medians(values: np.ndarray) -> list[float]:
    """Medians of the known values of 3 x 4 blocks, row by row."""
    rows = np.array_split(values, BLOCK_ROWS)
    blocks = [block for row in rows for block in np.array_split(row, BLOCK_COLUMNS, axis=1)]
    return [
        float(np.median(block[np.isfinite(block)])) if np.isfinite(block).any() else math.nan
        for block in blocks
    ]


def range_numbers(out: Path, name: str) -> Numbers:
    range_m = read_image(out / "range" / f"{name}.tiff")
    range_std_m = read_image(out / "range_std" / f"{name}.tiff")
    known = np.isfinite(range_m)
    return {
        "coverage": float(known.mean()),
        "range_m": [*np.percentile(range_m[known], PERCENTILES).tolist(), *block_medians(range_m)],
        "range_std_m": np.percentile(range_std_m[np.isfinite(range_std_m)], PERCENTILES).tolist(),
        "confidence_mean": float(read_image(out / "confidence" / f"{name}.png").mean()),
    }


def color_numbers(out: Path, name: str) -> Numbers:
    """Of the pixels whose color is good, R, G, B in that order."""
    mask = read_image(out / "mask" / f"{name}.png")
    rgb = read_image(out / "corrected" / f"{name}.png")[..., ::-1][mask == 0]
    return {
        "mask_shares": (np.bincount(mask.ravel(), minlength=4) / mask.size).tolist(),
        "color_mean": rgb.mean(axis=0).tolist(),
        "color_percentiles": np.percentile(rgb, (5, 50, 95), axis=0, method="nearest")
        .ravel()
        .tolist(),
    }


def water_numbers(path: Path) -> Numbers:
    """Each frame's parameters, or the survey's; their standard errors are left out."""
    content = json.loads(path.read_text())
    waters = content["frames"] if "frames" in content else {"survey": content["water"]}
    return {
        frame: {
            key: value
            for key, value in water.items()
            if isinstance(value, float | list) and key != "warnings"
        }
        for frame, water in waters.items()
    }


def read_ply(path: Path) -> tuple[np.ndarray, int]:
    """(vertices as a structured array, count of faces) of a binary PLY."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    types = {"float": "<f4", "double": "<f8", "uchar": "u1"}
    vertex = header.decode().split("element vertex")[1].split("element")[0]
    fields = [(name, types[kind]) for kind, name in re.findall(r"property (\w+) (\w+)", vertex)]
    faces = re.search(rb"element face (\d+)", header)
    return np.frombuffer(body, fields, int(vertex.split()[0])), int(faces[1]) if faces else 0


def frame_names(out: Path) -> list[str]:
    return [
        row["name"]
        for row in csv.DictReader((out / "frames.csv").read_text().splitlines())
        if row["status"] == "ok"
    ]


def run_numbers(out: Path) -> Numbers:
    frames = {
        name: range_numbers(out, name)
        | color_numbers(out, name)
        | {"cloud_points": len(read_ply(out / "clouds" / f"{name}.ply")[0])}
        for name in frame_names(out)
    }
    return {"frames": frames, "water": water_numbers(out / "water.json")}


def range_run_numbers(out: Path) -> Numbers:
    return {"frames": {name: range_numbers(out, name) for name in frame_names(out)}}


def color_run_numbers(out: Path) -> Numbers:
    return {
        "frames": {name: color_numbers(out, name) for name in frame_names(out)},
        "water": water_numbers(out / "water.json"),
    }


def map_numbers(out: Path) -> Numbers:
    folder = out / "map"
    points, _ = read_ply(folder / "cloud.ply")
    _, triangles = read_ply(folder / "mesh.ply")
    xyz_m = np.stack([points[axis] for axis in "xyz"], axis=1)
    rgb = np.stack([points[channel] for channel in ("red", "green", "blue")], axis=1)
    poses = np.loadtxt(folder / "trajectory.tum", ndmin=2)
    site = next(
        row
        for row in csv.DictReader((folder / "reef_metrics.csv").read_text().splitlines())
        if row["square"] == "site"
    )
    return {
        "frames": len(poses),
        "map_points": len(points),
        "map_triangles": triangles,
        "map_low_m": xyz_m.min(axis=0).tolist(),
        "map_high_m": xyz_m.max(axis=0).tolist(),
        "color_mean": rgb.mean(axis=0).tolist(),
        "track_length_m": float(np.linalg.norm(np.diff(poses[:, 1:4], axis=0), axis=1).sum()),
        "track_end": poses[-1, 1:].tolist(),
        "site": {
            key: float(value) for key, value in site.items() if key not in ("square", "x_m", "y_m")
        },
    }


def leaves(numbers: object, path: str = "", name: str = "") -> Iterator[tuple[str, str, object]]:
    """(path, name that decides the tolerance, value) of every number."""
    if isinstance(numbers, dict):
        for key, value in numbers.items():
            yield from leaves(value, f"{path}/{key}", key)
    elif isinstance(numbers, list):
        for i, value in enumerate(numbers):
            yield from leaves(value, f"{path}[{i}]", name)
    else:
        yield path, name, numbers


def differs(name: str, golden: object, measured: object, tolerances: Tolerances) -> bool:
    if not (isinstance(golden, float | int) and isinstance(measured, float | int)):
        return golden != measured
    allowed = tolerances.absolute.get(name, tolerances.relative * max(abs(golden), SMALLEST_SCALE))
    return not (abs(golden - measured) <= allowed or (math.isnan(golden) and math.isnan(measured)))


def differences(
    golden: Numbers, measured: Numbers, tolerances: Tolerances = SAME_FILES
) -> list[str]:
    """A line for each number beyond its tolerance, and for each that only one side has."""
    old = {path: (name, value) for path, name, value in leaves(golden)}
    new = {path: value for path, _, value in leaves(measured)}
    lines = [f"{path}: missing" for path in old.keys() - new.keys()] + [
        f"{path}: new" for path in new.keys() - old.keys()
    ]
    lines += [
        f"{path}: {value} -> {new[path]}"
        for path, (name, value) in old.items()
        if path in new and differs(name, value, new[path], tolerances)
    ]
    return sorted(lines)


def rounded(numbers: object) -> object:
    """Numbers as they are stored: to 1e-7, well below all tolerances."""
    if isinstance(numbers, dict):
        return {key: rounded(value) for key, value in numbers.items()}
    if isinstance(numbers, list):
        return [rounded(value) for value in numbers]
    return round(numbers, 7) if isinstance(numbers, float) else numbers


def write_numbers(path: Path, numbers: Numbers) -> None:
    """As JSON with a line for each list, so that a renewal reads well as a diff."""
    text = json.dumps(rounded(numbers), indent=1)
    path.write_text(
        re.sub(r"\[\s*([^][{}]*?)\s*\]", lambda found: f"[{' '.join(found[1].split())}]", text)
        + "\n"
    )
