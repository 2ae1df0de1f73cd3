"""Two dives of one reef of which parts changed in between: registered, and what changed is found
and nothing else.
"""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from conftest import Cli
from json_shapes import SHAPES, mismatch
from mapping_scene import PAIR, ReefFrames, flat_frames, write_map, write_run
from numpy.typing import NDArray

from benchmarks.reef_changes import Change, changed_reef
from calibration.transforms import (
    inverse,
    rigid_transform,
    rotation_from_vector,
    scale_of,
    transform_points,
)
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import ComparingError, InputError, OutputError
from stereo_seecolor.extras.reef.compare import Comparison, compare
from stereo_seecolor.extras.reef.comparing import m3c2
from stereo_seecolor.extras.reef.comparing.changed_patches import (
    height_patches,
    is_sure,
    volume_l,
    with_tails,
)
from stereo_seecolor.extras.reef.comparing.color_change import color_change
from stereo_seecolor.extras.reef.comparing.difference import (
    Difference,
    difference,
    in_spreads,
    relearned,
    spread_by,
)
from stereo_seecolor.extras.reef.comparing.joint_track import joint_track
from stereo_seecolor.extras.reef.comparing.m3c2 import SurfaceDistances, distances
from stereo_seecolor.extras.reef.comparing.positions import position_note
from stereo_seecolor.extras.reef.comparing.ransac import similarity_fit
from stereo_seecolor.extras.reef.comparing.registration import Registration
from stereo_seecolor.extras.reef.comparing.site_change import SiteChange
from stereo_seecolor.extras.reef.comparing.surface_fit import surface_fit
from stereo_seecolor.extras.reef.site_surface import SiteMesh, open_site
from stereo_seecolor.extras.synthetic.reef import Reef
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.terrain import Terrain, TerrainErrors
from stereo_seecolor.records import GeoOrigin, SurveyFrame
from stereo_seecolor.run_folder.posed_run import PosedRun

Array = NDArray[np.float64]

FIRST = SurveySpec(
    seed=11,
    pairs=10,
    lines=2,
    image_size=(320, 256),
    line_spacing_m=0.6,
    pair_spacing_m=0.35,
    altitude_m=(1.3, 1.3),
    relief_m=0.2,
)
SECOND = replace(
    FIRST,
    seed=12,
    pairs=12,
    lines=3,
    line_spacing_m=0.35,
    pair_spacing_m=0.45,
    altitude_m=(1.5, 1.5),
)
"""Another track, another altitude; its noise is its own."""
GROWN, LARGER, BLEACHED = (
    Change("grown", 0.35, 0.25, 0.16, 0.02),
    Change("grown", 1.1, 0.6, 0.12, 0.03),
    Change("bleached", 0.5, 0.75, 0.13),
)
SAND, REMOVED = Change("sand", 1.4, 0.0, 0.16, 0.04), Change("removed", 0.9, 0.05, 0.13, 0.0)
CHANGES = (GROWN, LARGER, BLEACHED, SAND, REMOVED)
T_SECOND = rigid_transform(rotation_from_vector(np.array([0.01, -0.015, 0.35])), [3.0, -1.0, 0.4])
"""The second dive's navigation has another origin, heading and level."""


GIVEN = RunConfig.model_validate({"mapping": {"poses": "given", "voxel_m": 0.01}})


@pytest.fixture(scope="module")
def first_dive() -> ReefFrames:
    return ReefFrames(FIRST, noise_px=0.1)


@pytest.fixture(scope="module")
def second_dive(first_dive: ReefFrames) -> ReefFrames:
    frames = ReefFrames(SECOND, noise_px=0.1)
    frames.__dict__["reef"] = changed_reef(first_dive.reef, CHANGES)
    return frames


@pytest.fixture(scope="module")
def second_frames(second_dive: ReefFrames) -> list[SurveyFrame]:
    """With a cast that no white balance took out."""
    taken = (second_dive[i] for i in range(len(second_dive)))
    return [replace(frame, color=cast(frame.color)) for frame in taken]


