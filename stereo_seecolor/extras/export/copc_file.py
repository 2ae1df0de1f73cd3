"""The map's point cloud as COPC 1.0: a LAZ 1.4 file whose points lie in an octree, so that viewers
load what they show.

Each level of the tree takes one point of every cell of its grid, at random; what is left goes on to
the next.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.errors import counted
from stereo_seecolor.errors import library_for
from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.files.ply import read_vertices
from stereo_seecolor.mapping.raster.georeference import crs_wkt
from stereo_seecolor.run_folder.layout import CLOUD
from stereo_seecolor.run_folder.posed_run import PosedRun

POINT_FORMAT = 7
"""Of LAS 1.4: with colors."""
POINT = np.dtype(
    [
        *(
            (("xyz"), "<i4", (3,)),
            ("intensity", "<u2"),
            ("returns", "u1"),
            ("flags", "u1"),
            ("class", "u1"),
            ("user", "u1"),
        ),
        *(("angle", "<i2"), ("source", "<u2"), ("time", "<f8"), ("rgb", "<u2", (3,))),
    ]
)
ONLY_RETURN = 0x11
"""The first of one."""
SCALE_M = 1e-4
"""Of coordinates, which LAS holds as whole numbers: finer than ranges are known."""
GRID = 128
"""Cells a side of a node: the specification's own example."""
FEW = 20_000
"""Points of a node that are not divided further."""
DEEPEST = 18
"""Level at which all that is left goes into one node."""


def write(posed: PosedRun, folder: Path) -> str:
    """cloud.copc.laz. Raises DeviceError if a library is missing."""
    with library_for("COPC", "copc"):
        import copclib
    cloud = read_vertices(posed.map_folder / CLOUD)
    position = np.asarray(cloud["position"], np.float64) + posed.offset_m
    low, high = position.min(axis=0), position.max(axis=0)
    offset, half = np.floor(low), max(float((high - low).max()) / 2 * (1 + 1e-6), 1e-3)
    config = copclib.CopcConfigWriter(
        POINT_FORMAT,
        copclib.Vector3(*[SCALE_M] * 3),
        copclib.Vector3(*offset),
        "" if posed.origin is None else crs_wkt(posed.origin),
    )
    config.las_header.min, config.las_header.max = copclib.Vector3(*low), copclib.Vector3(*high)
    about = config.copc_info
    about.center_x, about.center_y, about.center_z = low + half
    about.halfsize, about.spacing = half, 2 * half / GRID
    records = _records(cloud, position - offset)
    file, nodes = copclib.FileWriter(str(folder / "cloud.copc.laz"), config), 0
    for level, cell, points in octree(position - low, 2 * half):
        content = np.frombuffer(records[points].tobytes(), np.int8)
        file.AddNode(copclib.VoxelKey(level, *cell), copclib.VectorChar(content))
        nodes += 1
    file.Close()
    return f"{len(cloud):,} points in {counted(nodes, 'node')}"


def octree(
    position: NDArray[np.float64], side_m: float
) -> Iterator[tuple[int, tuple[int, int, int], NDArray[np.int64]]]:
    """Level, place on the level's grid of nodes, and points of every node. position: (N, 3), from
    the lowest corner of the root.
    """
    left = np.random.default_rng(0).permutation(len(position))
    for level in range(DEEPEST + 1):
        if not len(left):
            return
        count = 1 << level
        node = np.minimum((position[left] / side_m * count).astype(np.int64), count - 1)
        key = (node[:, 0] * count + node[:, 1]) * count + node[:, 2]
        order = np.argsort(key, kind="stable")  # keeps them in random order
        left, node, key = left[order], node[order], key[order]
        starts = np.flatnonzero(np.diff(key, prepend=-1))
        rest = []
        for start, end in zip(starts, np.append(starts[1:], len(left)), strict=True):
            points = left[start:end]
            taken = np.ones(len(points), np.bool_)
            if len(points) > FEW and level < DEEPEST:
                x, y, z = (
                    ((position[points] / side_m * count - node[start]) * GRID).astype(np.int64).T
                )
                taken[:] = False
                taken[np.unique((x * GRID + y) * GRID + z, return_index=True)[1]] = True
            i, j, k = node[start].tolist()
            yield level, (i, j, k), points[taken]
            rest.append(points[~taken])
        left = np.concatenate(rest)


def _records(cloud: NDArray[np.void], from_offset: NDArray[np.float64]) -> NDArray[Any]:
    records = np.zeros(len(cloud), POINT)
    records["xyz"] = np.round(from_offset / SCALE_M)
    records["returns"] = ONLY_RETURN
    records["rgb"] = cloud["color"].astype(np.uint16) * 257
    return records


FORMAT = ExportFormat(
    "the point cloud as COPC, which viewers load in parts",
    "QGIS, PDAL, CloudCompare, viewer.copc.io",
    write,
)
