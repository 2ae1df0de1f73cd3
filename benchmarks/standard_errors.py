"""How true the stated standard errors are: z = (value - truth) / standard error on drawn reefs.

    python benchmarks/standard_errors.py FOLDER [--reefs 3] [--first-seed 1] [--samples 200]

Each reef is drawn (12 pairs of 640x512), run and fused; its even and odd pairs are run and fused
too, between which nothing changed, and the odd ones over a reef with nine bumps more. For each
quantity that a user can publish: how many are within two standard errors, the mean of z, the
largest one. Places are given exactly, on a rig and with poses that are exactly known: what is
judged is the error by ranges. Truth is the drawn surface under the same places; along the surface
it is measured with the same steps. Seeds 1 to 3 and 11 to 13 were at hand when the errors were
chosen, seeds 101 to 103 for areas and heights of outlines. FOLDER keeps dives and runs.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from reef_changes import Change, changed_reef

from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.run import run
from stereo_seecolor.extras.reef.colony import Colony, measure_outlines
from stereo_seecolor.extras.reef.comparing.site_change import SiteChange, compare_sites
from stereo_seecolor.extras.reef.cover import cover
from stereo_seecolor.extras.reef.ground_volume import RIM_CELLS
from stereo_seecolor.extras.reef.lengths_and_areas import (
    Measured,
    along_surface,
    length_along,
    planar_area,
    straight_length,
    surface_area,
)
from stereo_seecolor.extras.reef.map_ground import Ground
from stereo_seecolor.extras.reef.measure import surface_of
from stereo_seecolor.extras.reef.outlines import Outline
from stereo_seecolor.extras.reef.picking import FrameSurface, Pick
from stereo_seecolor.extras.reef.site_surface import Site, SiteMesh, open_site
from stereo_seecolor.extras.reef.terrain_of_mesh import grid_of, terrain_errors, terrain_of
from stereo_seecolor.extras.synthetic.dive import synthesize
from stereo_seecolor.extras.synthetic.reef import CELL_M
from stereo_seecolor.extras.synthetic.render import Scene
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.files.free_places import new_folder
from stereo_seecolor.mapping.raster.block_raster import Grid
from stereo_seecolor.mapping.raster.height_errors import height_stds
from stereo_seecolor.mapping.raster.structure import (
    EDGES_M,
    Window,
    numbers_of,
    resolved_cells,
    squares_of,
    structure,
)
from stereo_seecolor.mapping.raster.terrain import Terrain, TerrainErrors
from stereo_seecolor.report.height_code import height_std_m as typical_std_m
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.posed_run import PosedRun, open_posed_run

Array = NDArray[np.float64]
Scores = dict[str, list[float]]
EDGE_PX = 10
SMOOTH_M = 0.01
"""The largest step between pixels of a smooth square."""
BUMP_SPACING_M = 0.8
TOGETHER = 4
"""Outlines of which the cover is computed."""
PER_CELL = ("std_m", "noise_m", "views")


def spec_of(seed: int) -> SurveySpec:
    """A reef and its dive."""
    return SurveySpec(pairs=12, lines=2, image_size=(640, 512), seed=seed)


def dive(folder: Path, seed: int) -> Path:
    """A drawn dive; its run, the runs of its even and odd pairs, and that of the odd pairs over the
    changed reef; made where missing.
    """
    drawn, bumpy = folder / f"dive_{seed}", folder / f"images_bumps_{seed}"
    synthesize(spec_of(seed), drawn)
    names = sorted(path.name for path in (drawn / "left").iterdir())
    for part, chosen in (("all", names), ("even", names[::2]), ("odd", names[1::2])):
        for side in ("left", "right"):
            place = folder / f"images_{part}_{seed}" / side
            place.mkdir(parents=True, exist_ok=True)
            for name in chosen:
                if not (place / name).exists():
                    (place / name).symlink_to((drawn / side / name).resolve())
    if not bumpy.exists():
        draw_changed(seed, bumpy)
    for part in ("all", "even", "odd", "bumps"):
        out, images = folder / f"{part}_{seed}", folder / f"images_{part}_{seed}"
        if not (out / "map/dem.tif").is_file():
            run(images / "left", images / "right", drawn / "cam.yaml", out)
            fuse(out, drawn / "trajectory.tum")
    return drawn


def draw_changed(seed: int, images: Path) -> None:
    """The odd pairs of the dive, over the changed reef."""
    scene = Scene.from_spec(spec_of(seed))
    scene = replace(scene, reef=changed_reef(scene.reef, bumps(seed)))
    with new_folder(images) as building:
        for index in range(1, scene.spec.pairs, 2):
            frame = scene.photograph(index)
            for side, image in (("left", frame.left), ("right", frame.right)):
                (building / side).mkdir(exist_ok=True)
                path = building / side / f"{frame.name}.png"
                cv2.imwrite(str(path), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))


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


@dataclass(frozen=True, eq=False)
class MappedReef:
    """A fused site with its errors, and the drawn heights of the cells that it knows."""

    site: Site
    terrain: Terrain
    errors: TerrainErrors
    true: Terrain
    height_std_m: float

    @cached_property
    def centers_m(self) -> Array:
        """Of the mesh's triangles: (T, 3)."""
        mesh = self.site.mesh
        return np.asarray(mesh.points_m[mesh.triangles].mean(axis=1))

    def mesh_over(self, grid: Grid) -> SiteMesh:
        """The part of the mesh over some cells."""
        cells, (rows, columns) = grid.pixels(self.centers_m), grid.shape
        inside = ((cells > -0.5) & (cells < (columns - 0.5, rows - 0.5))).all(axis=1)
        return replace(self.site.mesh, triangles=self.site.mesh.triangles[inside])

    @property
    def ground(self) -> Ground:
        """What ``measure`` and the page measure on."""
        return Ground(
            self.terrain.height_m.astype(np.float32), self.terrain.grid, self.height_std_m
        )

    @property
    def true_ground(self) -> Ground:
        """The same of the drawn heights."""
        return replace(self.ground, heights_m=self.true.height_m.astype(np.float32))


