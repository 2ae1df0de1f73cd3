"""The engines of maps against each other (mapping.engine: tiles, open3d): time, memory, and error
against the truth.

    python benchmarks/mapping_engines.py FOLDER [OUT ...]

Draws two dives of 12 pairs of 512x416 into FOLDER: one at a steady altitude of 1.9 m, and one that
sees the same ground from 1.2 m and then from 4.5 m. Both are matched and color-corrected with the
defaults, placed by the true poses and fused by each engine. Thin relief is what rises more than 2
cm above the reef without all that is narrower than 9 cm. Each OUT is a finished run, mapped without
poses; there the engines are compared with each other. Every map is made in a process of its own.
"""

import argparse
import json
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rasterio
from arguments import parser_of
from map_errors import nearest_distance_m
from mapping_quality import Survey
from numpy.typing import NDArray

from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.extras.synthetic.reef import CELL_M
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.files.ply import read_vertices
from stereo_seecolor.mapping.surface import engines
from stereo_seecolor.mapping.surface.engines import FuseTile
from stereo_seecolor.mapping.survey_map import Workspace, build_map
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.survey_frames import SurveyFrames

ENGINES = ("tiles", "open3d")
DRAWN = {
    "steady": SurveySpec(pairs=12, image_size=(512, 416), altitude_m=(1.9, 1.9), seed=11),
    "near, then far": SurveySpec(
        pairs=12, image_size=(512, 416), altitude_m=(1.2, 4.5), line_spacing_m=0.2, seed=11
    ),
}
Rows = dict[str, float]


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument(
        "folder", type=Path, metavar="FOLDER", help="where dives are drawn and maps are written"
    )
    parser.add_argument("runs", type=Path, nargs="*", metavar="OUT", help="finished runs")
    parser.add_argument("--one", nargs=2, metavar=("DIVE", "ENGINE"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one:
        print(json.dumps(one_map(args.folder, *args.one)))
        return
    for name, spec in DRAWN.items():
        survey = Survey(args.folder / name, spec)
        took = [measured(args.folder, name, engine) for engine in ENGINES]
        errors = [against_truth(survey, maps(args.folder, name, engine)) for engine in ENGINES]
        show(name, [first | second for first, second in zip(took, errors, strict=True)])
    for run in args.runs:
        rows = [measured(args.folder, str(run), engine) for engine in ENGINES]
        show(str(run), rows)
        for what, value in between(
            *(maps(args.folder, str(run), engine) for engine in ENGINES)
        ).items():
            print(f"| {what} | {value:.3g} |")


def show(name: str, columns: list[Rows]) -> None:
    print(f"\n| {name} | {' | '.join(ENGINES)} |\n| --- |{' --- |' * len(ENGINES)}")
    for what in columns[0]:
        print(f"| {what} | {' | '.join(f'{column[what]:.3g}' for column in columns)} |")


def maps(folder: Path, dive: str, engine: str) -> Path:
    return folder / "maps" / Path(dive).name / engine


def measured(folder: Path, dive: str, engine: str) -> Rows:
    """Make the map of a dive in a new process: what it took."""
    shutil.rmtree(maps(folder, dive, engine), ignore_errors=True)
    command = [sys.executable, __file__, str(folder), "--one", dive, engine]
    rows: Rows = json.loads(
        subprocess.run(command, check=True, capture_output=True, text=True).stdout
    )
    return rows


def one_map(folder: Path, dive: str, engine: str) -> Rows:
    seconds = 0.0

    own = engines.engine

    def timed(name: str) -> FuseTile:
        fuse_tile = own(name)

        def fuse(*args: Any) -> Any:
            nonlocal seconds
            started = time.process_time()
            try:
                return fuse_tile(*args)
            finally:
                seconds += time.process_time() - started

        return fuse

    engines.engine = timed  # type: ignore[assignment]
    config, workspace = MappingConfig(engine=engine), Workspace(compute=Threads(cores()))
    if dive in DRAWN:
        survey = Survey(folder / dive, DRAWN[dive])
        config = config.model_copy(update={"poses": "given"})
        build_map(
            survey, survey.pair, maps(folder, dive, engine), config, survey.trajectory, workspace
        )
    else:
        frames = SurveyFrames(open_run(Path(dive)))
        build_map(frames, frames.geometry, maps(folder, dive, engine), config, None, workspace)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (
        1024 if sys.platform.startswith("linux") else 1024**2
    )
    return {
        "tiles fused, processor s": seconds,
        "whole map, processor s": time.process_time(),
        "peak memory, MiB": peak,
    }


def against_truth(survey: Survey, folder: Path) -> Rows:
    cloud = np.asarray(read_vertices(folder / "cloud.ply")["position"], np.float64)
    reef = survey.scene.reef
    off_m = nearest_distance_m(cloud[::5], survey.surface, 0.1)
    missed_m = nearest_distance_m(survey.seen, cloud, 0.03)
    size = round(0.09 / CELL_M)
    opened = cv2.morphologyEx(
        reef.height_m, cv2.MORPH_OPEN, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    )
    is_thin = at(reef.height_m - opened, reef.origin_m, survey.seen) > 0.02
    with rasterio.open(folder / "dem.tif") as dem:
        heights_m, place = dem.read(1), dem.transform
    rows, columns = np.nonzero(np.isfinite(heights_m))
    centers = np.stack(place * (columns + 0.5, rows + 0.5), axis=-1)
    wrong_m = np.abs(heights_m[rows, columns] - at(reef.height_m, reef.origin_m, centers))
    return {
        "terrain: median error, mm": 1000 * float(np.median(wrong_m)),
        "terrain: RMS error, mm": 1000 * float(np.sqrt((wrong_m**2).mean())),
        "thin relief with a point within 1 cm, %": 100 * float((missed_m[is_thin] < 0.01).mean()),
        "points off by over 3 cm, %": 100 * float((off_m > 0.03).mean()),
        "holes: seen, no point within 3 cm, %": 100 * float(np.isinf(missed_m).mean()),
    }


def at(grid: NDArray, origin_m: tuple[float, float], points_m: NDArray) -> NDArray[np.float32]:
    """The grid's values at points (N, 2 or more)."""
    column, row = ((points_m[:, :2] - origin_m) / CELL_M).astype(np.float32).T
    parts = 1 + len(column) // 30_000
    pairs = zip(np.array_split(column, parts), np.array_split(row, parts), strict=True)
    return np.concatenate(
        [cv2.remap(grid.astype(np.float32), c, r, cv2.INTER_LINEAR).ravel() for c, r in pairs]
    )


def between(first: Path, second: Path) -> Rows:
    """How the terrain of two maps differs."""
    ours, theirs = (terrain(folder) for folder in (first, second))
    both = ours.keys() & theirs.keys()
    apart_m = np.abs([ours[cell] - theirs[cell] for cell in both])
    return {
        "terrain: median difference, mm": 1000 * float(np.median(apart_m)),
        "terrain: 95 % of differences within, mm": 1000 * float(np.quantile(apart_m, 0.95)),
        "cells of tiles alone, %": 100 * (1 - len(both) / len(ours)),
        "cells of open3d alone, %": 100 * (1 - len(both) / len(theirs)),
    }


def terrain(folder: Path) -> dict[tuple[int, int], float]:
    """The height of each cell, by its place in whole cells."""
    with rasterio.open(folder / "dem.tif") as dem:
        heights_m, place = dem.read(1), dem.transform
    left, top = round(place.c / place.a), round(place.f / place.a)
    return {
        (left + x, top - y): float(heights_m[y, x])
        for y, x in np.argwhere(np.isfinite(heights_m)).tolist()
    }


if __name__ == "__main__":
    main()