@pytest.fixture(scope="module")
def dives(
    tmp_path_factory: pytest.TempPathFactory,
    first_dive: ReefFrames,
    second_dive: ReefFrames,
    second_frames: list[SurveyFrame],
) -> tuple[Path, Path, Reef, Reef]:
    folder = tmp_path_factory.mktemp("dives")
    first_frames = [first_dive[i] for i in range(len(first_dive))]
    for name, frames, taken, T in (
        ("first", first_dive, first_frames, np.eye(4)),
        ("second", second_dive, second_frames, T_SECOND),
    ):
        write_run(folder / name, taken, frames.pair)
        write_tum(
            folder / f"{name}.tum",
            replace(frames.trajectory, T_world_camera=T @ frames.trajectory.T_world_camera),
        )
        fuse(folder / name, folder / f"{name}.tum", GIVEN)
    return folder / "first", folder / "second", first_dive.reef, second_dive.reef


def cast(color: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.clip(color * np.array([0.8, 1.0, 1.1]) + np.array([4, 6, 9]), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def found(
    dives: tuple[Path, Path, Reef, Reef], tmp_path_factory: pytest.TempPathFactory
) -> Comparison:
    return compare(dives[0], dives[1], tmp_path_factory.mktemp("found") / "change", joint=True)


def true_change_m(dives: tuple[Path, Path, Reef, Reef], grid: Grid) -> Array:
    x, y = grid.centers(slice(0, grid.shape[0]), slice(0, grid.shape[1]))
    heights = []
    for reef in dives[2:]:
        column, row = (
            ((values - start) / 0.005).astype(np.float32)
            for values, start in ((x, reef.origin_m[0]), (y, reef.origin_m[1]))
        )
        heights.append(cv2.remap(reef.height_m, column, row, cv2.INTER_LINEAR).astype(np.float64))
    return np.asarray(heights[1] - heights[0])


def around(mask: NDArray[np.bool_], cells: int) -> NDArray[np.bool_]:
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * cells + 1,) * 2, np.uint8)) > 0


@pytest.mark.slow
def test_the_second_dive_is_placed_within_millimeters(found: Comparison) -> None:
    at, points = found.change.registration, found.change.before.points_m[found.change.before.known]
    off = transform_points(at.T_a_b @ T_SECOND, points) - points
    assert np.sqrt((off**2).sum(axis=1).mean()) < 3e-3
    assert at.agreeing > 500 and at.stable > 0.85
    np.testing.assert_array_less(
        np.abs(off[:, 2]), 5 * at.std_m(points, np.zeros((2, len(points)))) + 2e-4
    )


@pytest.mark.slow
def test_unchanged_ground_lies_within_the_level_of_detection(
    dives: tuple[Path, Path, Reef, Reef], found: Comparison
) -> None:
    change = found.change
    still = np.isfinite(change.difference.dz_m) & ~around(
        np.abs(true_change_m(dives, change.before.grid)) > 5e-4, 2
    )
    assert 0.93 < (np.abs(change.difference.dz_m) <= change.difference.lod_m)[still].mean() < 0.97
    on_surface = still & np.isfinite(change.surface.distance_m)
    assert (
        0.9 < (np.abs(change.surface.distance_m) <= change.surface.lod_m)[on_surface].mean() < 0.99
    )


def nothing_else(change: SiteChange, true_m: Array) -> None:
    """What grew or was lost is in patches, and nearly all of their cells changed."""
    known, patches = np.isfinite(change.difference.dz_m), np.zeros(true_m.shape, bool)
    for patch, mask in zip(change.patches, change.masks, strict=True):
        patches |= mask & (patch.kind in ("growth", "loss"))
    large = known & (np.abs(true_m) > 0.0195)
    assert patches[large].mean() > 0.9
    assert (patches & ~around(np.abs(true_m) > 5e-4, 3)).sum() < 0.05 * patches.sum()


@pytest.mark.slow
def test_growth_and_loss_are_found_and_nothing_else(
    dives: tuple[Path, Path, Reef, Reef], found: Comparison
) -> None:
    change, true_m = found.change, true_change_m(dives, found.change.before.grid)
    known = np.isfinite(change.difference.dz_m)
    nothing_else(change, true_m)
    for (total, std), true in (
        (change.growth_l, np.maximum(true_m, 0)),
        (change.loss_l, np.minimum(true_m, 0)),
    ):
        expected = 1000 * change.before.grid.cell_m**2 * true[known].sum()
        assert total == pytest.approx(expected, rel=0.1)
        # at least that of a calibration of which nothing is known, to the third power
        assert 3 * 0.005 * abs(total) < std < 0.1 * abs(expected)
    for patch in change.patches:
        assert not abs(patch.volume_l) < 5 * patch.volume_std_l
        assert not patch.volume_std_l < 3 * 0.005 * abs(patch.volume_l)