def mapped(drawn: Path, out: Path) -> MappedReef:
    """The map of a fused run of a drawn dive."""
    site = open_site(out)
    terrain = terrain_of(site.mesh, grid_of(site.mesh, site.posed.map.cell_m["dem_m"]))
    true = true_terrain(drawn, terrain, site.posed)
    std_m = typical_std_m(open_run(out))
    return MappedReef(site, terrain, terrain_errors(site.posed, terrain), true, std_m)


def heights(at: MappedReef, samples: int, rng: np.random.Generator) -> Scores:
    """Of random cells, rims and overhangs included."""
    std_m = height_stds(at.terrain.height_m)
    off = ((at.terrain.height_m - at.true.height_m) / std_m).ravel()
    off = off[np.isfinite(off)]
    return {"height of a cell": list(rng.choice(off, min(50 * samples, off.size), replace=False))}


def on_map(at: MappedReef, samples: int, rng: np.random.Generator) -> Scores:
    """Heights, lengths between random places, and areas of random squares, of the map."""
    ground, drawn, z = at.ground, at.true_ground, defaultdict(list)
    known = np.argwhere(at.terrain.known)
    while len(z["straight length on the map"]) < samples:
        places = [
            ground.grid.center(float(c), float(r))
            for r, c in known[rng.integers(len(known), size=2)]
        ]
        found, right = ([g.pick(x, y, None, 0.0) for x, y in places] for g in (ground, drawn))
        spots, true = ([each for each in some if each] for some in (found, right))
        if len(spots) < 2 or len(true) < 2:
            continue
        add(
            z,
            "height on the map",
            spots[0].point_m[2],
            true[0].point_m[2],
            spots[0].covariance[2, 2] ** 0.5,
        )
        compared(z, "straight length on the map", straight_length(spots), straight_length(true))
        length, true_line = ground.length(spots), drawn.along(true)
        if length and true_line:
            compared(z, "length along the map", length, length_along(true_line))
    while len(z["flat area on the map"]) < samples:
        row, column = known[rng.integers(len(known))]
        size = int(rng.integers(10, 60))
        corners = np.array([(0, 0), (size, 0), (size, size), (0, size)]) + np.array([column, row])
        some = [
            [g.pick(*g.center(*map(float, c)), None, 0.0) for c in corners] for g in (ground, drawn)
        ]
        spots, true = ([each for each in one if each] for one in some)
        if len(spots) < 4 or len(true) < 4:
            continue
        compared(z, "flat area on the map", planar_area(spots), planar_area(true))
        area, true_area = ground.area(spots), drawn.area(true)
        if area and true_area:
            compared(z, "surface area on the map", area[0], true_area[0])
    return z


