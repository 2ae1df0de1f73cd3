"""The page's files of a map: mesh, mosaic and terrain; made again after another fusion."""

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from stereo_seecolor.compute.process import return_freed
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.rasters import can_read_rasters, raster_problem
from stereo_seecolor.report.facts import DiveFacts
from stereo_seecolor.report.height_code import height_std_m, height_tiles
from stereo_seecolor.report.map_gaps import fits, gap_tiles, packed_reasons, reasons
from stereo_seecolor.report.map_images import TerrainImages, mosaic_tiles, pyramid
from stereo_seecolor.report.map_mesh import SIZES, Piece, box
from stereo_seecolor.report.map_sides import packed_sides
from stereo_seecolor.report.mesh_levels import Level, MeshSource, Place, below, levels
from stereo_seecolor.report.raw_mosaic import RawMosaic, painted_from
from stereo_seecolor.report.squares import Squares
from stereo_seecolor.report.templates import script
from stereo_seecolor.run_folder.finished_map import FinishedMap
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import GAPS, MAP, MESH, MOSAIC, PAGE, TERRAIN
from stereo_seecolor.run_folder.posed_run import PosedRun
from stereo_seecolor.run_folder.stamp import Stamp

FORMAT = "14"
FOLDER = f"{PAGE}/map"
RASTERS = {MOSAIC: 4, TERRAIN: 1, GAPS: 1}
"""Of the map that the page shows, with their bands."""
Files = Iterator[tuple[str, bytes]]
Pieces = dict[str, dict[str, Any]]
"""Entries of pieces, by their names."""


def write_map_files(folder: RunFolder, facts: DiveFacts) -> dict[str, str]:
    """Write OUT/page/map, and delete an earlier page's files of another map. Raises OutputError.

    Returns damaged rasters, which the page lacks: path in OUT -> why.
    """
    made = facts.map
    key = content_key(*_stamps(made)) if made else ""
    made_from = content_key(FORMAT, key, *(painted_from(facts.posed) if facts.posed else ()))
    earlier = [name for name in folder.dive.record.files if name.startswith(f"{FOLDER}/")]
    current = folder.dive.record.made_from.get(FOLDER) == made_from
    if earlier and current and all((folder.root / name).is_file() for name in earlier):
        return {}
    if earlier:
        folder.dive.remove(FOLDER)
    if made is None:
        return {}
    damaged = {
        name: why
        for name, bands in RASTERS.items()
        if (made.folder / name).is_file()
        and can_read_rasters()
        and (why := raster_problem(made.folder / name, bands))
    }
    files = _MapFiles.of(facts, made, frozenset(damaged))
    # a page without a part is not kept: the next report makes it again, and names what is damaged
    folder.dive.write_folder(FOLDER, files.contents(key), made_from="" if damaged else made_from)
    return {f"{MAP}/{name}": why for name, why in damaged.items()}


def _stamps(made: FinishedMap) -> list[str]:
    return [
        Stamp.of(made.folder / name).digest
        for name in (MESH, *RASTERS)
        if (made.folder / name).is_file()
    ]


