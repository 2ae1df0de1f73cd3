"""Names inside OUT: what each file is called, what it holds, and which stage writes it."""

import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Stage = Literal["range", "corrected", "rectified", "page"]

ORIGINAL = "original"
"""Holds products in the left camera's own pixels, whose files are named as its images."""
STATE = ".state"
"""The program's own folder: manifest, tables."""
KEPT = ".kept"
LOCK, LEASE, PLAN, MANIFEST = "lock", "lease.json", f"plan{KEPT}", "manifest.json"
PROGRESS, VIDEO_PAIRS, SCRATCH = "progress.json", "video_pairs.json", "scratch"
"""In the program's own folder while a run writes into OUT; scratch: pixels that a later pass of it
needs.
"""
SET_ASIDE = "set_aside"
"""Files of ours that somebody changed, moved here before a new one takes their place."""
MAP = "map"
CLOUD, MESH, MOSAIC, TERRAIN = "cloud.ply", "mesh.ply", "orthomosaic.tif", "dem.tif"
GAPS = "gaps.tif"
"""Files in OUT/map that others read."""
RIG, WATER, MEASURED_WATER = "rig.yaml", "water.json", "water_measured.json"
FRAMES_TABLE, RUN, RECTIFIED_RIG = "frames.csv", "run.json", "rectified.yaml"
INDEX, PAGE = "index.html", "page"
"""The page to look at, and the folder of what it shows."""


@dataclass(frozen=True)
class Product:
    """A kind of file that each pair gets. suffix: of its files, "" where output.image_format
    decides. what: what it holds.
    """

    suffix: str
    what: str


PRODUCTS: dict[str, Product] = {
    "corrected": Product("", "each left frame in true color, with the bit depth of the input"),
    "range": Product(".tiff", "range in meters along the ray, float32 TIFF, NaN where unknown"),
    "range_std": Product(".tiff", "standard error of the range, meters"),
    "confidence": Product(".png", "confidence of the range, 0..255 for 0..1"),
    "mask": Product(".png", "0 good, 1 range unknown, 2 range filled in, 3 color beyond recovery"),
    "clouds": Product(".ply", "colored points in meters, left rectified camera, PLY"),
    "original/corrected": Product(
        "", "each left frame in true color, in the pixels of the raw camera"
    ),
    "original/range": Product(
        ".tiff", "range in meters along the ray, in the pixels of the raw camera"
    ),
    "original/mask": Product(".png", "mask, in the pixels of the raw camera"),
    "rectified_left": Product(".png", "left images, rectified"),
    "rectified_right": Product(".png", "right images, rectified"),
}

PAGE_PRODUCTS = {f"{PAGE}/{name}": ".jpg" for name in ("thumbnails", "before", "after")} | {
    f"{PAGE}/ranges": ".js"
}
"""What the page shows of a pair, made of its other products and read by the page alone: the suffix
of each.
"""

DIVE_FILES: dict[str, str] = {
    RECTIFIED_RIG: "the calibration of the rectified images",
    RIG: "the calibration as this run used it",
    WATER: "the fitted water parameters, for --water of another run",
    MEASURED_WATER: (
        "the water parameters measured by stereo-seecolor water, for --water of another run"
    ),
    FRAMES_TABLE: "a row for each pair: status, warnings, fractions, seconds of each stage",
    RUN: "settings, inputs with their hashes, versions, totals",
}

MAP_FILES: dict[str, str] = {
    "trajectory.tum": "poses of the rectified left camera, TUM",
    "poses.csv": (
        "position of each frame, and the difference between its given pose and the images"
    ),
    "map.json": "offset of the map coordinates, position on Earth, sizes of voxels and cells",
    CLOUD: "the surface as colored points, meters",
    "cloud.laz": "the same in the coordinates of the GeoTIFFs",
    MESH: "the surface as a colored mesh, meters",
    "preview.png": "oblique view of the map",
    "orthomosaic_preview.png": "the orthomosaic, small",
    MOSAIC: "the reef from above, GeoTIFF",
    TERRAIN: "heights, meters, GeoTIFF",
    GAPS: "where heights are missing, and why: 1 not seen, 2 without a range, 3 too uncertain, 4 "
    "views disagree, GeoTIFF",
    "reef_metrics.csv": "rugosity and other structure, for each square",
    "reef_metrics.tif": "the same as GeoTIFF",
}
"""What the files of OUT/map hold."""

WHAT_IS_WHERE: dict[str, str] = (
    {name: product.what for name, product in PRODUCTS.items()}
    | {MAP: "the fused map of the dive"}
    | DIVE_FILES
)
"""What lies where in OUT, in the order in which a summary lists it."""

SUFFIX_OF_FORMAT = {"png": ".png", "png16": ".png", "tiff32": ".tiff", "jpg": ".jpg"}


@dataclass(frozen=True)
class Shelves:
    """How the outputs of a large dive are spread over folders."""

    most_flat: int = 10_000
    """Most frames in one folder a product: more make file managers and network disks slow."""
    each: int = 1000
    """Frames a folder of a larger dive."""


SHELVES = Shelves()


def subfolder_of(place: tuple[int, int]) -> str:
    """Name the folder in each product's folder that holds a frame's files; "" in a small dive.
    place: the frame's number, of how many.
    """
    number, of = place
    return f"{number // SHELVES.each:05d}" if of > SHELVES.most_flat else ""


def in_subfolder(path: str, subfolder: str) -> str:
    """Insert the subfolder as the last folder of a path relative to OUT."""
    folder, _, name = path.rpartition("/")
    return f"{folder}/{subfolder}/{name}" if subfolder else path


def product_path(product: str, name: str, image_format: str) -> str:
    """The path of a product of a pair, relative to OUT."""
    return f"{product}/{name}{PRODUCTS[product].suffix or SUFFIX_OF_FORMAT[image_format]}"


def original_path(product: str, left: Path) -> str:
    """The path in OUT of a product in the left camera's pixels; named as the left image."""
    return f"{product}/{left.stem}{PRODUCTS[product].suffix or left.suffix}"


def page_path(product: str, name: str) -> str:
    """The path of a file that the page shows of a pair, relative to OUT."""
    return f"{product}/{name}{PAGE_PRODUCTS[product]}"


def state(root: Path, *parts: str) -> Path:
    """A path in the program's own folder of OUT."""
    return root.joinpath(STATE, *parts)


def cache_file(root: Path, name: str) -> Path:
    """The file of the run's cache for that name; moment tables are alike (``table_file``)."""
    return state(root, f"{name}{KEPT}")


def table_file(name: str, subfolder: str) -> str:
    """The file of a frame's moment table, relative to OUT."""
    return in_subfolder(f"{STATE}/tables/{name}{KEPT}", subfolder)


def record_subfolder(name: str) -> str:
    """The folder of a frame's record in a large dive, by the frame's name: one of 256."""
    return f"{zlib.crc32(name.encode()) % 256:02x}"
