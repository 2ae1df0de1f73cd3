"""The orthomosaic and the mesh with small holes filled, for pictures and films; a mask and a
separate mesh mark the filled parts.

The run stays as it is: ranges, terrain, metrics and the map's own files hold what was measured.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.map_rasters import open_map_raster, windows_of
from stereo_seecolor.files.ply import FACE, VERTEX, header, read_triangles, read_vertices
from stereo_seecolor.run_folder.layout import MESH, MOSAIC
from stereo_seecolor.run_folder.posed_run import PosedRun

LARGEST_M = 0.1
"""Width and height of the largest hole that is filled: gaps behind corals and between views, not
parts of the reef that nobody saw.
"""
WINDOW_PX = 1024
SMOOTHINGS = 20
"""Passes over what was filled, so that colors of opposite rims meet without an edge."""
FILLED_MOSAIC, FILLED_MESH = "orthomosaic_filled.tif", "mesh_filled.ply"


def write(posed: PosedRun, folder: Path) -> str:
    """orthomosaic.tif and its mask, mesh.ply and its patches. Raises InputError where the map lacks
    one, DeviceError where the library that reads it is missing.
    """
    cells, fraction = _fill_mosaic(posed, folder)
    holes = _fill_mesh(posed.map_folder / MESH, folder)
    return (
        f"{cells} cells of the mosaic ({fraction:.2%} of the seen area) and {holes} holes of the "
        f"mesh filled, none wider than {LARGEST_M:g} m: their colors and surface are "
        "interpolated from the surroundings"
    )


def _fill_mosaic(posed: PosedRun, folder: Path) -> tuple[int, float]:
    """The number of filled cells, and their fraction of those seen."""
    filled_cells = seen_cells = 0
    with open_map_raster(posed, MOSAIC, 4) as mosaic:
        import rasterio
        from rasterio.enums import ColorInterp

        most_px = int(LARGEST_M / float(mosaic.transform.a) + 0.5)
        around = 2 * most_px + SMOOTHINGS + 1  # a hole, and all that its colors are made of
        profile = mosaic.profile
        with (
            rasterio.open(folder / MOSAIC, "w", **profile) as colors,
            rasterio.open(folder / FILLED_MOSAIC, "w", **profile | {"count": 1}) as mask,
        ):
            colors.colorinterp = [
                ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha
            ]  # fmt: skip
            mask.set_band_description(1, "filled")
            for window in windows_of(mosaic, WINDOW_PX):
                rows, columns = window.toslices()
                wide = [
                    (max(0, own.start - around), min(size, own.stop + around))
                    for own, size in ((rows, mosaic.height), (columns, mosaic.width))
                ]
                rgba, filled = fill_holes(mosaic.read(window=tuple(wide)), most_px)
                inner = tuple(
                    slice(own.start - first, own.stop - first)
                    for own, (first, _) in zip((rows, columns), wide, strict=True)
                )
                colors.write(rgba[:, *inner], window=window)
                mask.write(filled[inner].astype(np.uint8), 1, window=window)
                filled_cells += int(filled[inner].sum())
                seen_cells += int((rgba[3][inner] > 0).sum())
    return filled_cells, filled_cells / max(1, seen_cells - filled_cells)


def fill_holes(
    rgba: NDArray[np.uint8], most_px: int
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Fill the unseen parts (alpha 0) of an image (4, H, W) that what was seen encloses, up to
    ``most_px`` wide and high. Returns the image, alpha 255 where it was filled, and where that is,
    (H, W).
    """
    unseen = rgba[3] == 0
    height, width = unseen.shape
    _, labels, stats, _ = cv2.connectedComponentsWithStats(unseen.astype(np.uint8), connectivity=8)
    left, top, across, down = stats[:, :4].T
    inside = (left > 0) & (top > 0) & (left + across < width) & (top + down < height)
    inside &= (across <= most_px) & (down <= most_px)
    inside[0] = False  # what was seen
    holes = inside[labels]
    if not holes.any():
        return rgba, holes
    color = np.moveaxis(rgba[:3], 0, -1).astype(np.float32)
    known = (~unseen).astype(np.float32)
    missing, size = holes.copy(), 3
    while missing.any():
        weight = cv2.blur(known, (size, size))
        mean = cv2.blur(color * known[..., None], (size, size))
        reached = missing & (weight > 1e-6)
        color[reached] = mean[reached] / weight[reached, None]
        missing &= ~reached
        size = 2 * size - 1
    visible = (~unseen | holes).astype(np.float32)
    for _ in range(SMOOTHINGS):
        mean = cv2.blur(color * visible[..., None], (3, 3))
        color[holes] = mean[holes] / cv2.blur(visible, (3, 3))[holes, None]
    filled = rgba.copy()
    filled[:3, holes] = np.rint(color[holes]).astype(np.uint8).T
    filled[3, holes] = 255
    return filled, holes


