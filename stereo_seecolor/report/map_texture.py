"""The map's surface with the images on it, for the page: tiles of several levels of detail."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.process import return_freed
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.report.map_mesh import RIM_SHADE, SIZES, Piece, box, packed_surface
from stereo_seecolor.report.mesh_levels import Level, Numbered, Place, below, tile_edge_m
from stereo_seecolor.report.number_code import coded
from stereo_seecolor.run_folder.posed_run import PosedRun
from stereo_seecolor.texture.painting import PageMesh
from stereo_seecolor.texture.surface import PaintedSurface
from stereo_seecolor.texture.textured import textured
from stereo_seecolor.texture.views import Views


@dataclass(frozen=True)
class TextureSizes:
    """Sizes of tiles, and how fine their surface and texture are."""

    triangles: int = 60_000  # of a tile, and
    pixels: int = 3_000_000  # of the images: loaded in a tenth of a second
    voxels_per_cell: float = 2.0  # finer cells are rough by noise, which smears what lies on them
    texels_per_cell: float = 4.0  # a surface as fine as its texture shows nothing more
    jpeg_quality: int = 75  # errors below the noise of the images
    steps_per_texel: int = 4  # of places in the texture


TEXTURES = TextureSizes()

Tile = tuple[str, dict[str, Any], list[dict[str, Any]]]
"""Name, entry in the list of pieces, and parts for the script."""


def textured_tiles(posed: PosedRun, levels: Sequence[Level], voxel_m: float) -> Iterator[Tile]:
    """Paint the levels of a mesh, the finest first: the first that is coarse enough has the images'
    pixels, each further one half as many along each axis.
    """
    least_m = max(TEXTURES.voxels_per_cell * voxel_m, TEXTURES.texels_per_cell * posed.pixel_m)
    painted = [each for each in levels if each.cell_m >= least_m] or levels[-1:]
    finest = painted[0]
    area_m2 = sum(_area_m2(piece) for _, piece in finest.tiles())
    count = max(finest.triangles / TEXTURES.triangles, area_m2 / posed.pixel_m**2 / TEXTURES.pixels)
    edge_m = tile_edge_m(np.array(list(finest.boxes.values())), count, voxel_m)
    cut = [level.places(edge_m * 2**number) for number, level in enumerate(painted)]
    top = len(cut) - 1
    whole = {
        (column >> top - level, row >> top - level)
        for level, of_level in enumerate(cut)
        for column, row in of_level
    }
    keys = [
        key for place in sorted(whole) for key in _in_order(top, place) if key[1] in cut[key[0]]
    ]

    def work() -> Iterator[tuple[float, int, Numbered]]:
        for number, place in keys:
            level = painted[number]
            yield level.cell_m, 2**number, level.square(place, edge_m * 2**number)

    made = Threads(cores()).each(partial(_packed, Views(posed)), work())
    for (level, place), (where, parts) in zip(keys, made, strict=True):
        finer = [each for each in below(place) if level and each in cut[level - 1]]
        entry = {
            **where,
            "cell_m": painted[level].cell_m,
            "texel_m": posed.pixel_m * 2**level,
            "texels": sum(int(np.prod(part["size"])) for part in parts if "size" in part),
            "finer": [_name(level - 1, each) for each in finer],
        }
        yield _name(level, place), entry, parts
        return_freed()  # pictures that are kept lie between what a tile freed


def _in_order(level: int, place: Place) -> Iterator[tuple[int, Place]]:
    """A tile after those below it: they need the same images."""
    if level > 0:
        for each in below(place):
            yield from _in_order(level - 1, each)
    yield level, place


def _name(level: int, place: Place) -> str:
    return f"textured_{level}_{place[0]}_{place[1]}"


def _area_m2(piece: Piece) -> float:
    a, b, c = (piece.points_m[corner] for corner in piece.triangles.T)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2


def _packed(
    views: Views, tile: tuple[float, int, Numbered]
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Where a tile lies, and its parts: pages of texture with their triangles, and those that no
    image shows in the map's colors. tile: edge of its cells, pixels of the images to one of the
    texture, mesh.
    """
    cell_m, step, piece = tile
    surface = PaintedSurface(
        piece.points_m.astype(np.float64),
        piece.colors,
        piece.triangles.astype(np.int32),
        cell_m / 2,
    )
    made = textured(views, surface)
    correction = made.charts.correction.copy()
    correction[piece.rim[made.charts.vertex]] -= RIM_SHADE
    made = replace(made, charts=replace(made.charts, correction=correction))
    unseen = made.charts.of_face < 0
    step_m = cell_m / SIZES.steps_per_voxel
    parts = [
        _page(piece, step_m, *page)
        for page in replace(made, group=np.where(unseen, -1, 0)).pages(step=step)
    ]
    if unseen.any():
        parts.append(piece.of(unseen).packed(step_m))
    return box(piece), parts


def _page(piece: Piece, step_m: float, mesh: PageMesh, pixels: NDArray[np.uint8]) -> dict[str, Any]:
    size = pixels.shape[1::-1]
    flags = [cv2.IMWRITE_JPEG_QUALITY, TEXTURES.jpeg_quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    jpeg = cv2.imencode(".jpg", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), flags)[1].tobytes()
    texels = np.rint(mesh.uv * np.array(size, np.float32) * TEXTURES.steps_per_texel)
    return packed_surface(piece.points_m[mesh.vertex], mesh.triangles, step_m) | {
        "uv": coded(texels.astype(np.int32).T),
        "uv_steps": TEXTURES.steps_per_texel,
        "size": size,
        "jpeg": jpeg,
    }
