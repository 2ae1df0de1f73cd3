"""What the page shows of a map: its mesh, its orthomosaic and its terrain; made again only after another fusion."""

from collections.abc import Iterator
from typing import Any

from stereo_seecolor.files.keys import content_key
from stereo_seecolor.report.map_images import mosaic_tiles, shaded_terrain
from stereo_seecolor.report.map_mesh import SIZES, WHOLE, Piece, pieces, read_mesh
from stereo_seecolor.report.script import script
from stereo_seecolor.run_folder.finished_map import FinishedMap
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import MAP, MESH, MOSAIC, PAGE, TERRAIN
from stereo_seecolor.run_folder.stamp import Stamp

FORMAT = "1"
STRIP_VOXELS = 4
"""Neighbors of a triangle lie in its strip or the next: small numbers, which deflate well."""
FOLDER = f"{PAGE}/map"


def write_map_files(folder: RunFolder, made: FinishedMap | None) -> None:
    """Write OUT/page/map; what an earlier page held of another map, or of one that is gone, is deleted. Raises OutputError."""
    key = content_key(FORMAT, *_stamps(made)) if made else ""
    earlier = [name for name in folder.dive.files if name.startswith(f"{FOLDER}/")]
    if earlier and folder.dive.made_from.get(FOLDER) == key and all((folder.root / name).is_file() for name in earlier):
        return
    if earlier:
        folder.remove(FOLDER)
    if made is not None:
        folder.write_all(FOLDER, _contents(made), made_from=key)


def _stamps(made: FinishedMap) -> list[str]:
    return [Stamp.of(made.folder / name).digest for name in (MESH, MOSAIC, TERRAIN) if (made.folder / name).is_file()]


def _contents(made: FinishedMap) -> Iterator[tuple[str, bytes]]:
    about: dict[str, Any] = {"pieces": {}}
    mesh = read_mesh(made.folder / MESH) if (made.folder / MESH).is_file() else None
    if mesh is not None and len(mesh.triangles):
        step_m = made.cell_m["voxel_m"] / SIZES.steps_per_voxel
        for name, piece in pieces(mesh, made.cell_m["voxel_m"]):
            about["pieces"][name] = _box(piece)
            yield f"{name}.js", script("mesh", name, piece.in_strips(STRIP_VOXELS * made.cell_m["voxel_m"]).packed(step_m))
        about["whole"] = WHOLE
    if (made.folder / MOSAIC).is_file() and (mosaic := mosaic_tiles(made.folder / MOSAIC)):
        about["mosaic"], tiles = mosaic
        yield from ((f"mosaic/{name}", content) for name, content in tiles)
    if (made.folder / TERRAIN).is_file() and (terrain := shaded_terrain(made.folder / TERRAIN)):
        about["terrain"], picture = terrain
        yield "terrain.webp", picture
    about["offset_m"] = made.offset_m
    about["preview"] = f"{MAP}/orthomosaic_preview.png"
    yield "map.js", script("map", about)


def _box(piece: Piece) -> dict[str, Any]:
    low, high = piece.points_m.min(axis=0), piece.points_m.max(axis=0)
    corners = {name: [round(float(value), 4) for value in corner] for name, corner in (("low_m", low), ("high_m", high))}
    return {**corners, "triangles": len(piece.triangles)}
