"""Causes that look alike on straight lines: each is named where the images tell it from its rivals,
with these where they do not.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from test_navigation_readings import BEGIN_S, CONFIG, RATE_S, Table, positions, shifted

from calibration.transforms import inverse, rigid_transform, rotation_from_vector
from stereo_seecolor.config import MountConfig
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.assignment import place
from stereo_seecolor.mapping.navigation.comparison import Navigation, examine
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import Trajectory

Array = NDArray[np.float64]
Course = Callable[[Array], tuple[Array, Array]]


def lines(t: Array) -> tuple[Array, Array]:
    """Three lines of 3.5 m to and fro, 1 m apart, 7 s each and 2 s of turning between: (n, 2)
    meters north and east, degrees.
    """
    line = np.clip(t // 9, 0, 2)
    along = np.clip(t - 9 * line, 0, 7) / 2
    return np.stack([np.where(line % 2, 3.5 - along, along), line], axis=1), 180 * (line % 2)


def one_line(t: Array) -> tuple[Array, Array]:
    """Steps of 12 cm, 1 m in all: navigation's noise of 2 cm leaves several causes open."""
    return np.stack([0.12 * t, 0.01 * t], axis=1), 0 * t


def corner(t: Array) -> tuple[Array, Array]:
    """Northward for 16 s, then eastward; the heading stays."""
    return 0.3 * np.stack([np.minimum(t, 16), np.maximum(t - 16, 0)], axis=1), 0 * t


def table(course: Course, lasts_s: float, seed: int | None) -> Table:
    """Navigation of a vehicle that pitches by 15 degrees; without noise where seed is None."""
    t = np.arange(-20, lasts_s + 20, RATE_S)
    rng, noise = np.random.default_rng(seed), 0.0 if seed is None else 1.0
    north_east_m, heading_deg = course(t)
    return Table(
        BEGIN_S + t,
        north_east_m + noise * rng.normal(0, 0.02, (len(t), 2)),
        8 + 0.1 * np.sin(t / 3) + noise * rng.normal(0, 0.01, len(t)),
        np.sin(t / 2) + noise * rng.normal(0, 0.2, len(t)),
        15 + np.cos(t / 3) + noise * rng.normal(0, 0.2, len(t)),
        heading_deg + 2 * np.sin(t / 4) + noise * rng.normal(0, 0.2, len(t)),
    )


def told(
    course: Course,
    lasts_s: float,
    change: Callable[[Table], Table | Trajectory] = lambda t: t,
    mount: MountConfig = CONFIG.mount,
    seed: int = 0,
) -> Navigation:
    """What is said of a table against what the images show of a pair a second."""
    times_s = BEGIN_S + np.arange(0.5, lasts_s)
    if course is lines:
        times_s = times_s[(times_s - BEGIN_S) % 9 < 7]
    count = len(times_s)
    names = tuple(f"f{i:02}" for i in range(count))
    index = FrameIndex(names, times_s, (np.zeros((0, 3), np.float32),) * count)
    true = place(index, table(course, lasts_s, None).read()).T_world_camera
    rng = np.random.default_rng(1)
    edges = []
    for i, j in ((i, i + step) for step in (1, 2, 3) for i in range(count - step)):
        measured = inverse(true[i]) @ true[j]
        measured[:3, 3] += rng.normal(0, 0.003, 3)
        edges.append(Edge(i, j, measured, np.eye(6), 100))
    own = Placement(
        rigid_transform(rotation_from_vector(np.ones(3)), np.ones(3)) @ true, np.zeros(count, int)
    )
    given = change(table(course, lasts_s, seed))
    given = given if isinstance(given, Trajectory) else given.read(mount)
    survey = SimpleNamespace(index=index)
    return examine(
        place(index, given),
        survey,  # type: ignore[arg-type]
        edges,
        given,
        CONFIG,
        own,
    ).navigation


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_an_arm_and_a_clock_that_both_shift_along_the_line_are_told_apart(seed: int) -> None:
    above = MountConfig(xyz_m=(0.0, 0.0, -0.4), rpy_deg=CONFIG.mount.rpy_deg)
    arm = told(lines, 27, mount=above, seed=seed)
    assert arm.fits and "m from the camera" in arm.advice and " ± " in arm.advice
    assert "jump" not in arm.advice and "times" not in arm.advice
    clock = told(lines, 27, lambda t: shifted(t, 0.25), seed=seed)
    assert not clock.fits
    assert clock.advice.endswith("with -0.25 s added to the times of the poses")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_sign_that_shows_after_a_corner_alone_is_no_wrong_part(seed: int) -> None:
    navigation = told(corner, 40, lambda t: positions(t, lambda p: p * [1, -1]), seed=seed)
    assert not navigation.fits
    assert navigation.advice.endswith("with x mirrored (longitudes of the other sign)")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 7, 9])
