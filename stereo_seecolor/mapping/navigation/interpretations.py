"""Other ways to read a trajectory's numbers, tried where the images contradict it."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.robust_statistics import weighted_median
from calibration.transforms import inverse, quaternion, rotation_from_quaternion
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.angles import of_other_angles
from stereo_seecolor.mapping.navigation.clocks import of_other_clocks
from stereo_seecolor.mapping.navigation.motions import Motions, misfit
from stereo_seecolor.mapping.navigation.mount import north_of
from stereo_seecolor.mapping.navigation.seen_motion import SeenMotion
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import Array, Trajectory


@dataclass(frozen=True)
class InterpretationSettings:
    """When another reading is used."""

    # of what the best reading leaves, another one that leaves so much is as likely
    alike: float = 1.15
    # of the many clocks that are tried one fits noise better by chance: what it may leave, in steps
    # and relative to the clock as read
    clock_misfit: float = 1.0
    clock_better: float = 0.5
    frames: int = 3  # poses may belong to frames so far on
    # steps that a scale or a turn estimated from the edges may leave: noise estimates them too
    estimated_misfit: float = 0.5
    same_unit: float = 0.05  # a scale this near to that of a unit is its
    least_scale: float = 1.25  # a calibration is nearer than that
    # magnetic declination, the convergence of grids and compasses make less, which is corrected
    least_turn_rad: float = 0.35


SETTINGS = InterpretationSettings()
CLOCK_EDGES = 60
"""Relative poses by which each of some hundred clocks is judged."""


@dataclass(frozen=True, eq=False)
class PoseReading:
    """Another way to read poses. T: (N, 4, 4) so read."""

    name: str
    misfit: float
    T: Array


def best_readings(seen: SeenMotion, others: Iterable[tuple[str, Array]]) -> list[PoseReading]:
    """The reading that fits best, then those that fit about as well."""
    found = sorted(
        (PoseReading(name, seen.misfit(T), T) for name, T in others), key=lambda one: one.misfit
    )
    most = SETTINGS.alike * found[0].misfit if found else 0.0
    return [one for one in found if one.misfit <= most]


def named(readings: Sequence[PoseReading]) -> str:
    """The readings in words: the best, and those as likely."""
    return "; or, as likely, with ".join(one.name for one in readings)


def interpretations(
    T: Array, seen: SeenMotion, index: FrameIndex, trajectory: Trajectory
) -> Iterator[tuple[str, Array]]:
    """List all other readings of the poses. T: (N, 4, 4) as read. seen: by the images."""
    has_clock = (
        not any(trajectory.names)
        and np.isfinite(trajectory.timestamps_s).all()
        and np.isfinite(index.timestamps_s).any()
    )
    if has_clock:
        clocks = of_other_clocks(index, trajectory, seen.thinned(CLOCK_EDGES).misfit)
        yield from (one for one in clocks if _is_clock(one[1], T, seen))
    # the rotations of a table of angles are of no quaternion or matrix
    of_matrices = trajectory.T_vehicle_camera is None
    starts = [("", T), ("the quaternion's w first", w_first(T))][: 1 + of_matrices]
    for turned, start in starts:
        for name, positions in _POSITIONS.items():
            if turned or name:
                on_earth = _ON_EARTH.get(name, "") if trajectory.origin else ""
                on_earth += _OF_A_TABLE.get(name, "") if not of_matrices else ""
                yield (
                    " and ".join(text for text in (turned, name) if text) + on_earth,
                    _with_positions(start, positions),
                )
        if of_matrices:
            for name, other in (
                ("world-to-camera poses", inverse(start)),
                (INVERTED, _turned_back(start)),
                *_right_handed(start),
            ):
                yield " and ".join(text for text in (turned, name) if text), other
    for name, other in of_other_angles(T, trajectory.T_vehicle_camera):
        yield name, other
        if where := _IN_OTHER_AXES.get(name):
            yield f"{where} and {name}", _with_positions(other, _POSITIONS[where])
    yield from _on_other_frames(T, index, 0 if has_clock else SETTINGS.frames)
    yield from (
        reading
        for reading in (*_of_other_units(T, seen.edges), *_of_other_north(T, seen))
        if misfit(reading[1], seen.edges) < SETTINGS.estimated_misfit
    )


def _is_clock(by_clock: Array, T: Array, seen: SeenMotion) -> bool:
    """Tell whether poses by another clock (N, 4, 4) fit far better than T, by the median or, where
    noise covers most of the track, by all relative poses; costs are squares of misfits.
    """
    left = seen.misfit(by_clock)
    return left < SETTINGS.clock_misfit and (
        left < SETTINGS.clock_better * seen.misfit(T)
        or seen.cost(by_clock) < SETTINGS.clock_better**2 * seen.cost(T)
    )


def w_first(T: Array) -> Array:
    """Poses whose quaternions were written w x y z, and read as x y z w."""
    result = np.full_like(T, np.nan)
    known = np.isfinite(T).all(axis=(1, 2))
    result[known] = T[known]
    result[known, :3, :3] = rotation_from_quaternion(
        np.roll(quaternion(T[known, :3, :3]), -1, axis=1)
    )
    return result


def _turned_back(T: Array) -> Array:
    """Poses whose rotations lead from world to camera, beside positions of the camera."""
    result = T.copy()
    result[:, :3, :3] = np.swapaxes(T[:, :3, :3], 1, 2)
    return result


def _right_handed(T: Array) -> Iterator[tuple[str, Array]]:
    """Poses of left-handed axes, as game engines write them; whichever axis of the world is the
    mirrored one, relative poses show the camera's alone.
    """
    for axis, name in enumerate(("x (right)", "y (down)", "z (forward)")):
        mirror = np.eye(4)
        mirror[axis, axis] = -1
        yield f"axes that are left-handed, with the camera's {name} mirrored", mirror @ T @ mirror


INVERTED = "the rotations inverted, as from world to camera"


_PER_METER = {
    "in feet": 1 / 0.3048,
    "in centimeters": 100.0,
    "in millimeters": 1000.0,
    "in degrees with minutes as decimals (14.30 for 14 degrees 30 minutes)": 0.6,
}

_POSITIONS: dict[str, Callable[[Array], Array]] = {
    "": lambda p: p,
    "x and y swapped": lambda p: p[:, [1, 0, 2]],
    "x mirrored": lambda p: p * [-1, 1, 1],
    "y mirrored": lambda p: p * [1, -1, 1],
    "z pointing down": lambda p: p * [1, 1, -1],
    "positions north-east-down": lambda p: p[:, [1, 0, 2]] * [1, 1, -1],
}
_ON_EARTH = {
    "x and y swapped": " (latitude and longitude exchanged)",
    "x mirrored": " (longitudes of the other sign)",
    "y mirrored": " (latitudes of the other sign)",
}
_IN_OTHER_AXES = {
    "headings counted counterclockwise from north": "x mirrored",
    "headings counted counterclockwise from east": "x and y swapped",
}
"""Positions beside such headings, of one system of axes."""
_OF_A_TABLE = {"z pointing down": " (heights or altitudes in place of depths)"}


def _with_positions(T: Array, change: Callable[[Array], Array]) -> Array:
    result = T.copy()
    result[:, :3, 3] = change(T[:, :3, 3])
    return result


def _of_other_north(T: Array, seen: SeenMotion) -> Iterator[tuple[str, Array]]:
    """Headings turned against the positions by more than a compass is off."""
    north = north_of(T, seen.spans or seen.edges)
    if abs(north.angle_rad) > SETTINGS.least_turn_rad:
        yield (
            f"positions rotated by {np.degrees(-north.angle_rad):+.0f} degrees about the "
            "vertical, or headings by the opposite angle",
            north.undone(T),
        )


def _of_other_units(T: Array, edges: Sequence[Edge]) -> Iterator[tuple[str, Array]]:
    """Positions times a number, the median of what the edges show."""
    given_m, measured_m = Motions.of(T, edges).shifts_in_world(T)
    if not len(given_m):
        return
    squared = (measured_m**2).sum(axis=1)
    scale = weighted_median((given_m * measured_m).sum(axis=1) / squared, squared)
    if scale > SETTINGS.least_scale or 0 < scale < 1 / SETTINGS.least_scale:
        units = (
            unit
            for unit, per_m in _PER_METER.items()
            if abs(scale / per_m - 1) < SETTINGS.same_unit
        )
        by_no_unit = (
            f"positions divided by {scale:.3g}, or ranges times {scale:.3g} (the baseline of the "
            "calibration)"
        )
        yield (
            next((f"positions {unit}" for unit in units), by_no_unit),
            _with_positions(T, lambda p: p / scale),
        )


def _on_other_frames(T: Array, index: FrameIndex, frames: int) -> Iterator[tuple[str, Array]]:
    for steps in (s for n in range(1, frames + 1) for s in (n, -n)):
        result = np.full_like(T, np.nan)
        source, target = index.order[max(steps, 0) :], index.order[max(-steps, 0) :]
        result[target[: len(source)]] = T[source[: len(target)]]
        yield f"each pose {abs(steps)} frame(s) {'earlier' if steps > 0 else 'later'}", result
    result = np.full_like(T, np.nan)
    result[index.order] = T[index.order[::-1]]
    yield "the poses in the opposite order", result
