"""Positions alone, of a buoy: they say where a track lies and heads, and no more."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mapping_scene import write_run
from numpy.typing import NDArray
from test_markers import RIG, bottom, cameras, frame

from calibration.transforms import rigid_transform, rotation_from_vector, transform_points
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.earth import degrees_from_north_east
from stereo_seecolor.errors import MappingError
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.mapping.navigation.fixes import at_fixes, fit_to_fixes
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.records import GeoOrigin, Trajectory

Array = NDArray[np.float64]
TRUE = rigid_transform(rotation_from_vector(np.array([0.0, 0.0, 2.0])), [120.0, -40.0, 0.0])


def lawn_mower(count: int, line_m: float) -> Array:
    """(count, 4, 4) along two lines."""
    along = np.linspace(0, 2 * line_m, count)
    places = np.column_stack(
        [
            np.where(along < line_m, along, 2 * line_m - along),
            (along >= line_m) * 1.0,
            np.full(count, 3.0),
        ]
    )
    return np.stack([rigid_transform(np.eye(3), place) for place in places])


def fixed(T: Array, scatter_m: float, seed: int = 0) -> Trajectory:
    """A fix a frame; every tenth is 30 m off."""
    rng = np.random.default_rng(seed)
    places = transform_points(TRUE, T[:, :3, 3]) + rng.normal(0, scatter_m, (len(T), 3)) * [1, 1, 0]
    places[::10, :2] += 30
    places[:, 2] = 0
    fixes = np.stack([rigid_transform(np.eye(3), place) for place in places])
    return Trajectory(("",) * len(T), np.arange(float(len(T))), fixes, fixes=True)


def place(T: Array, fixes: Trajectory, components: Array | None = None) -> Placement:
    count = len(T)
    index = SimpleNamespace(
        names=[f"f{i}" for i in range(count)],
        timestamps_s=np.arange(float(count)),
        order=np.arange(count),
    )
    own = Placement(
        T, np.zeros(count, np.int64) if components is None else components.astype(np.int64)
    )
    return at_fixes(own, index, fixes, MappingConfig())  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(5))
def test_a_track_lies_and_heads_as_its_fixes_say_outliers_apart(seed: int) -> None:
    T = lawn_mower(80, 20.0)
    placed = place(T, fixed(T, 2.0, seed))
    turned = placed.T_world_camera[0, :3, :3] @ TRUE[:3, :3].T
    # 2.4 RMS, as errors of their own leave
    assert np.degrees(np.arccos((np.trace(turned) - 1) / 2)) < 8
    assert (
        np.linalg.norm(
            (placed.T_world_camera[:, :3, 3] - transform_points(TRUE, T[:, :3, 3])).mean(axis=0)[:2]
        )
        < 0.7
    )
    assert placed.T_world_camera[:, 2, 3].mean() == pytest.approx(0)
    steps = np.linalg.norm(np.diff(placed.T_world_camera[:, :3, 3], axis=0), axis=1)
    assert steps == pytest.approx(np.linalg.norm(np.diff(T[:, :3, 3], axis=0), axis=1))  # not bent
    assert "80 fixes, which scatter around it by" in placed.warnings[0]


def test_a_dive_shorter_than_its_fixes_scatter_is_refused() -> None:
    T = lawn_mower(40, 2.0)
    with pytest.raises(
        MappingError, match="40 fixes along its track do not determine its heading: they scatter by"
    ):
        place(T, fixed(T, 2.0))


def test_a_component_without_fixes_is_left_out_and_named() -> None:
    T = lawn_mower(80, 20.0)
    fixes = fixed(T, 1.0)
    fixes.T_world_camera[60:] = np.nan
    placed = place(T, fixes, np.repeat([0, 1], [60, 20]))
    assert placed.sizes == (60,) and len(placed.unplaced) == 20
    assert (
        placed.unplaced[0].name == "f60" and "0 fixes along its track" in placed.unplaced[0].reason
    )


def test_a_given_standard_error_is_taken() -> None:
    T = lawn_mower(80, 20.0)
    fit = fit_to_fixes(T[:, :3, 3], fixed(T, 1.0).T_world_camera[:, :3, 3], 1.5)
    assert fit is not None and fit.scatter_m == 1.5
    assert fit_to_fixes(T[:, :3, 3], fixed(T, 1.0).T_world_camera[:, :3, 3], 6.0) is None


def test_fixes_of_another_year_are_told_by_their_clock() -> None:
    T = lawn_mower(40, 20.0)
    fixes = fixed(T, 1.0)
    fixes.timestamps_s[:] += 4e7
    with pytest.raises(
        MappingError,
        match=r"no frame has a fix at its time: it begins 462\.963 days after the first frame",
    ):
        place(T, fixes)


def fused_with_fixes(tmp_path: Path, *settings: str) -> tuple[dict[str, Any], Array, str]:
    """map.json, the track's places and what is said, of a relative track of five frames and a
    buoy's fixes beside it.
    """
    out, T, place_on_earth = tmp_path / "out", cameras(), GeoOrigin(-14.685, 145.46)
    texture = bottom()
    write_run(out, [frame(i, each, texture) for i, each in enumerate(T)], RIG)
    write_tum(tmp_path / "vio.tum", Trajectory(tuple(f"f{i}" for i in range(5)), np.arange(5.0), T))
    places = transform_points(TRUE, T[:, :3, 3])
    degrees = [
        degrees_from_north_east(north_m, east_m, place_on_earth) for east_m, north_m, _ in places
    ]
    rows = "".join(f"{time},{lat:.9f},{lon:.9f}\n" for time, (lat, lon) in enumerate(degrees))
    (tmp_path / "buoy.csv").write_text("time,lat,lon\n" + rows)
    config = load_config(
        None, ["mapping.poses=given", f"mapping.fixes={tmp_path / 'buoy.csv'}", *settings]
    )
    summary = fuse(out, tmp_path / "vio.tum", config)
    content = json.loads((out / "map/map.json").read_text())
    track = np.loadtxt(out / "map/trajectory.tum")[:, 1:4]
    return content, track, " ".join(summary.warnings)


@pytest.mark.slow
def test_fixes_beside_a_relative_track_place_it_on_earth(tmp_path: Path) -> None:
    content, track, said = fused_with_fixes(tmp_path)
    assert "the track is aligned to 5 fixes" in said and not content["origin"]["depth_known"]
    T = cameras()
    expected = transform_points(TRUE, T[:, :3, 3])
    np.testing.assert_allclose(
        track[:, :2] - track[:1, :2], expected[:, :2] - expected[:1, :2], atol=2e-3
    )
    found = degrees_from_north_east(track[0, 1], track[0, 0], GeoOrigin(**content["origin"]))
    truth = degrees_from_north_east(expected[0, 1], expected[0, 0], GeoOrigin(-14.685, 145.46))
    np.testing.assert_allclose(found, truth, atol=3e-8)