def test_headings_off_on_a_short_line_are_not_the_camera_alone(seed: int) -> None:
    navigation = told(one_line, 9, lambda t: t._replace(heading_deg=t.heading_deg + 6), seed=seed)
    assert navigation.fits and "the given headings are turned by" in navigation.advice


def held(t: Table, for_s: float, seed: int) -> Table:
    """The table of a receiver that repeats each fix for so many seconds."""
    since_s = t.times_s - BEGIN_S - for_s * np.random.default_rng(seed).random()
    fix = np.floor(since_s / for_s)
    return t._replace(north_east_m=t.north_east_m[np.searchsorted(fix, fix)])


def from_file(t: Table, folder: Path, is_tum: bool) -> Trajectory:
    """A table as it is read from a file: of navigation, or of poses."""
    if is_tum:
        path = folder / "track.tum"
        write_tum(path, replace(t.read(), camera="rectified"))
    else:
        path = folder / "nav.csv"
        rows = [",".join(map(repr, row)) for row in np.column_stack(t).tolist()]
        path.write_text("\n".join(["time,north,east,depth,roll,pitch,heading", *rows]))
    return read_trajectory(path)


@pytest.mark.slow
@pytest.mark.parametrize("is_tum", [False, True])
@pytest.mark.parametrize("for_s", [2.0, 4.0, 5.0, 8.0, 12.0])
@pytest.mark.parametrize(("course", "lasts_s"), [(lines, 27), (corner, 40)])
def test_fixes_that_a_receiver_repeats_are_no_scale_arm_jump_or_other_dive(
    course: Course, lasts_s: float, for_s: float, is_tum: bool, tmp_path: Path
) -> None:
    """Interpolated over the turns between lines they were one of these on most tables."""
    for seed in range(3):
        navigation = told(
            course,
            lasts_s,
            lambda t, seed=seed: from_file(held(t, for_s, seed), tmp_path, is_tum),
            seed=seed,
        )
        assert navigation.fits and not navigation.advice


@pytest.mark.slow
@pytest.mark.parametrize(
    ("for_s", "change", "said"),
    [
        (4.0, lambda p: p * [-1, 1], "they would fit with y mirrored"),
        (4.0, lambda p: p / 0.3048, "they would fit with positions in feet"),
        (4.0, lambda p: 1.15 * p, "times as far apart as in the images"),
        (8.0, lambda p: p * [-1, 1], "they would fit with y mirrored"),
        (8.0, lambda p: p / 0.3048, "the given poses contradict the images"),
    ],
)
def test_what_is_wrong_in_repeated_fixes_is_named(
    for_s: float, change: Callable[[Array], Array], said: str, tmp_path: Path
) -> None:
    """Also where three of them are too few to be compared with each other."""
    navigation = told(
        lines, 27, lambda t: from_file(positions(held(t, for_s, 0), change), tmp_path, is_tum=False)
    )
    assert said in navigation.advice


@pytest.mark.parametrize("course", [lines, one_line, corner])
def test_right_tables_are_right(course: Course) -> None:
    navigation = told(course, {lines: 27, one_line: 9, corner: 40}[course])
    assert navigation.fits and not navigation.advice


@pytest.mark.parametrize(
    ("course", "lasts_s", "at_s", "jump_m"),
    [(lines, 27, 12.0, [-3.1, -4.9]), (corner, 40, 20.9, [1.9, -1.8])],
)
def test_a_jump_of_positions_is_no_other_clock(
    course: Course, lasts_s: float, at_s: float, jump_m: list[float]
) -> None:
    def jumping(t: Table) -> Table:
        late = (t.times_s > BEGIN_S + at_s)[:, None]
        return positions(t, lambda p: p + late * jump_m)

    navigation = told(course, lasts_s, jumping)
    assert not navigation.fits
    assert ": the given positions jump by " in navigation.advice
