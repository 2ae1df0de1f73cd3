"""Points of CoralNet on a map: its annotations (CSV) of exported tiles or of corrected frames, and
the cover that they give.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath, PureWindowsPath

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import transform_points
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.export.mosaic_tiles import windows
from stereo_seecolor.files import csv_tables
from stereo_seecolor.files.rasters import open_raster
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.run_folder.finished_run import FinishedFrame
from stereo_seecolor.run_folder.layout import MOSAIC
from stereo_seecolor.run_folder.posed_run import PosedRun

PLACE = ("name", "row", "column")
LABELS = ("label", "label code", "label id")
"""Columns of CoralNet's annotations: as it exports them, as it takes them, and as numbers."""
Z95 = 1.959964
"""Of the normal distribution: 95 % lie within."""


@dataclass(frozen=True)
class LabelledPoint:
    """A point with its label. x_m, y_m: of the map; NaN where its frame has no range."""

    label: str
    x_m: float
    y_m: float


@dataclass(frozen=True)
class PointCover:
    """The fraction of all labelled points that have a label, with its 95 % interval (Wilson)."""

    label: str
    points: int
    fraction: float
    low: float
    high: float


def read_points(path: Path, posed: PosedRun) -> list[LabelledPoint]:
    """The labelled points of CoralNet's CSV; rows without a label are left out.

    Name: a tile of ``export --to tiles``, or a corrected frame, with or without folder and suffix.
    Row, Column: its pixel, from 0. A point that is listed twice is one. Raises InputError if the
    table cannot be used, names another image, or a pixel beside it, or labels a point in two ways.
    """
    names = csv_tables.header(path)
    labels = [name for name in LABELS if name in names] or LABELS[:1]
    images = _PlacedImages(posed)
    found, known = [], dict[tuple[str, int, int], str]()
    for where, row in csv_tables.rows(path, (*PLACE, *labels)):
        label = next(filter(None, (row[name].strip() for name in labels)), "")
        if not label:
            continue
        try:
            pixel = _whole(row["column"]), _whole(row["row"])
        except ValueError:
            raise InputError(f"{where}: Row and Column are not whole numbers") from None
        place = row["name"].strip(), *pixel
        if known.get(place, label) != label:
            raise InputError(
                f"{where}: labels a point as {label!r} that is {known[place]!r} in a line above: "
                "leave one, such as those of one annotator"
            )
        if place in known:
            continue
        known[place] = label
        try:
            found.append(LabelledPoint(label, *images.spot(row["name"], pixel)))
        except ValueError as error:
            raise InputError(f"{where}: {row['name']!r} {error}") from error
    if not found:
        raise InputError(f"{path}: contains no labeled point: export CoralNet's annotations as CSV")
    return found


def _whole(cell: str) -> int:
    """A whole number, also as 12.0, as tables of numbers write it. Raises ValueError."""
    value = float(cell)
    if not value.is_integer():
        raise ValueError(cell)
    return int(value)


class _PlacedImages:
    """Where pixels of tiles and frames lie on a map."""

    def __init__(self, posed: PosedRun) -> None:
        self.posed = posed
        self.frames = {frame.name: number for number, frame in enumerate(posed.frames)}
        self.unplaced = {frame.name for frame in posed.run.frames} - self.frames.keys()
        self.tiles: dict[str, tuple[int, int, int, int]] = {}
        if (posed.map_folder / MOSAIC).is_file():
            with open_raster(posed.map_folder / MOSAIC) as mosaic:
                self.transform = mosaic.transform
                self.tiles = {
                    f"{row}_{column}": window
                    for row, column, window in windows(mosaic.width, mosaic.height)
                }
        self.latest: tuple[FinishedFrame, NDArray[np.float32]] | None = None

    def spot(self, name: str, pixel: tuple[int, int]) -> tuple[float, float]:
        """x and y of a pixel in the map's own coordinates, NaN where the map lacks the frame.

        Raises ValueError.
        """
        file = PureWindowsPath(name.strip()).name
        for image in (file, PurePath(file).stem):  # names of frames may hold dots
            if image in self.frames:
                return self._in_frame(image, pixel)
            if image in self.unplaced:
                _check_inside(pixel, self.posed.geometry.image_size)
                return np.nan, np.nan
            if image in self.tiles:
                return self._in_tile(image, pixel)
        raise ValueError("is neither a frame of the run nor a tile of export --to tiles")

    def _in_tile(self, name: str, pixel: tuple[int, int]) -> tuple[float, float]:
        left, top, *size = self.tiles[name]
        _check_inside(pixel, size)
        x, y = self.transform @ (left + pixel[0] + 0.5, top + pixel[1] + 0.5)
        return float(x - self.posed.offset_m[0]), float(y - self.posed.offset_m[1])

    def _in_frame(self, name: str, pixel: tuple[int, int]) -> tuple[float, float]:
        geometry, number = self.posed.geometry, self.frames[name]
        frame = self.posed.frames[number]
        _check_inside(pixel, geometry.image_size)
        if self.latest is None or self.latest[0] is not frame:  # tables are sorted by image
            self.latest = frame, self.posed.measured_range_m(frame)
        column, row = pixel
        point_m = geometry.rays[row, column] * self.latest[1][row, column]
        at = transform_points(self.posed.T_map_camera[number], point_m)
        return float(at[0]), float(at[1])


def _check_inside(pixel: tuple[int, int], size: Sequence[int]) -> None:
    if not (0 <= pixel[0] < size[0] and 0 <= pixel[1] < size[1]):
        raise ValueError(
            f"has {size[0]} x {size[1]} pixels, not one in row {pixel[1]}, column {pixel[0]}: "
            "annotate the corrected images, or the tiles, in their own size"
        )


def on_map(
    points: Sequence[LabelledPoint], height_m: NDArray[np.floating], grid: Grid
) -> list[LabelledPoint]:
    """The points at which the map shows the bottom."""
    place = np.array([(each.x_m, each.y_m) for each in points]).reshape(-1, 2)
    known = np.isfinite(place).all(axis=1)
    cells = np.rint(np.where(known[:, None], grid.pixels(place), -1)).astype(np.int64)
    rows, columns = height_m.shape
    known &= ((cells >= 0) & (cells < (columns, rows))).all(axis=1)
    known[known] = np.isfinite(height_m[cells[known, 1], cells[known, 0]])
    return [each for each, seen in zip(points, known, strict=True) if seen]


def point_cover(points: Sequence[LabelledPoint]) -> Iterator[PointCover]:
    """A row for each label, the most frequent first; the page computes the same."""
    of = len(points)
    for label, count in Counter(each.label for each in points).most_common():
        yield PointCover(label, count, count / of, *wilson(count, of))


def wilson(count: int, of: int) -> tuple[float, float]:
    """The 95 % interval of a fraction (Wilson 1927, J. American Statistical Association 22)."""
    p, scale = count / of, 1 + Z95**2 / of
    center = (p + Z95**2 / (2 * of)) / scale
    half = Z95 * (p * (1 - p) / of + Z95**2 / (4 * of**2)) ** 0.5 / scale
    return max(center - half, 0.0), min(center + half, 1.0)
