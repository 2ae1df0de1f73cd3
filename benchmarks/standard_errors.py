"""How true the stated standard errors are: z = (value - truth) / standard error on drawn reefs.

    python benchmarks/standard_errors.py FOLDER [--reefs 3] [--first-seed 1] [--samples 200]

Each reef is drawn (12 pairs of 640x512), run and fused; its even and odd pairs are run and fused
too, between which nothing changed. For each quantity that a user can publish: how many are within
two standard errors, the mean of z, the largest one. Lengths and areas are of random places, given
exactly, on a rig that is exactly known: what is judged is the error by ranges. Truth is the drawn
surface under the same places; along the surface it is measured with the same steps. Seeds 1 and 2
were at hand when the numbers of MeasureLimits and of mapping/raster/noise.py were chosen. FOLDER
keeps dives and runs.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.run import run
from stereo_seecolor.extras.reef.colony import measure_outlines
from stereo_seecolor.extras.reef.compare import compare
from stereo_seecolor.extras.reef.lengths_and_areas import (
    along_surface,
    length_along,
    planar_area,
    straight_length,
    surface_area,
)
from stereo_seecolor.extras.reef.measure import surface_of
from stereo_seecolor.extras.reef.outlines import Outline
from stereo_seecolor.extras.reef.picking import FrameSurface, Pick
from stereo_seecolor.extras.reef.site_surface import (
    Terrain,
    grid_of,
    open_site,
    terrain_errors,
    terrain_of,
)
from stereo_seecolor.extras.reef.structure import (
    numbers_of,
    resolved_cells,
    squares_of,
    structure,
)
from stereo_seecolor.extras.synthetic.demo import synthesize
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.mapping.raster.noise import height_stds
from stereo_seecolor.run_folder.finished_run import open_run

Array = NDArray[np.float64]
Scores = dict[str, list[float]]
EDGE_PX = 10
SMOOTH_M = 0.01
"""The largest step between pixels of a smooth square."""


def dive(folder: Path, seed: int) -> Path:
    """A drawn dive, its run, and the runs of its even and odd pairs; made where missing."""
    drawn = folder / f"dive_{seed}"
    synthesize(SurveySpec(pairs=12, lines=2, image_size=(640, 512), seed=seed), drawn)
    names = sorted(path.name for path in (drawn / "left").iterdir())
    for part, chosen in (("all", names), ("even", names[::2]), ("odd", names[1::2])):
        out = folder / f"{part}_{seed}"
        if (out / "map/dem.tif").is_file():
            continue
        for side in ("left", "right"):
            place = folder / f"images_{part}_{seed}" / side
            place.mkdir(parents=True, exist_ok=True)
            for name in chosen:
                if not (place / name).exists():
                    (place / name).symlink_to((drawn / side / name).resolve())
        images = folder / f"images_{part}_{seed}"
        run(images / "left", images / "right", drawn / "cam.yaml", out)
        fuse(out, drawn / "trajectory.tum")
    return drawn


def surfaces(drawn: Path, out: Path) -> list[tuple[FrameSurface, FrameSurface]]:
    """Each frame's surface as measured, and the drawn one where that is known."""
    finished, found = open_run(out), []
    for frame in finished.frames:
        measured = surface_of(finished, frame.name)
        true_m = cv2.imread(str(drawn / f"truth/range/{frame.name}.tiff"), cv2.IMREAD_UNCHANGED)
        true_m = np.where(np.isfinite(measured.range_m), true_m, np.nan).astype(np.float32)
        found.append((measured, replace(measured, range_m=true_m)))
    return found


def picked(surface: FrameSurface, places: Array) -> list[Pick] | None:
    """The points at places, exactly given; None where one is not known, or at a step."""
    picks = [surface.pick(float(x), float(y), 0.0) for x, y in places]
    found = [pick for pick in picks if pick and surface.nearer_m(pick) is None]
    return found if len(found) == len(places) else None


def lengths(both: list[tuple[FrameSurface, FrameSurface]], samples: int, seed: int) -> Scores:
    """Between random places of a frame."""
    rng, z = np.random.default_rng(seed), defaultdict(list)
    while len(z["straight length"]) < samples:
        measured, drawn = both[rng.integers(len(both))]
        height, width = measured.range_m.shape
        places = rng.integers(EDGE_PX, (width - EDGE_PX, height - EDGE_PX), (2, 2)).astype(float)
        picks, true = picked(measured, places), [drawn.pick(x, y, 0.0) for x, y in places]
        if picks is None or true[0] is None or true[1] is None:
            continue
        true_picks = [pick for pick in true if pick]
        for name, found, right in (
            ("straight length", straight_length(picks), straight_length(true_picks)),
            (
                "length along the surface",
                length_along(along_surface(measured, picks)),
                length_along(along_surface(drawn, true_picks)),
            ),
        ):
            z[name].append((found.value - right.value) / found.std)
    return z


def areas(both: list[tuple[FrameSurface, FrameSurface]], samples: int, seed: int) -> Scores:
    """Of random squares of 30 to 80 pixels without a step, whole in both."""
    rng, z = np.random.default_rng(seed), defaultdict(list)
    while len(z["flat area"]) < samples:
        measured, drawn = both[rng.integers(len(both))]
        height, width = measured.range_m.shape
        size = int(rng.integers(30, 80))
        x, y = rng.integers(EDGE_PX, (width - EDGE_PX - size, height - EDGE_PX - size))
        window = drawn.range_m[y : y + size, x : x + size]
        steps = [np.abs(np.diff(window, axis=axis)).max() for axis in (0, 1)]
        if not max(steps) < SMOOTH_M:
            continue
        corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * size + (x, y)
        picks, true = picked(measured, corners), picked(drawn, corners)
        if picks is None or true is None:
            continue
        for name, found, right in (
            ("flat area", planar_area(picks), planar_area(true)),
            ("surface area", surface_area(measured, picks)[0], surface_area(drawn, true)[0]),
        ):
            z[name].append((found.value - right.value) / found.std)
    return z