def add(z: Scores, name: str, value: float, true: float, std: float) -> None:
    """One more z; a number that is refused has none."""
    if np.isfinite((value, true)).all():
        z[name].append(float((value - true) / std))


def compared(z: Scores, name: str, found: Measured, true: Measured) -> None:
    """One more z of what was measured."""
    add(z, name, found.value, true.value, found.std)


def structures(at: MappedReef, samples: int, rng: np.random.Generator) -> Scores:
    """The metrics of the whole site, and of random squares of it, each as a site of its own."""
    z: Scores = defaultdict(list)
    cell_m = at.terrain.grid.cell_m
    cells = resolved_cells(at.errors.correlation_m, cell_m)
    whole = tuple(slice(0, size) for size in at.terrain.grid.shape)
    judge(z, at, cells, (whole[0], whole[1]), "sites")
    while len(z["rugosity_area of squares"]) < samples:
        size = cells * int(np.ceil(EDGES_M[rng.integers(3)] / cell_m / cells))
        row, column = (int(rng.integers(0, n - size)) for n in at.terrain.grid.shape)
        judge(z, at, cells, (slice(row, row + size), slice(column, column + size)), "squares")
    return z


def judge(z: Scores, at: MappedReef, cells: int, window: Window, of: str) -> None:
    """The metrics of a part of a map; of squares, those of the largest edge."""
    terrain, true, errors = cut(at.terrain, window), cut(at.true, window), part(at, window)
    found = structure(terrain, errors)
    for each in found[-1:] if of == "squares" else found:
        windows = squares_of(terrain.averaged(cells))[each.edge_m]
        right = numbers_of(true.averaged(cells).height_m, each.scale_m, windows).mean(axis=0)
        for name, value in zip(vars(each.mean), right, strict=False):
            std = getattr(each.standard_error, name)
            add(z, f"{name} of {of}", getattr(each.mean, name), float(value), std)


def cut(terrain: Terrain, window: tuple[slice, slice]) -> Terrain:
    """A part of a terrain."""
    rows, columns = window
    grid = terrain.grid
    own = Grid(
        grid.west_m + columns.start * grid.cell_m,
        grid.north_m - rows.start * grid.cell_m,
        grid.cell_m,
        (rows.stop - rows.start, columns.stop - columns.start),
    )
    return Terrain(own, terrain.height_m[window], terrain.color[window])


