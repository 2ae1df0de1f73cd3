"""Tables of navigation altered in one way, on a drawn dive of four lines: what is wrong is named,
and nothing else; what is right is used.
"""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration.transforms import inverse, rigid_transform, rotation_from_vector
from stereo_seecolor.config import MappingConfig, MountConfig
from stereo_seecolor.inputs.trajectories.vehicle_track import VehicleTrack
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.assignment import place
from stereo_seecolor.mapping.navigation.comparison import ComparedNavigation, examine
from stereo_seecolor.mapping.navigation.priors import priors
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import GeoOrigin, Trajectory

Array = NDArray[np.float64]
ORIGIN = GeoOrigin(-23.5, 152.0)
CONFIG = MappingConfig()
BEGIN_S, LINE_S, RATE_S = 1_700_000_000.0, 12.0, 0.2
LINES = 4


class Table(NamedTuple):
    """Columns of navigation, n rows: seconds, (n, 2) meters north and east, meters, degrees."""

    times_s: Array
    north_east_m: Array
    depth_m: Array
    roll_deg: Array
    pitch_deg: Array
    heading_deg: Array

    def read(self, mount: MountConfig = CONFIG.mount) -> Trajectory:
        """As the reader of tables reads them."""
        attitude_deg = np.column_stack([self.roll_deg, self.pitch_deg, self.heading_deg])
        track = VehicleTrack(
            ("",) * len(self.times_s),
            self.times_s,
            self.north_east_m,
            self.depth_m,
            attitude_deg,
            ORIGIN,
        )
        return track.camera(mount)


