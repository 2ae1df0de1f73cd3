"""How true the structure of drawn reefs is, and how often its intervals of 95 % hold the truth.

    python benchmarks/rugosity.py FOLDER [reefs] [--cells-mm 10 20 50] [--seed 400]
        [--own-track]

Ten reefs from flat to branching, three heights of the cameras, cells of 5, 10, 20 and 50 mm. Poses
are true, or with --own-track found from the pictures, of noise of 1 of 255; ranges are drawn with
the errors that matching has on the sample dive: 0.12 pixels of disparity, alike over 2 pixels, and
smoothed over 3. Reefs 4 and 8 of seed 100 were at hand when the settings of
``mapping/raster/noise.py`` were chosen, and all ten of them when the laws of height ranges and
ruggedness were; those of another seed judge. FOLDER keeps the maps.
"""

import shutil
from collections.abc import Iterator, Sequence
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
from arguments import parser_of
from numpy.typing import NDArray

from calibration import RectifiedPair
from calibration.transforms import rigid_alignment
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.extras.reef.site_surface import SiteMesh, read_mesh
from stereo_seecolor.extras.reef.terrain_of_mesh import grid_of, terrain_errors, terrain_of
from stereo_seecolor.extras.synthetic import survey
from stereo_seecolor.extras.synthetic.casting import cast, look_up
from stereo_seecolor.extras.synthetic.reef import CELL_M, Reef, blocks, build_reef
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.mapping.raster.structure import (
    Numbers,
    StructureAtScale,
    numbers_of,
    resolved_cells,
    squares_of,
    structure,
)
from stereo_seecolor.mapping.raster.terrain import Terrain
from stereo_seecolor.mapping.survey_map import build_map
from stereo_seecolor.records import SurveyFrame

STEEPNESS = (0.02, 0.1, 0.25, 0.4, 0.55, 0.7, 0.85, 1.0, 1.0, 1.0)
"""Factor on all heights of a reef: from flat to the branching corals of the synthetic dive."""
ALTITUDES_M = (1.0, 1.4, 1.8)
CELLS_M = (0.005, 0.01, 0.02, 0.05)
SIZE = (320, 256)
NOISE_PX, ALIKE_PX, SMOOTH_PX = 0.12, 2.0, 3.0


class DrawnFrames(Sequence[SurveyFrame]):
    """Frames over a reef with ranges as matching measures them."""

    def __init__(self, number: int, seed: int) -> None:
        altitude_m = ALTITUDES_M[number % 3]
        self.spec = SurveySpec(
            seed=seed + number, pairs=8, lines=2, image_size=SIZE, altitude_m=(altitude_m,
            altitude_m),
            line_spacing_m=0.4 * altitude_m, pair_spacing_m=0.25 * altitude_m, tilt_deg=5.0,
        )  # fmt: skip
        reef = build_reef(self.spec)
        height_m = (reef.height_m * np.float32(STEEPNESS[number])).astype(np.float32)
        self.reef: Reef = replace(reef, height_m=height_m, blocks=blocks(height_m))
        width, height = SIZE
        self.pair = RectifiedPair(0.83 * width, width / 2, width / 2, height / 2, 0.12, SIZE)
        self.trajectory = survey.track(self.spec)

    def __len__(self) -> int:
        return self.spec.pairs

    def __getitem__(self, index: int) -> SurveyFrame:  # type: ignore[override]
        if not 0 <= index < len(self):
            raise IndexError(index)
        pair, rng = self.pair, np.random.default_rng([self.spec.seed, index])
        range_m = cast(
            self.reef,
            self.trajectory.T_world_camera[index],
            pair.rays.astype(np.float32)[:, :, None],
        )[..., 0]
        disparity_px = pair.focal_px * pair.baseline_m * pair.ray_length / range_m
        noise = cv2.GaussianBlur(rng.standard_normal(range_m.shape), (0, 0), ALIKE_PX)
        measured_px = (
            cv2.GaussianBlur(disparity_px, (0, 0), SMOOTH_PX) + NOISE_PX * noise / noise.std()
        )
        measured_m = (pair.focal_px * pair.baseline_m * pair.ray_length / measured_px).astype(
            np.float32
        )
        color = look_up(
            self.reef,
            self.trajectory.T_world_camera[index],
            pair.rays.astype(np.float32)[:, :, None],
            range_m[..., None],
            1 / pair.focal_px,
        )[:, :, 0]
        shown = 255 * encode_srgb(color / color.max()) + rng.standard_normal(color.shape)
        return SurveyFrame(
            name=self.trajectory.names[index],
            timestamp_s=float(self.trajectory.timestamps_s[index]),
            color=np.clip(np.rint(shown), 0, 255).astype(np.uint8),
            range_m=measured_m,
            range_std_m=(measured_m * NOISE_PX / measured_px).astype(np.float32),
            confidence=np.full(range_m.shape, 255, np.uint8),
        )