def outlines(at: MappedReef, samples: int, rng: np.random.Generator) -> Scores:
    """Circles on the map: areas, and the cover by labels of several; of a mound that is put there,
    the volume above the ground that was there before, and the height above the plane of the ground
    around.
    """
    z: Scores = defaultdict(list)
    labelled: list[tuple[Colony, Colony]] = []
    for circle in circles(at.terrain, rng, samples):
        ring = circle.rings[0]
        middle_m, radius_m = ring.mean(axis=0), float(np.hypot(*np.ptp(ring, axis=0)) / 8**0.5)
        window = around(at.terrain.grid, middle_m, radius_m)
        terrain, true, errors = cut(at.terrain, window), cut(at.true, window), part(at, window)
        exact = replace(errors, std_m=0 * errors.std_m, noise_m=0 * errors.noise_m)
        mesh = at.mesh_over(terrain.grid)

        def sizes(
            of: Terrain,
            errors: TerrainErrors,
            std_m: float = 0.0,
            circle: Outline = circle,
            mesh: SiteMesh = mesh,
        ) -> Colony | None:
            return measure_outlines([circle], mesh, of, errors, std_m)[0]

        found, right = sizes(terrain, errors, std_m=at.height_std_m), sizes(true, exact)
        x_m, y_m = terrain.grid.centers(*(slice(0, size) for size in terrain.grid.shape))
        off = np.hypot(x_m - middle_m[0], y_m - middle_m[1]) / radius_m
        mound_m = radius_m * float(rng.uniform(0.2, 0.5)) * np.clip(1 - off**2, 0, 1)
        raised = replace(terrain, height_m=terrain.height_m + mound_m)
        colony = sizes(raised, errors, std_m=at.height_std_m)
        if not (found and right and colony):
            continue
        label = "coral" if rng.integers(2) else "sand"
        labelled.append((replace(found, label=label), replace(right, label=label)))
        for name in ("tilted_m2", "surface_m2", "rugosity"):
            value, std = getattr(found.measured, name), getattr(found.standard_error, name)
            add(z, f"{name} of an outline", value, getattr(right.measured, name), std)
        inside = circle.mask(terrain.grid)
        volume_l = 1000 * terrain.grid.cell_m**2 * float(mound_m[inside].sum())
        above = sizes(replace(true, height_m=true.height_m + mound_m), exact)
        std = colony.standard_error
        add(z, "volume_l of a mound", colony.measured.volume_l, volume_l, std.volume_l)
        if above:
            top_m = above.measured.height_m
            add(z, "height_m of a mound", colony.measured.height_m, top_m, std.height_m)
    for some in zip(*[iter(labelled)] * TOGETHER, strict=False):
        found_rows, true_rows = (
            {row.label: row for row in cover(each, 1.0)} for each in zip(*some, strict=True)
        )
        if len(found_rows) == 2:  # the other label's is the same again
            row, true_row = found_rows["coral"], true_rows["coral"]
            add(
                z,
                "cover of the surface",
                row.of_outlined_surface,
                true_row.of_outlined_surface,
                row.of_outlined_surface_std,
            )
    return z


def around(grid: Grid, middle_m: Array, radius_m: float) -> Window:
    """The cells around a circle, its rim with them."""
    (column, row), reach = grid.pixels(middle_m[None])[0], radius_m / grid.cell_m + 2 * RIM_CELLS
    rows, columns = (slice(int(at - reach), int(at + reach) + 2) for at in (row, column))
    return rows, columns


def part(at: MappedReef, window: Window) -> TerrainErrors:
    """The errors of a part of a map."""
    return replace(at.errors, **{name: getattr(at.errors, name)[window] for name in PER_CELL})


def true_terrain(drawn: Path, terrain: Terrain, posed: PosedRun) -> Terrain:
    """The drawn heights of the cells that the map knows."""
    truth = np.load(drawn / "truth/surface.npz")
    height_m = drawn_heights(
        truth["height_m"], truth["origin_m"], float(truth["cell_m"]), terrain.grid, posed.offset_m
    )
    return replace(terrain, height_m=np.where(terrain.known, height_m, np.nan))


def drawn_heights(
    height_m: NDArray[np.floating],
    origin_m: Sequence[float],
    cell_m: float,
    at: Grid,
    offset_m: Array,
) -> Array:
    """The heights of a drawn reef at the cells of a map, in its coordinates."""
    x_m, y_m = at.centers(*(slice(0, size) for size in at.shape))
    column, row = (
        ((values - low) / cell_m).astype(np.float32)
        for values, low in zip((x_m + offset_m[0], y_m + offset_m[1]), origin_m, strict=True)
    )
    found_m = cv2.remap(np.asarray(height_m, np.float32), column, row, cv2.INTER_LINEAR)
    return np.asarray(found_m - offset_m[2], np.float64)