@pytest.mark.slow
def test_a_bent_track_is_straightened_by_what_frames_of_both_dives_share(
    dives: tuple[Path, Path, Reef, Reef], found: Comparison
) -> None:
    first, second = (open_site(out) for out in dives[:2])
    true = ReefFrames(SECOND).trajectory.T_world_camera
    T = second.posed.T_map_camera.copy()
    T[:, 2, 3] += 0.02 * np.sin(np.arange(len(T)))
    bent = replace(second, posed=replace(second.posed, T_map_camera=T))
    joint = joint_track(first, bent, found.change.registration, Threads(1))
    off = joint.trajectory.T_world_camera[:, :3, 3] - true[:, :3, 3]
    before = (found.change.registration.T_a_b @ T)[:, :3, 3] - true[:, :3, 3]
    assert np.sqrt((before**2).sum(axis=1).mean()) > 0.013
    assert np.sqrt((off**2).sum(axis=1).mean()) < 0.005
    assert joint.pairs > 10 and joint.bent_m == pytest.approx(0.014, abs=0.004)
    far = replace(
        found.change.registration,
        T_a_b=rigid_transform(np.eye(3), [50, 0, 0]) @ found.change.registration.T_a_b,
    )
    with pytest.raises(
        ComparingError, match="cannot be bent onto the first: 0 pairs of frames of both dives match"
    ):
        joint_track(first, second, far, Threads(1))


@pytest.mark.slow
def test_bleaching_is_found_by_color(found: Comparison) -> None:
    near = [
        p
        for p in found.change.patches
        if np.hypot(p.x_m - BLEACHED.x_m, p.y_m - BLEACHED.y_m) < 0.05
    ]
    assert [patch.kind for patch in near] == ["paler"]
    assert near[0].lightness > 5 and near[0].chroma < 0
    # averaged over a window
    assert near[0].area_cm2 == pytest.approx(1e4 * np.pi * BLEACHED.radius_m**2, rel=0.6)
    kinds = {
        patch.kind
        for patch in found.change.patches
        if np.hypot(patch.x_m - GROWN.x_m, patch.y_m - GROWN.y_m) < 0.05
    }
    assert kinds == {"growth"}  # what grew kept its color