def of_map(drawn: Path, out: Path, samples: int, seed: int) -> Scores:
    """Heights of cells, structure of squares, volumes of random outlines of the map."""
    site, z = open_site(out), defaultdict(list)
    terrain = terrain_of(site.mesh, grid_of(site.mesh, site.posed.map.cell_m["dem_m"]))
    errors, true = terrain_errors(site.posed, terrain), true_terrain(drawn, terrain, site.posed)
    off = (terrain.height_m - true.height_m) / height_stds(terrain.height_m, errors.std_m)
    rng = np.random.default_rng(seed)
    z["height"] = list(rng.choice(off[np.isfinite(off)], min(50 * samples, off.size)))
    cells = resolved_cells(terrain, errors)
    coarse, true_coarse = terrain.averaged(cells), true.averaged(cells)
    for found in structure(site.mesh, terrain, errors):
        windows = squares_of(coarse)[found.edge_m]
        right = numbers_of(true_coarse.height_m, found.scale_m, windows).mean(axis=0)
        z["rugosity"].append(
            (found.mean.rugosity_area - right[0]) / found.standard_error.rugosity_area
        )
        z["height range"].append(
            (found.mean.height_range_m - right[3]) / found.standard_error.height_range_m
        )
    outlines = circles(terrain, rng, min(samples, 40))
    measured = measure_outlines(outlines, site.mesh, terrain, errors, 0.0)
    exact = replace(errors, std_m=0 * errors.std_m, noise_m=0 * errors.noise_m)
    for found_one, right_one in zip(
        measured, measure_outlines(outlines, site.mesh, true, exact, 0.0), strict=True
    ):
        if found_one and right_one and np.isfinite(found_one.measured.volume_l):
            volume_l, std_l = found_one.measured.volume_l, found_one.standard_error.volume_l
            z["volume"].append((volume_l - right_one.measured.volume_l) / std_l)
    return z


def true_terrain(drawn: Path, terrain: Terrain, posed: object) -> Terrain:
    """The drawn heights of the cells that the map knows."""
    truth = np.load(drawn / "truth/surface.npz")
    offset_m = np.array(posed.offset_m)  # type: ignore[attr-defined]
    x, y, _ = np.moveaxis(terrain.points_m + offset_m, -1, 0)
    column, row = (
        ((values - low) / float(truth["cell_m"])).astype(np.float32)
        for values, low in zip((x, y), truth["origin_m"], strict=True)
    )
    height_m = cv2.remap(truth["height_m"].astype(np.float32), column, row, cv2.INTER_LINEAR)
    known_m = np.where(terrain.known, height_m - offset_m[2], np.nan)
    return replace(terrain, height_m=known_m.astype(np.float64))


def circles(terrain: Terrain, rng: np.random.Generator, count: int) -> list[Outline]:
    """Circles of 10 to 25 cm that the map knows whole, with their ground."""
    angle, found = np.linspace(0, 2 * np.pi, 60, endpoint=False), []
    grid = terrain.grid
    while len(found) < count:
        row, column = (int(rng.integers(30, size - 30)) for size in grid.shape)
        radius_m = float(rng.uniform(0.1, 0.25))
        reach = int(radius_m / grid.cell_m) + 4
        window = terrain.known[
            max(row - reach, 0) : row + reach, max(column - reach, 0) : column + reach
        ]
        if window.all():
            x, y = grid.centers(slice(row, row + 1), slice(column, column + 1))
            ring = radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
            found.append(Outline(f"{len(found)}", "", ((*ring, x[0, 0], y[0, 0]),)))
    return found


def scores(folder: Path, seed: int, samples: int) -> Iterator[tuple[str, list[float]]]:
    """Each quantity of a reef, with its z."""
    drawn = dive(folder, seed)
    both = surfaces(drawn, folder / f"all_{seed}")
    for part in (
        lengths(both, samples, seed),
        areas(both, samples, seed),
        of_map(drawn, folder / f"all_{seed}", samples, seed),
    ):
        yield from part.items()
    change = compare(folder / f"even_{seed}", folder / f"odd_{seed}").change
    patches = [each for each in change.patches if each.kind in ("growth", "loss")]
    yield "change where none is", [each.volume_l / each.volume_std_l for each in patches]


def row(name: str, z: list[float]) -> str:
    """A row of the table."""
    values = np.array(z)
    if not values.size:
        return f"| {name} | 0 | | | |"
    inside, most = np.mean(np.abs(values) <= 2), np.abs(values).max()
    return f"| {name} | {values.size} | {inside:.1%} | {values.mean():+.2f} | {most:.1f} |"


def main(folder: Path, reefs: int, first_seed: int, samples: int) -> None:
    """Print the table over all reefs."""
    together: Scores = defaultdict(list)
    for seed in range(first_seed, first_seed + reefs):
        for name, z in scores(folder, seed, samples):
            together[name] += z
    print("| quantity | n | within 2 | mean z | largest |\n|---|---|---|---|---|")
    for name, z in together.items():
        print(row(name, z))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--reefs", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--samples", type=int, default=200)
    given = parser.parse_args()
    main(given.folder, given.reefs, given.first_seed, given.samples)