def circles(terrain: Terrain, rng: np.random.Generator, count: int) -> list[Outline]:
    """Circles of 10 to 25 cm that the map knows whole, with their ground."""
    angle, found = np.linspace(0, 2 * np.pi, 24, endpoint=False), []
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
            found.append(Outline(f"{len(found)}", "", (ring + np.array([x[0, 0], y[0, 0]]),)))
    return found


def changes(folder: Path, seed: int) -> Scores:
    """Between the even pairs and the odd ones: patches and cells where nothing changed, in standard
    errors; and each bump of a changed reef, with its tails.
    """
    change = changed(folder, f"even_{seed}", f"odd_{seed}")
    patches = [each for each in change.patches if each.kind in ("growth", "loss")]
    z: Scores = {"change where none is": [each.volume_l / each.volume_std_l for each in patches]}
    z_of_cells = (change.difference.dz_m / change.difference.std_m)[::5, ::5]
    z["change of a cell where none is"] = z_of_cells[np.isfinite(z_of_cells)].tolist()
    z["change of a bump"] = []
    change = changed(folder, f"even_{seed}", f"bumps_{seed}")
    scene, grid = Scene.from_spec(spec_of(seed)), change.before.grid
    offset_m = open_posed_run(folder / f"even_{seed}").offset_m
    before_m, after_m = (
        drawn_heights(reef.height_m, reef.origin_m, CELL_M, grid, offset_m)
        for reef in (scene.reef, changed_reef(scene.reef, bumps(seed)))
    )
    true_m = np.where(np.isfinite(change.difference.dz_m), after_m - before_m, 0)
    x_m, y_m = grid.centers(*(slice(0, size) for size in grid.shape))
    for bump in bumps(seed):
        off_m = np.hypot(x_m + offset_m[0] - bump.x_m, y_m + offset_m[1] - bump.y_m)
        near = off_m < BUMP_SPACING_M / 2
        own = [
            patch
            for patch, mask in zip(change.patches, change.masks, strict=True)
            if patch.kind in ("growth", "loss") and (mask & near).sum() > 0.5 * mask.sum()
        ]
        if own:
            volume_l = sum(patch.volume_l for patch in own)
            std_l = np.linalg.norm([patch.volume_std_l for patch in own])
            true_l = 1000 * grid.cell_m**2 * true_m[near].sum()
            add(z, "change of a bump", volume_l, float(true_l), float(std_l))
    return z


def changed(folder: Path, first: str, second: str) -> SiteChange:
    """Between two runs, whose calibration is exact."""
    a, b = open_site(folder / first), open_site(folder / second)
    return compare_sites(a, b, a.posed.map.cell_m["dem_m"], 0.0)


def bumps(seed: int) -> list[Change]:
    """What a changed reef has more or less than before: nine disks and mounds, a third of them
    dug out.
    """
    rng = np.random.default_rng(seed)
    return [
        Change(
            "sand" if number % 3 == 1 else "grown",
            BUMP_SPACING_M * (number % 3 + 0.5),
            BUMP_SPACING_M * (number // 3 - 0.5),
            float(rng.uniform(0.1, 0.2)),
            float(rng.uniform(0.02, 0.06)) * (-1 if number % 3 == 2 else 1),
        )
        for number in range(9)
    ]


def scores(folder: Path, seed: int, samples: int) -> Iterator[tuple[str, list[float]]]:
    """Each quantity of a reef, with its z."""
    drawn = dive(folder, seed)
    both, at = surfaces(drawn, folder / f"all_{seed}"), mapped(drawn, folder / f"all_{seed}")
    rng = np.random.default_rng(seed)
    for each in (
        lengths(both, samples, seed),
        areas(both, samples, seed),
        heights(at, samples, rng),
        on_map(at, samples, rng),
        structures(at, samples, rng),
        outlines(at, samples, rng),
        changes(folder, seed),
    ):
        yield from each.items()


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