@dataclass(frozen=True, eq=False)
class _MapFiles:
    """Makes the page's files of a map. terrain, raw: None where it has none. std_m: standard error
    of a height, NaN if unknown. has_mosaic, has_gaps: whether there are such that can be read.
    """

    made: FinishedMap
    posed: PosedRun | None
    std_m: float
    terrain: TerrainImages | None
    raw: RawMosaic | None
    squares: Squares | None
    has_mosaic: bool
    has_gaps: bool

    @classmethod
    def of(cls, facts: DiveFacts, made: FinishedMap, damaged: frozenset[str]) -> "_MapFiles":
        readable = RASTERS.keys() - damaged if can_read_rasters() else set()
        there = {name: name in readable and (made.folder / name).is_file() for name in RASTERS}
        terrain = TerrainImages.open(made.folder / TERRAIN) if there[TERRAIN] else None
        raw = RawMosaic.paint(facts.posed, terrain) if terrain and facts.posed else None
        std_m = height_std_m(facts.run)
        has_gaps = bool(there[GAPS] and terrain and fits(made.folder / GAPS, terrain.about))
        return cls(made, facts.posed, std_m, terrain, raw, facts.squares, there[MOSAIC], has_gaps)

    def contents(self, key: str) -> Files:
        """(path in page/map, content) of all files; map.js, which lists them, comes last."""
        about: dict[str, Any] = {
            "id": key[:16],
            "pieces": {},
            "offset_m": self.made.offset_m,
            "range_scale": self.made.range_scale,
            "preview": f"{MAP}/orthomosaic_preview.png",
        }
        if self.squares is not None and len(self.squares.rows):
            about["squares"] = {
                "edge_m": self.made.cell_m["metrics_m"],
                "scale_m": self.squares.scale_m,
                "names": list(self.squares.names),
            }
            yield from _squares(self.squares, self.made.offset_m)
        path = self.made.folder / MESH
        mesh = MeshSource.open(path) if path.is_file() else None
        if mesh is not None and len(mesh.triangles):
            return_freed()
            yield from self._mesh(about, mesh)
            return_freed()
        if self.has_mosaic:
            about["mosaic"], tiles = mosaic_tiles(self.made.folder / MOSAIC)
            yield from ((f"mosaic/{name}", content) for name, content in tiles)
        yield from self._terrain(about, mesh)
        yield "map.js", script("map", about)

    def _mesh(self, about: dict[str, Any], source: MeshSource) -> Files:
        """The files of the mesh; only pieces below no other are listed, the others by the script of
        the next coarser one, so that the list of a map of many frames is short.
        """
        voxel_m, made = self.made.cell_m["voxel_m"], list[Level]()
        with tempfile.TemporaryDirectory() as folder:  # gigabytes, for a map of thousands of frames
            for level in levels(source, voxel_m, Path(folder)):
                yield from self._level(about["pieces"], len(made), level)
                made.append(level)
                return_freed()
            if self.posed is None:
                return
            # scipy takes long to load
            from stereo_seecolor.report.map_texture import textured_tiles

            painted = about["textured"] = {}
            for tile_name, tile, parts in textured_tiles(self.posed, made, voxel_m):
                finer = _taken(painted, tile["finer"])
                painted[tile_name] = _around(tile, finer)
                yield f"{tile_name}.js", script("textured", tile_name, parts, finer)
            if len(about["pieces"]) == 1:  # else several pieces show the whole map at first
                ((_, piece),) = made[-1].tiles()
                (entry,) = about["pieces"].values()
                painted["whole"] = entry | {"finer": sorted(painted)}
                yield "whole.js", self._script("whole", piece, made[-1].cell_m, {})

    def _level(self, pieces: Pieces, number: int, level: Level) -> Files:
        """The files of a level's tiles, each listed in ``pieces`` instead of those below it."""

        def named() -> Iterator[tuple[str, Piece, Pieces]]:
            for place, piece in level.tiles():
                name = _name(number, place)
                around = (_name(number - 1, each) for each in below(place))
                finer = _taken(pieces, [each for each in around if each in pieces])
                entry = {**box(piece), "cell_m": level.cell_m, "finer": [*finer]}
                pieces[name] = _around(entry, finer)
                yield name, piece, finer

        yield from Threads(cores()).each(partial(self._piece, level.cell_m), named())

    def _piece(self, cell_m: float, named: tuple[str, Piece, Pieces]) -> tuple[str, bytes]:
        """The file of a tile of the mesh, of a level with cells of that edge."""
        name, piece, finer = named
        if self.raw is not None:  # the images on the surface show the corrected colors
            piece = replace(piece, colors=self.raw.colors_of(piece, self.made.offset_m))
        return f"{name}.js", self._script(name, piece, cell_m, finer)

    @staticmethod
    def _script(name: str, piece: Piece, cell_m: float, finer: Pieces) -> bytes:
        return script("mesh", name, piece.packed(cell_m / SIZES.steps_per_voxel), finer)

    def _terrain(self, about: dict[str, Any], mesh: MeshSource | None) -> Files:
        terrain = self.terrain
        if terrain is None:
            return
        width, height = terrain.about["width"], terrain.about["height"]
        correlation_m = self.posed.correlation_m if self.posed else 0.0
        std_m = self.std_m if np.isfinite(self.std_m) else 0.0
        tiles = []
        for name, window, content in height_tiles(width, height, terrain.heights_m):
            tiles.append(name)
            if self.has_gaps:
                content |= packed_reasons(reasons(self.made.folder / GAPS, window))
            if mesh is not None:
                content |= packed_sides(terrain, window, mesh, self.made.offset_m, std_m)
            yield f"heights/{name}.js", script("heights", name, content)
        if self.has_gaps:
            about["gaps"] = _place_of(terrain.about)
            tiles_of_gaps = gap_tiles(self.made.folder / GAPS, width, height)
            yield from ((f"gaps/{name}", content) for name, content in tiles_of_gaps)
        about["terrain"] = {
            **terrain.about,
            "tiles": tiles,
            "std_m": std_m,
            "correlation_m": correlation_m if np.isfinite(correlation_m) else 0.0,
        }
        for folder, colored in (("terrain", True), ("hillshade", False)):
            yield from ((f"{folder}/{name}", content) for name, content in terrain.tiles(colored))
        if self.raw is not None:
            about["raw"] = _place_of(terrain.about)
            yield from (
                (f"raw/{name}", content) for name, content in pyramid(width, height, self.raw.read)
            )


def _place_of(about: dict[str, Any]) -> dict[str, Any]:
    return {key: about[key] for key in ("width", "height", "west_m", "north_m", "pixel_m")}


def _name(level: int, place: Place) -> str:
    return f"{level}_{place[0]}_{place[1]}"


def _taken(pieces: Pieces, names: list[str]) -> Pieces:
    """The pieces of these names, which leave the others."""
    return {name: pieces.pop(name) for name in names}


def _around(entry: dict[str, Any], finer: Pieces) -> dict[str, Any]:
    """A piece whose box also holds those of the finer pieces."""
    all_of = [entry, *finer.values()]
    low_m, high_m = (np.array([each[key] for each in all_of]) for key in ("low_m", "high_m"))
    return entry | {"low_m": low_m.min(axis=0).tolist(), "high_m": high_m.max(axis=0).tolist()}


def _squares(squares: Squares, offset_m: list[float]) -> Files:
    """A script for each metric: x and y of each square, value and standard error, or NaN."""
    places_m = squares.rows[:, :2] - np.array(offset_m[:2])
    for number in range(len(squares.names)):
        columns = places_m, squares.rows[:, [2 + number]], squares.std[:, [number]]
        content = np.concatenate(columns, axis=1).astype("<f4").tobytes()
        yield f"squares/{number}.js", script("squares", number, content)