def vehicle(noise: float = 1.0) -> Table:
    """Four lines of 6 m, 1 m apart, in a heading of 30 degrees and back; half a minute before and
    after it lies on another course.
    """
    rng = np.random.default_rng(3)
    t = np.arange(-40, LINES * LINE_S + 40, RATE_S)
    line = np.clip(t // LINE_S, 0, LINES - 1)
    within = t / LINE_S - line
    along = np.where(line % 2 == 0, within, 1 - within) * 6 + 0.1 * np.sin(t / 3)
    across = line + 0.15 * np.sin(t / 5)
    heading = np.radians(30)
    north_east = np.stack(
        [
            along * np.cos(heading) - across * np.sin(heading),
            along * np.sin(heading) + across * np.cos(heading),
        ],
        axis=1,
    )
    return Table(
        BEGIN_S + t,
        north_east + noise * rng.normal(0, 0.02, north_east.shape),
        8 + 0.3 * np.sin(t / 7) + noise * rng.normal(0, 0.01, t.shape),
        4 * np.sin(t / 4) + 3 + noise * rng.normal(0, 0.2, t.shape),
        5 * np.cos(t / 6) + 2 + noise * rng.normal(0, 0.2, t.shape),
        30 + 180 * (line % 2) + 5 * np.sin(t / 5) + noise * rng.normal(0, 0.2, t.shape),
    )


@pytest.fixture(scope="module")
def seen() -> Callable[[Trajectory], ComparedNavigation]:
    """Holds poses against what the pictures show of a pair a second."""
    times_s = BEGIN_S + np.arange(0.5, LINES * LINE_S)
    count = len(times_s)
    names = tuple(f"f{i:02}" for i in range(count))
    index = FrameIndex(names, times_s, (np.zeros((0, 3), np.float32),) * count)
    true = place(index, vehicle(noise=0).read()).T_world_camera
    rng = np.random.default_rng(1)
    edges = []
    for i, j in ((i, i + step) for step in (1, 2) for i in range(count - step)):
        measured = inverse(true[i]) @ true[j]
        measured[:3, 3] += rng.normal(0, 0.003, 3)
        edges.append(Edge(i, j, measured, np.eye(6), 100))
    own = Placement(
        rigid_transform(rotation_from_vector(np.ones(3)), np.ones(3)) @ true, np.zeros(count, int)
    )
    survey = SimpleNamespace(index=index)

    def compare(trajectory: Trajectory) -> ComparedNavigation:
        given = place(index, trajectory)
        return examine(given, survey, edges, trajectory, CONFIG, own)  # type: ignore[arg-type]

    return compare


def shifted(t: Table, by_s: float, rate: float = 0.0) -> Table:
    since_s = t.times_s - BEGIN_S
    return t._replace(times_s=t.times_s + by_s + rate * since_s)


def positions(t: Table, change: Callable[[Array], Array]) -> Table:
    return t._replace(north_east_m=change(t.north_east_m))


WRONG: dict[str, tuple[Callable[[Table], Table], str]] = {
    "half a second": (lambda t: shifted(t, 0.5), "-0.50 s added to the times"),
    "two seconds": (lambda t: shifted(t, -2), "+2.00 s added to the times"),
    "half a minute": (lambda t: shifted(t, 30), "-30.00 s added to the times"),
    "a drift": (lambda t: shifted(t, 0, 0.06), "as of a clock that drifts"),
    "latitude's sign": (lambda t: positions(t, lambda p: p * [-1, 1]), "y mirrored (latitudes"),
    "longitude's sign": (lambda t: positions(t, lambda p: p * [1, -1]), "x mirrored (longitudes"),
    "exchanged": (lambda t: positions(t, lambda p: p[:, ::-1]), "x and y swapped (latitude and"),
    "feet": (lambda t: positions(t, lambda p: p / 0.3048), "positions in feet"),
    "half the baseline": (
        lambda t: positions(t, lambda p: 2 * p),
        "positions divided by 1.99, or ranges times 1.99 (the baseline of the calibration)",
    ),
    "minutes": (lambda t: positions(t, lambda p: 0.6 * p), "minutes as decimals"),
    "heading + 90": (lambda t: t._replace(heading_deg=t.heading_deg + 90), "rotated by -90"),
    "counterclockwise": (
        lambda t: t._replace(heading_deg=-t.heading_deg),
        "headings counted counterclockwise from north",
    ),
    "from east": (
        lambda t: t._replace(heading_deg=90 - t.heading_deg),
        "headings counted counterclockwise from east",
    ),
    "axes east, north": (
        lambda t: positions(t, lambda p: p[:, ::-1])._replace(heading_deg=90 - t.heading_deg),
        "or, as likely, with x and y swapped and headings counted counterclockwise from east",
    ),
    "heading in radians": (
        lambda t: t._replace(heading_deg=np.radians(t.heading_deg)),
        "would fit with headings in radians",
    ),
    "roll and pitch": (
        lambda t: t._replace(roll_deg=t.pitch_deg, pitch_deg=t.roll_deg),
        "roll and pitch exchanged",
    ),
    "roll": (lambda t: t._replace(roll_deg=-t.roll_deg), "roll of the other sign"),
    "pitch": (lambda t: t._replace(pitch_deg=-t.pitch_deg), "pitch of the other sign"),
    "radians": (
        lambda t: t._replace(
            roll_deg=np.radians(t.roll_deg),
            pitch_deg=np.radians(t.pitch_deg),
            heading_deg=np.radians(t.heading_deg),
        ),
        "heading, pitch and roll in radians",
    ),
    "altitude": (
        lambda t: t._replace(depth_m=10 - t.depth_m),
        "heights or altitudes in place of depths",
    ),
    "depth in feet": (lambda t: t._replace(depth_m=t.depth_m / 0.3048), "depths in feet"),
    "pressure in kPa": (
        lambda t: t._replace(depth_m=101 + 10.05 * t.depth_m),
        "pressures in kilopascals",
    ),
    "pressure in bars": (lambda t: t._replace(depth_m=t.depth_m / 9.95), "pressures in bars"),
    "stuck": (
        lambda t: positions(t, lambda p: p[0] + 0.01 * np.sin(np.outer(t.times_s, [1, 2]))),
        "they stay at one place",
    ),
    "stuck from the middle": (
        lambda t: positions(t, lambda p: np.where((t.times_s > BEGIN_S + 24)[:, None], p[320], p)),
        "there the positions stay at one place",
    ),
    "heading that stays": (
        lambda t: t._replace(
            heading_deg=np.where(t.times_s > BEGIN_S + 6, t.heading_deg[230], t.heading_deg)
        ),
        "there the attitudes or headings stay",
    ),
    "another dive": (
        lambda t: t._replace(
            north_east_m=np.cumsum(
                0.08 * np.stack([np.sin(t.times_s / 9), np.cos(t.times_s / 7)], axis=1), axis=0
            ),
            heading_deg=40 * np.sin(t.times_s / 11),
        ),
        "do they belong to this dive?",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_in_a_table_is_named_and_nothing_else(
    seen: Callable[[Trajectory], ComparedNavigation], name: str
) -> None:
    change, said = WRONG[name]
    navigation = seen(change(vehicle()).read()).navigation
    assert not navigation.fits
    assert said in navigation.advice


def during(t: Table, first_s: float, last_s: float) -> Table:
    """Rows of a part of the dive."""
    kept = (t.times_s >= BEGIN_S + first_s) & (t.times_s <= BEGIN_S + last_s)
    return Table(*(column[kept] for column in t))


@pytest.mark.slow
def test_a_clock_by_which_few_frames_have_a_pose_is_named(
    seen: Callable[[Trajectory], ComparedNavigation],
) -> None:
    dive = during(vehicle(), 0, LINES * LINE_S)
    for by_s, posed in ((45, 3), (38, 10)):
        navigation = seen(shifted(dive, by_s).read()).navigation
        assert not navigation.fits
        assert navigation.advice.startswith(f"only {posed} of 48 frames have a pose by the times")
        assert f"48 have one with -{by_s}.00 s added" in navigation.advice
    # a table of the end of the dive alone
    navigation = seen(during(vehicle(), 36, LINES * LINE_S).read()).navigation
    assert navigation.fits and not navigation.advice


@pytest.mark.parametrize("noise", [0.0, 1.0, 5.0])
def test_a_right_table_fits_and_nothing_is_said(
    seen: Callable[[Trajectory], ComparedNavigation], noise: float
) -> None:
    navigation = seen(vehicle(noise).read()).navigation
    assert navigation.fits and not navigation.advice


@pytest.mark.slow
@pytest.mark.parametrize("error_deg", [5.0, 12.0])
def test_magnetic_declination_is_said_with_its_rival_and_taken_out(
    seen: Callable[[Trajectory], ComparedNavigation], error_deg: float
) -> None:
    t = vehicle()
    found = seen(t._replace(heading_deg=t.heading_deg + error_deg).read())
    right = seen(t.read()).placement.T_world_camera
    assert found.navigation.fits
    assert f"the given headings are turned by +{error_deg:.0f}." in found.navigation.advice or (
        f"the given headings are turned by +{error_deg - 1:.0f}." in found.navigation.advice
    )
    turned = np.swapaxes(right[:, :3, :3], 1, 2) @ found.placement.T_world_camera[:, :3, :3]
    assert np.degrees(np.arccos((np.trace(turned, axis1=1, axis2=2) - 1) / 2)).max() < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("arm_m", [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
def test_positions_of_another_point_of_the_vehicle_are_no_jumps_at_turns(
    seen: Callable[[Trajectory], ComparedNavigation], arm_m: list[float]
) -> None:
    mount = MountConfig(xyz_m=tuple(arm_m), rpy_deg=CONFIG.mount.rpy_deg)  # type: ignore[arg-type]
    found = seen(vehicle().read(mount))
    assert found.navigation.fits
    assert "m from the camera" in found.navigation.advice and "jump" not in found.navigation.advice
    right = vehicle().read()
    off_m = np.abs(
        found.placement.T_world_camera[:, :2, 3] - seen(right).placement.T_world_camera[:, :2, 3]
    )
    assert np.median(off_m) < 0.05


@pytest.mark.parametrize(
    "rpy_deg", [(180.0, 0.0, 0.0), (180.0, 0.0, 90.0), (180.0, 0.0, -90.0), (0.0, 90.0, 90.0)]
)
def test_a_camera_upside_down_or_turned_by_a_right_angle_is_taken_into_account(
    seen: Callable[[Trajectory], ComparedNavigation], rpy_deg: tuple[float, float, float]
) -> None:
    found = seen(vehicle().read(MountConfig(rpy_deg=rpy_deg)))
    assert found.navigation.fits
    assert found.navigation.advice.startswith("the camera is rotated by ")
    right = seen(vehicle().read()).placement.T_world_camera
    turned = np.swapaxes(right[:, :3, :3], 1, 2) @ found.placement.T_world_camera[:, :3, :3]
    assert np.degrees(np.arccos((np.trace(turned, axis1=1, axis2=2) - 1) / 2)).max() < 0.5


@pytest.mark.parametrize("jump_m", [2.0, 100.0])
def test_positions_that_jump_in_the_middle_are_no_arm_and_of_no_other_dive(
    seen: Callable[[Trajectory], ComparedNavigation], jump_m: float
) -> None:
    t = vehicle()
    late = (t.times_s > BEGIN_S + 24)[:, None]
    navigation = seen(positions(t, lambda p: p + late * [jump_m, 0.0]).read()).navigation
    assert not navigation.fits
    assert navigation.advice == (
        f"the given poses contradict the images: the given positions jump by {jump_m:.2f} m "
        "relative to the images between f23 and f24; before and after they fit, and nothing shows "
        "which are right"
    )


@pytest.mark.parametrize("drift_m", [[2.0, 0.6], [1.0, 0.3]])
def test_positions_that_drift_are_no_arm(
    seen: Callable[[Trajectory], ComparedNavigation], drift_m: list[float]
) -> None:
    t = vehicle()
    part = (t.times_s - BEGIN_S)[:, None] / (LINES * LINE_S)
    navigation = seen(positions(t, lambda p: p + part * drift_m).read()).navigation
    assert navigation.fits and not navigation.advice


def test_depths_with_noise_are_of_no_other_unit(
    seen: Callable[[Trajectory], ComparedNavigation],
) -> None:
    t = vehicle()
    noise_m = np.random.default_rng(2).normal(0, 0.3, len(t.depth_m))
    navigation = seen(t._replace(depth_m=t.depth_m + noise_m).read()).navigation
    assert navigation.fits and not navigation.advice


@pytest.mark.parametrize(("axis", "name"), [(0, "right"), (1, "down"), (2, "forward")])
def test_left_handed_poses_are_named_and_no_turn_of_the_camera(
    seen: Callable[[Trajectory], ComparedNavigation], axis: int, name: str
) -> None:
    right, world, camera = vehicle().read(), np.eye(4), np.eye(4)
    world[1, 1] = camera[axis, axis] = -1
    T = world @ right.T_world_camera @ camera
    navigation = seen(replace(right, T_world_camera=T, T_vehicle_camera=None)).navigation
    assert not navigation.fits
    assert f"left-handed, with the camera's {'xyz'[axis]} ({name}) mirrored" in navigation.advice


def test_depths_that_stay_are_said(seen: Callable[[Trajectory], ComparedNavigation]) -> None:
    t = vehicle()
    navigation = seen(t._replace(depth_m=8 + 0 * t.depth_m).read()).navigation
    assert navigation.fits and "the given depths hardly change" in navigation.advice


def test_positions_far_off_are_no_priors() -> None:
    T = np.tile(np.eye(4), (20, 1, 1))
    T[:, 0, 3] = np.arange(20)
    given = T.copy()
    given[:, :3, 3] += np.random.default_rng(0).normal(0, 0.02, (20, 3))
    given[[4, 11], 1, 3] += 50
    alone = np.zeros(20, int)
    known = priors(Placement(T, alone), Placement(given, alone), CONFIG)
    assert [prior.frame for prior in known] == [i for i in range(20) if i not in (4, 11)]
    assert known[0].position_std_m[0] < 0.04
