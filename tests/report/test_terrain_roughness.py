"""The roughness of a terrain that stays on disk: as of one in memory, and with bounded memory."""

import tracemalloc
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mapping_scene import PAIR, flat_frame, track
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.terrain_of_mesh import terrain_errors
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.structure import structure
from stereo_seecolor.mapping.raster.terrain import Terrain
from stereo_seecolor.records import SurveyFrame
from stereo_seecolor.report import terrain_roughness as module
from stereo_seecolor.report.terrain_roughness import TerrainRoughness, terrain_roughness

CELL_M, SQUARE_M = 0.02, 0.5


@dataclass(frozen=True)
class DrawnTerrain:
    """Waves of 2 cm under a track along the first cells' row, with a hole; computed, not kept."""

    height: int
    width: int

    @property
    def grid(self) -> Grid:
        """As of dem.tif."""
        return Grid(-0.5, 0.5, CELL_M, (self.height, self.width))

    def heights_m(self, box: tuple[int, int, int, int]) -> NDArray[np.float32]:
        """(h, w) of a box (left, top, width, height)."""
        left, top, width, height = box
        row, column = np.indices((height, width))
        row, column = row + top, column + left
        heights = 0.02 * (np.sin(column / 4.0) + np.cos(row / 5.0 + column / 9.0))
        heights[np.hypot(row - 20, column - 70) < 6] = np.nan
        return heights.astype(np.float32)


class FlatFrames(Sequence[SurveyFrame]):
    """Frames 0.3 m apart, made when asked for."""

    def __init__(self, count: int) -> None:
        self.count = count

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, number: Any) -> Any:
        return flat_frame(number)


def found(drawn: DrawnTerrain, edges_m: Sequence[float] = (0.25, 0.5, 1.0)) -> TerrainRoughness:
    posed, frames = seen(drawn)
    return terrain_roughness(posed, frames, drawn, SQUARE_M, edges_m)  # type: ignore[arg-type]


def seen(drawn: DrawnTerrain) -> tuple[Any, Any]:
    """The poses of frames all along a terrain, and the frames."""
    count = int(drawn.width * CELL_M / 0.3)
    frames = FlatFrames(count)
    posed = SimpleNamespace(
        T_map_camera=track(count).T_world_camera,
        geometry=PAIR,
        voxel_m=CELL_M,
        offset_m=np.zeros(3),
        survey=frames,
    )
    return posed, frames


def in_memory(drawn: DrawnTerrain) -> Terrain:
    height_m = drawn.heights_m((0, 0, drawn.width, drawn.height)).astype(np.float64)
    grid = Grid(-0.5, 0.5, CELL_M, (drawn.height, drawn.width))
    return Terrain(grid, height_m, np.full((*height_m.shape, 3), np.nan, np.float32))


@pytest.mark.slow
def test_parts_of_a_terrain_have_the_roughness_of_the_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """To a fraction of the standard errors, since the errors that are drawn differ."""
    drawn = DrawnTerrain(130, 260)
    terrain, (posed, _) = in_memory(drawn), seen(drawn)
    (whole,) = structure(terrain, terrain_errors(posed, terrain), [1.0])
    once = found(drawn)
    monkeypatch.setattr(module, "PART_CELLS", 60)
    parts = found(drawn)
    assert once.structure and parts.structure
    for name in ("rugosity_area", "rugosity_hvar", "height_range_m", "vector_ruggedness"):
        right, std = getattr(whole.mean, name), getattr(whole.standard_error, name)
        assert getattr(once.structure.mean, name) == pytest.approx(right, rel=1e-6)
        assert getattr(once.structure.standard_error, name) == pytest.approx(std, rel=1e-5)
        assert getattr(parts.structure.mean, name) == pytest.approx(right, abs=0.1 * std)
        assert getattr(parts.structure.mapped, name) == pytest.approx(getattr(whole.mapped, name))
    assert parts.structure.squares == whole.squares == 10
    assert parts.squares.keys() == once.squares.keys()
    for place, (values, stds) in once.squares.items():
        np.testing.assert_array_less(np.abs(parts.squares[place][0] - values), stds + 1e-9)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_terrain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PART_CELLS", 60)

    def peak_bytes(drawn: DrawnTerrain) -> int:
        tracemalloc.start()
        found(drawn, [0.5])
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak

    peak_bytes(DrawnTerrain(60, 60))  # what is loaded once
    small, large = (peak_bytes(DrawnTerrain(130, width)) for width in (200, 500))
    assert large < 1.2 * small