@pytest.mark.slow
def test_what_is_written(
    dives: tuple[Path, Path, Reef, Reef],
    found: Comparison,
    tmp_path: Path,
    cli: Callable[..., tuple[int, str, str]],
) -> None:
    import rasterio

    folder = found.files[0].parent
    assert [path.name for path in found.files] == [
        "change.json",
        "change.png",
        "color_change.tif",
        "height_change.tif",
        "index.html",
        "patches.csv",
        "second_track.tum",
    ]
    assert found.joint is not None and found.joint.bent_m < 0.005
    bent = read_trajectory(folder / "second_track.tum")
    np.testing.assert_allclose(
        bent.T_world_camera, found.joint.trajectory.T_world_camera, atol=1e-6
    )
    with pytest.raises(InputError, match="--joint writes the track of the second dive: give --out"):
        compare(dives[0], dives[1], joint=True)
    page = (folder / "index.html").read_text()
    liters = found.change.growth_l[0]
    assert (
        "<h1>first to second</h1>" in page
        and f"growth of {liters:.2f} ±" in page
        and "paler" in page
    )
    assert page.count("<tr><td") == len(found.change.patches)
    assert all(f'href="{name}"' in page for name in ("patches.csv", "height_change.tif"))
    with (folder / "patches.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["kind"] for row in rows] == [patch.kind for patch in found.change.patches]
    with rasterio.open(folder / "height_change.tif") as raster:
        heights, labels = (
            raster.read(raster.descriptions.index("change_m") + 1),
            raster.read(raster.descriptions.index("patch") + 1),
        )
        row, column = raster.index(GROWN.x_m, GROWN.y_m)
    assert heights[row, column] == pytest.approx(0.02, abs=0.01)
    assert rows[int(labels[row, column]) - 1]["kind"] == "growth"
    image = cv2.imread(str(folder / "change.png"))
    assert image.shape[1] > 1000 and image.std() > 20
    with pytest.MonkeyPatch.context() as patch:
        name = "stereo_seecolor.extras.reef.compare.compare"
        patch.setattr(name, lambda *_: replace(found, joint=None))
        code, said, _ = cli("compare", dives[0], dives[1], "--json")
        same = replace(found, change=replace(found.change, patches=()))
        patch.setattr(name, lambda *_: same)
        assert "no patch of change" in cli("compare", dives[0], dives[1])[1]
    content = json.loads(said)
    assert (code, mismatch(content, SHAPES["compare"])) == (0, None)
    assert content["growth_l"] == pytest.approx(
        json.loads((folder / "change.json").read_text())["growth_l"]
    )
    with pytest.raises(OutputError, match=str(folder)):
        compare(dives[0], dives[1], folder)
    write_run(tmp_path / "bare", flat_frames(3), PAIR)
    with pytest.raises(InputError, match="holds no map"):
        compare(dives[0], tmp_path / "bare")
    write_map(tmp_path / "flat", flat_frames(3))
    with pytest.raises(
        ComparingError,
        match=r"of \d+ features that look alike \d agree on one place \(needed: 12\)",
    ):
        compare(dives[0], tmp_path / "flat")


@pytest.mark.slow
def test_a_motion_is_found_among_wrong_matches() -> None:
    rng = np.random.default_rng(0)
    b = rng.uniform(-2, 2, (200, 3))
    T = rigid_transform(rotation_from_vector(np.array([0.1, 0.2, 1.5])), [1, 2, 3])
    a = transform_points(T, b) + rng.normal(0, 0.002, b.shape)
    a[60:] = rng.uniform(-2, 2, (140, 3))
    fit = similarity_fit(a, b, 0.02)
    assert fit is not None and fit.inliers[:60].all() and fit.inliers.sum() < 63
    np.testing.assert_allclose(fit.T, T, atol=3e-3)
    assert similarity_fit(a[:2], b[:2], 0.02) is None
    lost = similarity_fit(a[60:], b[60:], 0.02)
    assert lost is None or lost.inliers.sum() < 8


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, 1.01, 0.99])
def test_the_scale_of_two_surveys_is_known_within_its_error(scale: float) -> None:
    """Over all draws its error is as stated; a tenth of the ground rose."""
    errors = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        b = rng.uniform(-1, 1, (150, 3)) * [2.0, 1.0, 0.2]
        T = rigid_transform(rotation_from_vector(np.array([0.1, 0.2, 1.5])), [1, 2, 3])
        a = transform_points(T, scale * b + rng.normal(0, 0.003, b.shape))
        grown = np.linalg.norm(b[:, :2] - [0.5, 0.3], axis=1) < 0.35
        a[grown] += 0.02 * T[:3, 2]
        fit = similarity_fit(a, b + rng.normal(0, 0.003, b.shape), 0.03)
        assert fit is not None and fit.scale_std < 0.002
        errors.append((scale_of(fit.T) - scale) / fit.scale_std)
    assert np.sqrt(np.mean(np.square(errors))) < 1.5
    assert abs(np.mean(errors)) < 0.7


@pytest.mark.slow
@pytest.mark.parametrize(
    ("longitude_deg", "deep_m", "apart"),
    [(152.0, 0.0, ""), (152.0, 1500.0, "1.5 km"), (-152.0, 0.0, "5,4"), (None, 0.0, "")],
)
def test_navigation_that_puts_the_same_ground_elsewhere_is_wrong(
    found: Comparison,
    dives: tuple[Path, Path, Reef, Reef],
    longitude_deg: float | None,
    deep_m: float,
    apart: str,
) -> None:
    first, second = (open_site(out).posed for out in dives[:2])
    T = found.change.registration.T_a_b

    def placed(posed: PosedRun, longitude_deg: float | None, up_m: float) -> PosedRun:
        origin = None if longitude_deg is None else GeoOrigin(-23.5, longitude_deg)
        offset_m = [*posed.map.offset_m[:2], posed.map.offset_m[2] + up_m]
        return replace(posed, map=replace(posed.map, origin=origin, offset_m=offset_m))

    note = position_note(placed(first, 152.0, 0.0), placed(second, longitude_deg, -deep_m), T)
    assert (f"the same ground {apart}" in note) if apart else not note