def _fill_mesh(source: Path, folder: Path) -> int:
    """The number of holes."""
    vertices, faces = read_vertices(source), read_triangles(source)
    indices = np.ascontiguousarray(faces["indices"])
    patches = list(_patches(vertices, indices))
    middles = np.array([middle for middle, _ in patches], VERTEX)
    new = np.empty(sum(len(triangles) for _, triangles in patches), FACE)
    new["count"] = 3
    if patches:
        new["indices"] = np.concatenate(
            [
                np.where(triangles < 0, len(vertices) + i, triangles)
                for i, (_, triangles) in enumerate(patches)
            ]
        )
    comment = "stereo-seecolor, meters, z up"
    with (folder / MESH).open("wb") as file:
        count = len(vertices) + len(middles), len(faces) + len(new)
        file.write(header(f"{comment}, small holes filled", VERTEX, *count))
        for part in (vertices, middles, faces, new):
            file.write(np.ascontiguousarray(part).tobytes())
    used, corners = np.unique(new["indices"], return_inverse=True)
    alone = new.copy()
    alone["indices"] = corners.reshape(-1, 3)
    with (folder / FILLED_MESH).open("wb") as file:
        file.write(header(f"{comment}, filled parts", VERTEX, len(used), len(alone)))
        file.write(np.concatenate([vertices, middles])[used].tobytes() + alone.tobytes())
    return len(patches)


def _patches(
    vertices: NDArray[np.void], triangles: NDArray[np.int32]
) -> Iterator[tuple[Any, NDArray[np.int64]]]:
    """For each hole a vertex in its middle, and triangles (n, 3) from there (-1) to its rim.

    Rims of islands, which would be closed from below, are recognized by the side that faces up;
    holes around islands are left out.
    """
    holes, islands = [], []
    for loop in rims(triangles):
        place = vertices["position"][loop].astype(np.float64)
        if np.ptp(place, axis=0).max() > LARGEST_M:
            continue
        normal = vertices["normal"][loop].astype(np.float64).sum(axis=0)
        arms = place - place.mean(axis=0)
        faces_up = np.cross(np.roll(arms, -1, axis=0), arms).sum(axis=0) @ normal > 0
        if faces_up:
            holes.append((loop, place, normal))
        else:
            islands.append(place[0])
    on_islands = np.reshape(islands, (-1, 3))
    for loop, place, normal in holes:
        low, high = place.min(axis=0)[:2], place.max(axis=0)[:2]
        if ((on_islands[:, :2] > low) & (on_islands[:, :2] < high)).all(axis=1).any():
            continue
        middle = np.zeros((), VERTEX)
        middle["position"], middle["color"] = (
            place.mean(axis=0),
            vertices["color"][loop].mean(axis=0),
        )
        middle["normal"] = normal / max(float(np.linalg.norm(normal)), 1e-12)
        yield middle, np.column_stack([np.roll(loop, -1), loop, np.full(len(loop), -1)])


def rims(triangles: NDArray[np.int32]) -> list[NDArray[np.int64]]:
    """The closed rims of a mesh (F, 3): vertices in the order of its triangles' edges.

    Rims that meet in a vertex are left out.
    """
    corners = triangles.astype(np.int64)
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    count = int(edges.max()) + 1 if edges.size else 1
    keys, reverse = edges @ [count, 1], edges @ [1, count]
    rim = edges[~np.isin(keys, reverse)]
    starts, times = np.unique(rim[:, 0], return_counts=True)
    forked = set(starts[times > 1].tolist())
    following = dict(rim.tolist())
    found = []
    while following:
        first, vertex = following.popitem()
        loop = [first]
        while vertex != first and vertex in following:
            loop.append(vertex)
            vertex = following.pop(vertex)
        if vertex == first and len(loop) > 2 and forked.isdisjoint(loop):
            found.append(np.array(loop))
    return found


FORMAT = ExportFormat(
    "the orthomosaic and the mesh with holes of up to 10 cm filled, and masks of the filled parts",
    "pictures and films, not measurements",
    write,
)