def mapped(
    folder: Path, frames: DrawnFrames, cell_m: float, own_track: bool
) -> tuple[SiteMesh, Terrain, Any, NDArray[np.float64]]:
    """The mesh, the terrain and its errors, of a map in voxels and cells of that size; and
    T_world_map (4, 4).
    """
    out = folder / f"{frames.spec.seed}_{1000 * cell_m:g}mm{'_own' * own_track}"
    config = MappingConfig(
        voxel_m=cell_m,
        dem_m=cell_m,
        mosaic_m=0.05,
        metrics_m=0.5,
        poses="prior" if own_track else "given",
    )
    if not (out / "map" / "mesh.ply").is_file():
        shutil.rmtree(out, ignore_errors=True)
        given = None if own_track else frames.trajectory
        build_map(frames, frames.pair, out / "map", config, given)
    mesh = read_mesh(out)
    terrain = terrain_of(mesh, grid_of(mesh, cell_m))
    true = np.array(frames.trajectory.T_world_camera)
    T_map_camera = (
        read_trajectory(out / "map" / "trajectory.tum").T_world_camera if own_track else true
    )
    assert len(T_map_camera) == len(true)
    posed = SimpleNamespace(
        survey=frames, geometry=frames.pair, voxel_m=cell_m, T_map_camera=list(T_map_camera)
    )
    seen = np.array([[0, 0, 0, 1], [1, 0, 1, 1], [0, 1, 1, 1], [0, 0, 2, 1]])
    in_map, in_world = (
        (poses @ seen.T).transpose(0, 2, 1)[..., :3].reshape(-1, 3)
        for poses in (T_map_camera, true)
    )
    errors = terrain_errors(posed, terrain)  # type: ignore[arg-type]
    return mesh, terrain, errors, rigid_alignment(in_map, in_world)


def truth(terrain: Terrain, reef: Reef, T_world_map: NDArray[np.float64]) -> Terrain:
    """The true heights of the cells that the map knows."""
    x_m, y_m, z_m = np.moveaxis(
        terrain.points_m @ T_world_map[:3, :3].T + T_world_map[:3, 3], -1, 0
    )
    column, row = (
        (each - low) / CELL_M for each, low in zip((x_m, y_m), reef.origin_m, strict=True)
    )
    height_m = cv2.remap(
        reef.height_m, column.astype(np.float32), row.astype(np.float32), cv2.INTER_LINEAR
    )
    true_m = terrain.height_m + (height_m - z_m) * T_world_map[2, 2]
    return replace(terrain, height_m=np.where(terrain.known, true_m, np.nan).astype(np.float64))


def compared(
    folder: Path, number: int, seed: int, cells_m: Sequence[float], own_track: bool
) -> Iterator[tuple[float, StructureAtScale, NDArray[np.float64]]]:
    """Cell, measured structure, true numbers of each edge of squares."""
    frames = DrawnFrames(number, seed)
    for cell_m in cells_m:
        _, terrain, errors, T_world_map = mapped(folder, frames, cell_m, own_track)
        cells = resolved_cells(errors.correlation_m, terrain.grid.cell_m)
        true_m = truth(terrain, frames.reef, T_world_map).averaged(cells).height_m
        for found in structure(terrain, errors):
            yield (
                cell_m,
                found,
                numbers_of(
                    true_m, found.scale_m, squares_of(terrain.averaged(cells))[found.edge_m]
                ).mean(axis=0),
            )


def main(
    folder: Path, reefs: Sequence[int], seed: int, cells_m: Sequence[float], own_track: bool
) -> None:
    """Print each reef's rugosity, then bias and coverage of each number."""
    names = [field.name for field in fields(Numbers)][
        :-1
    ]  # of the mesh: heights have no overhangs to compare
    off: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
    for number in reefs:
        for cell_m, found, true in compared(folder, number, seed, cells_m, own_track):
            for k, name in enumerate(names):
                value, std = getattr(found.mean, name), getattr(found.standard_error, name)
                off[name].append((cell_m, (value - true[k]) / std))
            rugosity, std = found.mean.rugosity_area, found.standard_error.rugosity_area
            where = (
                f"reef {number}, cells {1000 * cell_m:.0f} mm, at {1000 * found.scale_m:.0f} "
                f"mm, squares of {found.edge_m} m"
            )
            print(
                f"{where}: mapped {found.mapped.rugosity_area:.3f}, {rugosity:.3f} ± {std:.3f}, "
                f"true {true[0]:.3f}",
                flush=True,
            )
    print("mean error in standard errors, and fraction within 1.96 of them, by cells")
    for name in names:
        rows = [(cell_m, z) for cell_m, z in off[name] if np.isfinite(z)]
        by_cell = [np.array([z for cell, z in rows if cell == cell_m]) for cell_m in cells_m]
        print(
            f"  {name:18}",
            *(
                f"{z.mean():+.2f} {np.mean(np.abs(z) < 1.96):4.0%} (n {z.size})"
                for z in by_cell
                if z.size
            ),
        )


if __name__ == "__main__":
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("reefs", type=int, nargs="*", default=list(range(len(STEEPNESS))))
    parser.add_argument("--cells-mm", type=float, nargs="+", default=[1000 * m for m in CELLS_M])
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--own-track", action="store_true")
    given = parser.parse_args()
    main(
        given.folder, given.reefs, given.seed, [mm / 1000 for mm in given.cells_mm], given.own_track
    )