@pytest.mark.parametrize(
    ("scale", "std", "is_wrong"), [(1.03, 1e-3, True), (0.97, 0.02, False), (1.0002, 1e-5, False)]
)
def test_lengths_that_certainly_differ_by_more_than_2_percent_are_wrong(
    scale: float,
    std: float,
    is_wrong: bool,
    found: Comparison,
    dives: tuple[Path, Path, Reef, Reef],
    cli: Cli,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    T = np.diag([scale, scale, scale, 1])
    at = replace(found.change.registration, T_a_b=T, scale_std=std)
    result = replace(found, change=replace(found.change, registration=at))
    monkeypatch.setattr("stereo_seecolor.extras.reef.compare.compare", lambda *_: result)
    code, printed, _ = cli("compare", *dives[:2])
    assert ("of the second survey are" in printed, code) == ((True, 3) if is_wrong else (False, 0))


@pytest.mark.slow
def test_a_baseline_that_is_off_is_a_scale_and_no_change(
    dives: tuple[Path, Path, Reef, Reef], second_frames: list[SurveyFrame], tmp_path: Path
) -> None:
    """The second survey with other meters: what changed is found, and nothing else."""
    shorter = 0.99
    scaled = [
        replace(frame, range_m=shorter * frame.range_m, range_std_m=shorter * frame.range_std_m)
        for frame in second_frames
    ]
    trajectory = read_trajectory(dives[1].with_suffix(".tum"))
    track = trajectory.T_world_camera.copy()
    track[:, :3, 3] *= shorter
    write_run(tmp_path / "second", scaled, ReefFrames(SECOND).pair)
    write_tum(tmp_path / "second.tum", replace(trajectory, T_world_camera=track))
    fuse(tmp_path / "second", tmp_path / "second.tum", GIVEN)
    found = compare(dives[0], tmp_path / "second").change
    at = found.registration
    assert 1 / shorter == pytest.approx(at.scale, abs=max(4 * at.scale_std, 2e-4))
    assert "of the second survey are" in at.scale_note and not at.is_wrong
    true = true_change_m(dives, found.before.grid)
    known = np.isfinite(found.difference.dz_m)
    grown = 1000 * found.before.grid.cell_m**2 * true[known & (true > 0)].sum()
    assert found.growth_l[0] == pytest.approx(grown, abs=max(4 * found.growth_l[1], 0.05 * grown))
    nothing_else(found, true)


def waves(x: Array, y: Array) -> Array:
    return 0.1 * np.sin(4 * x) * np.cos(5 * y) + 0.05 * np.sin(9 * x + 1)


def surface(height: Callable[[Array, Array], Array], shift: float = 0.0) -> SiteMesh:
    """A surface over a square of 2 m, a vertex every 2 cm."""
    x, y = np.meshgrid(*(np.arange(-1, 1, 0.02) + shift,) * 2)
    z = height(x, y)
    east, north = (height(x + dx, y + dy) - z for dx, dy in ((1e-4, 0), (0, 1e-4)))
    normals = np.stack([-east / 1e-4, -north / 1e-4, np.ones_like(z)], axis=-1).reshape(-1, 3)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    unit = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return SiteMesh(points, unit, np.zeros((len(points), 3), np.uint8), np.zeros((0, 3), np.int32))


def test_surfaces_meet_where_they_did_not_change_and_say_how_surely() -> None:
    rng = np.random.default_rng(2)
    a, b = (
        surface(waves),
        surface(lambda x, y: waves(x, y) + 0.05 * (np.hypot(x - 0.4, y) < 0.3), shift=0.007),
    )
    noisy = replace(b, points_m=b.points_m + rng.normal(0, 0.002, b.points_m.shape))
    T = rigid_transform(
        rotation_from_vector(np.array([0.004, -0.003, 0.005])), [0.01, -0.008, 0.012]
    )
    fit = surface_fit(a, noisy.moved(T), np.eye(4), 0.06)
    assert fit is not None and 0.85 < fit.stable < 0.97
    off = transform_points(fit.T @ T, b.points_m) - b.points_m
    assert np.abs(off).max() < 5e-4
    center = (fit.T @ T)[:3] @ [*fit.center_m, 1] - fit.center_m
    assert (np.abs(center) < 5 * np.sqrt(np.diag(fit.covariance))[3:] + 5e-5).all()
    far = a.moved(rigid_transform(np.eye(3), [50, 0, 0]))
    assert surface_fit(a, far, np.eye(4), 0.06) is None


def test_distances_are_along_the_normal_of_steep_ground() -> None:
    slope = rigid_transform(rotation_from_vector(np.array([0.0, -np.radians(70), 0.0])), [0, 0, 0])
    wall = surface(lambda x, y: 0 * x).moved(slope)
    nearer = wall.moved(rigid_transform(np.eye(3), 0.015 * wall.normals[0]))
    core = wall.points_m[25::50]  # not at an edge
    std = np.full(len(core), 0.003)
    result = distances(wall, nearer, core, (std, std, 0 * std), 0.02)
    inner = np.isfinite(result.distance_m)
    assert inner.mean() > 0.9
    np.testing.assert_allclose(result.distance_m[inner], 0.015, atol=1e-6)
    assert np.median(result.lod_m[inner]) == pytest.approx(
        1.96 * 0.003 * np.sqrt(2 / (20 / 9)), rel=0.2
    )


def test_a_spread_that_grows_with_the_stated_error_is_learned() -> None:
    rng = np.random.default_rng(5)
    std = rng.uniform(0.002, 0.02, (150, 150))
    dz = rng.normal(0, 1, std.shape) * std * (1 + 50 * std)
    factor = spread_by(np.abs(dz) / std, std, np.ones_like(std, bool))
    for low, high in ((0.002, 0.006), (0.006, 0.012), (0.012, 0.02)):
        own = (std > low) & (std < high)
        assert (np.abs(dz) < 1.96 * factor * std)[own].mean() == pytest.approx(0.95, abs=0.02)
    assert (spread_by(dz, std, np.zeros_like(std, bool)) == 1).all()


def hills(rng: np.random.Generator, std_m: float, cells: float) -> Array:
    """Errors (200, 200) that reach over so many cells."""
    noise = (
        cv2.GaussianBlur(rng.standard_normal((200, 200)), (0, 0), cells)
        if cells
        else rng.standard_normal((200, 200))
    )
    return std_m * noise / noise.std()


@pytest.mark.slow
@pytest.mark.parametrize("reach", [0.0, 2.0, 6.0])
def test_the_error_of_a_volume_holds_what_cells_share(reach: float) -> None:
    """A Gaussian blur of s cells makes 4 pi s^2 cells share one error; over patches the totals
    spread as they are said to.
    """
    rng, std = np.random.default_rng(3), np.full((200, 200), 0.004)
    off, said = [], []
    for _ in range(12):
        dz = hills(rng, 0.004, reach)
        found = Difference(dz, std, std > 0, 1.0, 0 * std, *in_spreads(dz, std, std > 0))
        for row, column in ((20, 20), (20, 120), (120, 20), (120, 120)):
            patch = np.zeros(std.shape, bool)
            patch[row : row + 21, column : column + 21] = True
            volume, volume_std = volume_l(found, patch, 0.01)
            off.append(volume)
            said.append(volume_std)
    assert np.std(off) == pytest.approx(np.sqrt(np.mean(np.square(said))), rel=0.35)
    assert found.alike(441) == pytest.approx(max(1, 4 * np.pi * reach**2), rel=0.6)


def test_ground_beside_a_hole_at_the_foot_of_a_step_is_known_less_surely() -> None:
    """There each dive shows a ramp in some places, without it up to 38 standard errors off."""
    rng, shape, std_m = np.random.default_rng(3), (80, 80), 0.002
    ground_m, hole = np.zeros(shape), np.zeros(shape, bool)
    ground_m[30:50, 30:50] = 0.4
    hole[27:53, 27:53] = True
    hole[30:50, 30:50] = False
    beside = around(hole, 1) & ~hole & (ground_m == 0)
    ramps = [np.where(beside & (rng.random(shape) < 0.5), 0.1, 0) for _ in range(2)]
    heights = [ground_m + ramp + rng.normal(0, std_m, shape) for ramp in ramps]
    terrains = [
        Terrain(
            Grid(0.0, 0.8, 0.01, shape), np.where(hole, np.nan, each), np.zeros((*shape, 3), "f4")
        )
        for each in heights
    ]
    stated = np.full(shape, std_m)
    errors = TerrainErrors(stated, stated, np.full(shape, 3, np.int32), 0.01)
    exact = SimpleNamespace(std_m=lambda points, slopes: np.zeros(shape))
    found = difference(*terrains, errors, errors, exact)  # type: ignore[arg-type]
    assert np.nanmax(np.abs(found.dz_m / found.std_m)) < 5
    assert np.nanmedian(found.std_m[:20]) == pytest.approx(2**0.5 * std_m, rel=0.1)


def test_ground_that_one_survey_saw_in_more_frames_has_errors_of_its_own() -> None:
    """Where both have the same frames, both maps are off alike."""
    rng, shape, std_m = np.random.default_rng(3), (100, 100), 0.004
    more = np.zeros(shape, bool)
    more[:, 60:] = True
    after_m = rng.normal(0, np.where(more, std_m, 0.2 * std_m))
    grid, colors = Grid(0.0, 1.0, 0.01, shape), np.zeros((*shape, 3), "f4")
    terrains = [Terrain(grid, each, colors) for each in (np.zeros(shape), after_m)]
    stated = np.full(shape, std_m)
    errors = [
        TerrainErrors(stated, stated, np.where(more, views, 3).astype(np.int32), 0.01)
        for views in (3, 6)
    ]
    exact = SimpleNamespace(std_m=lambda points, slopes: np.zeros(shape))
    found = difference(*terrains, *errors, exact)  # type: ignore[arg-type]
    again = relearned(found, np.zeros(shape, bool))
    for each in (found, again):
        beyond = np.abs(each.dz_m) > each.lod_m
        assert 0.03 < beyond[more].mean() < 0.07 and beyond[~more].mean() < 0.07


def test_errors_are_read_off_all_ground_but_what_changed() -> None:
    """Ground with large errors here and there is left out while patches are looked for, and comes
    back.
    """
    rng, std = np.random.default_rng(4), np.full((200, 200), 0.004)
    dz = hills(rng, 0.004, 0.0)
    dz[:, :10] += 0.02 * rng.choice([-1, 1], (200, 10))
    changed = np.zeros(std.shape, bool)
    changed[100:140, 100:140] = True
    dz[changed] += 0.05
    stable = np.abs(dz) < 0.012
    found = Difference(dz, std, stable, 1.0, 0 * std, *in_spreads(dz, std, stable))
    again = relearned(found, changed)
    still = ~around(changed, 5)
    assert (np.abs(dz) <= found.lod_m)[still].mean() < 0.94
    assert (np.abs(dz) <= again.lod_m)[still].mean() == pytest.approx(0.95, abs=0.002)
    assert again.inflation > found.inflation
    # a patch is one by the errors that are stated with it
    patch = np.zeros(std.shape, bool)
    patch[40:50, 100:110] = True
    volume, volume_std = volume_l(found, with_tails(patch), 0.01)
    raised = dz + with_tails(patch) * (5.05 * volume_std - volume) / (0.1 * with_tails(patch).sum())
    sure = [is_sure(replace(errors, dz_m=raised), patch, 0.01) for errors in (found, again)]
    assert sure == [True, False]
    surface = m3c2.relearned(SurfaceDistances(dz, 0.5 * again.lod_m), again.stable)
    assert (np.abs(dz) <= surface.lod_m)[still].mean() == pytest.approx(0.95, abs=0.005)


def test_a_registration_that_is_unsure_sideways_is_unsure_of_the_height_of_slopes() -> None:
    covariance = np.diag([0, 0, 0, 0.01**2, 0, 0.002**2])  # 1 cm to the east, 2 mm upward
    at = Registration(np.eye(4), covariance, np.zeros(3), 0, 0, 0.0, 1.0, 0.0, 0.0, 0.0)
    points, slopes = np.zeros((3, 3)), np.array([[0.0, 0.5, 0.0], [0.0, 0.0, 2.0]])
    assert at.std_m(points, slopes) == pytest.approx([0.002, np.hypot(0.002, 0.005), 0.002])
    turned = replace(at, covariance=np.diag([0.001**2, 0, 0, 0, 0, 0]))
    assert turned.std_m(np.array([[0.0, 2.0, 0.0]]), np.zeros((2, 1))) == pytest.approx([0.002])


def test_a_faint_change_is_found_by_the_wide_window_and_its_edge_stays_where_it_is() -> None:
    rng, std = np.random.default_rng(8), np.full((200, 200), 0.015)
    dz, patch = hills(rng, 0.015, 0.7), np.hypot(*(np.indices((200, 200)) - 100)) < 16
    dz[patch] += 0.02
    found = Difference(
        dz, std, ~around(patch, 3), 1.0, 0 * std, *in_spreads(dz, std, ~around(patch, 3))
    )
    ((kind, mask),) = height_patches(found, SurfaceDistances(dz, 0.5 * found.lod_m), 0.01)
    # by the narrow window alone 0.6, in two pieces
    assert kind == "growth" and mask[patch].mean() > 0.85
    assert (mask & ~around(patch, 2)).sum() < 0.1 * patch.sum()


def test_what_heights_show_alone_at_an_edge_is_no_change_and_what_is_gone_is() -> None:
    """Where something tall was taken away, no cylinder reaches both surfaces; at an edge it does,
    and finds them together.
    """
    dz, std = np.random.default_rng(1).normal(0, 0.003, (100, 100)), np.full((100, 100), 0.003)
    dz[20:40, 20:40] -= 0.2
    stable = np.abs(dz) < 0.05
    found = Difference(dz, std, stable, 1.0, 0 * std, *in_spreads(dz, std, stable))
    lod_m = np.full(dz.shape, 0.004)
    gone, edge = np.where(stable, 0.0, np.nan), np.where(stable, 0.0, np.nan)
    gone[20:26, 20:40], edge[20:26, 20:40] = -0.2, 0.001
    ((kind, mask),) = height_patches(found, SurfaceDistances(gone, lod_m), 0.01)
    assert kind == "loss" and mask[20:40, 20:40].all()
    assert height_patches(found, SurfaceDistances(edge, lod_m), 0.01) == []


def test_a_cast_is_no_change_of_color_and_a_pale_spot_is() -> None:
    rng = np.random.default_rng(6)
    color = cv2.GaussianBlur(rng.uniform(30, 220, (120, 120, 3)).astype(np.float32), (0, 0), 4)
    color = (color - color.mean()) * 6 + 100
    grid, flat = Grid(0, 0, 0.01, (120, 120)), np.zeros((120, 120))
    spotted = np.clip(color, 5, 200)
    later = spotted.copy()
    later[40:70, 40:70] = 0.3 * later[40:70, 40:70] + 150
    found = color_change(
        Terrain(grid, flat, spotted),
        Terrain(grid, flat, later * np.array([0.7, 0.95, 0.9], np.float32)),
    )
    assert np.median(found.delta_e) < 1.5
    assert found.z[45:65, 45:65].min() > 4
    assert found.change[45:65, 45:65, 0].mean() > 10 and found.change[45:65, 45:65, 1].mean() < 0


@pytest.mark.slow
def test_changes_change_what_they_say_and_no_more() -> None:
    """Inverse by construction: what grew and is taken off again is the reef as it was."""
    reef = ReefFrames(replace(FIRST, pairs=2, lines=1)).reef
    grown = changed_reef(reef, [GROWN])
    assert np.abs(grown.height_m - reef.height_m).max() == pytest.approx(0.02, abs=1e-6)
    assert (grown.color[0] == reef.color[0]).all()
    back = changed_reef(grown, [replace(GROWN, amount_m=-0.02)])
    np.testing.assert_allclose(back.height_m, reef.height_m, atol=1e-6)
    assert inverse(T_SECOND) @ T_SECOND == pytest.approx(np.eye(4))


@pytest.mark.slow
def test_maps_of_other_voxels_are_refused(
    dives: tuple[Path, Path, Reef, Reef], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What larger voxels smooth would be change, of 5 to 8 standard errors."""
    of_run = {dives[0]: 0.01, dives[1]: 0.02}
    monkeypatch.setattr(PosedRun, "voxel_m", property(lambda self: of_run[self.run.root]))
    with pytest.raises(ComparingError, match=r"first was fused with voxels of 10 mm, .*m=0.02$"):
        compare(dives[0], dives[1])
