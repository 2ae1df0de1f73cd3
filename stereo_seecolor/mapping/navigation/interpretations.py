"""Other ways to read a trajectory's numbers, tried where the pictures contradict it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.geometry import inverse, quaternion
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.assignment import assign
from stereo_seecolor.mapping.navigation.motions import (
    misfit,
    misfits,
)
from stereo_seecolor.mapping.navigation.mount import Turn
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class InterpretationSettings:
    """When another reading is used."""

    better: float = 0.5  # another reading must leave at most this fraction of the misfit
    misfit: float = 0.03  # poses that fit to a thirtieth of a step are read rightly
    frames: int = 3  # poses may belong to frames so far on
    clock_steps: int = 12  # clocks may differ by so many times between frames,
    clock_parts: int = 4  # searched in so many parts of it
    edges: int = 200  # that a reading is judged by
    # steps that a scale or a turn estimated from the edges may leave: noise estimates them too
    estimated_misfit: float = 0.5
    inverted_rad: float = 0.7  # rotations inverted turn a camera that looks down by twice its tilt
    same_unit: float = 0.05  # a scale this near to that of a unit is its
    least_scale: float = 1.25  # a calibration is nearer than that
    # magnetic declination and the convergence of grids are named as turns from 9 degrees on
    least_turn_rad: float = 0.15


SETTINGS = InterpretationSettings()


def better_interpretation(
    plain: float, edges: Sequence[Edge], others: Iterator[tuple[str, Array]]
) -> str | None:
    """The reading that fits best, if it fits clearly better than the poses as read, whose misfit is
    ``plain``; else None.
    """
    if not np.isfinite(plain) or plain < SETTINGS.misfit:
        return None
    chosen = edges[:: max(1, len(edges) // SETTINGS.edges)]
    found, name = min(((misfit(T, chosen), name) for name, T in others), key=lambda pair: pair[0])
    return name if found < SETTINGS.better * plain else None


def interpretations(
    T: Array,
    edges: Sequence[Edge],
    index: FrameIndex,
    trajectory: Trajectory,
    config: MappingConfig,
) -> Iterator[tuple[str, Array]]:
    """List all other readings of the poses. T: (N, 4, 4) as read. edges: as the pictures show
    them.
    """
    if not any(trajectory.names) and np.isfinite(trajectory.timestamps_s).all():
        yield from _at_other_times(index, trajectory, config)
    for turned, start in (("", T), ("the quaternion's w first", w_first(T))):
        for name, positions in _POSITIONS.items():
            if turned or name:
                yield (
                    " and ".join(text for text in (turned, name) if text),
                    _with_positions(start, positions),
                )
        for name, other in (
            ("world-to-camera poses", inverse(start)),
            (INVERTED, _turned_back(start)),
        ):
            yield " and ".join(text for text in (turned, name) if text), other
    yield from _on_other_frames(T, index)
    yield from (
        reading
        for reading in _of_other_units_or_north(T, edges)
        if misfit(reading[1], edges) < SETTINGS.estimated_misfit
    )


def w_first(T: Array) -> Array:
    """Poses whose quaternions were written w x y z, and read as x y z w."""
    result = np.full_like(T, np.nan)
    known = np.isfinite(T).all(axis=(1, 2))
    result[known] = T[known]
    result[known, :3, :3] = Rotation.from_quat(
        np.roll(quaternion(T[known, :3, :3]), -1, axis=1)
    ).as_matrix()
    return result


def _turned_back(T: Array) -> Array:
    """Poses whose rotations lead from world to camera, beside positions of the camera."""
    result = T.copy()
    result[:, :3, :3] = np.swapaxes(T[:, :3, :3], 1, 2)
    return result


INVERTED = "the rotations inverted, as from world to camera"


def is_rather_inverted(turned: Array, turn: Turn, T: Array, edges: Sequence[Edge]) -> bool:
    """Tell whether inverted rotations explain poses at least as well as a constant turn, whose
    three angles were fitted: of a camera that looks down, both change the tilt alone, and differ
    where it turns about the vertical.

    turned: the poses ``T`` with the turn.
    """
    inverted = _turned_back(T)
    if (
        np.radians(turn.angle_deg) > SETTINGS.inverted_rad
        or misfit(inverted, edges) > SETTINGS.estimated_misfit
    ):
        return False
    costs = (np.log1p(misfits(poses, edges) ** 2).mean() for poses in (inverted, turned))
    return bool(next(costs) < next(costs))


_PER_METER = {"feet": 1 / 0.3048, "centimeters": 100.0, "millimeters": 1000.0}

_POSITIONS: dict[str, Callable[[Array], Array]] = {
    "": lambda p: p,
    "x and y swapped": lambda p: p[:, [1, 0, 2]],
    "x mirrored": lambda p: p * [-1, 1, 1],
    "y mirrored": lambda p: p * [1, -1, 1],
    "z pointing down": lambda p: p * [1, 1, -1],
    "positions north-east-down": lambda p: p[:, [1, 0, 2]] * [1, 1, -1],
}


def _with_positions(T: Array, change: Callable[[Array], Array]) -> Array:
    result = T.copy()
    result[:, :3, 3] = change(T[:, :3, 3])
    return result


def _of_other_units_or_north(T: Array, edges: Sequence[Edge]) -> Iterator[tuple[str, Array]]:
    """Positions times a number, and turned about the vertical against the attitudes: both estimated
    by least squares.
    """
    posed = [edge for edge in edges if np.isfinite(T[[edge.i, edge.j]]).all()]
    if not posed:
        return
    given_m = np.array([T[edge.j, :3, 3] - T[edge.i, :3, 3] for edge in posed])
    measured_m = np.array([T[edge.i, :3, :3] @ edge.T_i_j[:3, 3] for edge in posed])
    scale = float((given_m * measured_m).sum() / max((measured_m**2).sum(), 1e-12))
    if scale > SETTINGS.least_scale or 0 < scale < 1 / SETTINGS.least_scale:
        units = (
            unit
            for unit, per_m in _PER_METER.items()
            if abs(scale / per_m - 1) < SETTINGS.same_unit
        )
        yield (
            next((f"positions in {unit}" for unit in units), f"positions divided by {scale:.3g}"),
            _with_positions(T, lambda p: p / scale),
        )
    across = (given_m @ [1, 1j, 0]) * (measured_m @ [1, -1j, 0])
    turn_rad = float(np.angle(across.sum()))
    if abs(turn_rad) > SETTINGS.least_turn_rad:
        back = Rotation.from_euler("z", -turn_rad).as_matrix()
        name = (
            f"positions rotated by {-np.degrees(turn_rad):+.0f} degrees about the vertical, or "
            "headings by the opposite angle"
        )
        yield name, _with_positions(T, lambda p: p @ back.T)


def _on_other_frames(T: Array, index: FrameIndex) -> Iterator[tuple[str, Array]]:
    for steps in (s for n in range(1, SETTINGS.frames + 1) for s in (n, -n)):
        result = np.full_like(T, np.nan)
        source, target = index.order[max(steps, 0) :], index.order[max(-steps, 0) :]
        result[target[: len(source)]] = T[source[: len(target)]]
        yield f"each pose {abs(steps)} frame(s) {'earlier' if steps > 0 else 'later'}", result
    result = np.full_like(T, np.nan)
    result[index.order] = T[index.order[::-1]]
    yield "the poses in the opposite order", result


def _at_other_times(
    index: FrameIndex, trajectory: Trajectory, config: MappingConfig
) -> Iterator[tuple[str, Array]]:
    times = np.sort(index.timestamps_s[np.isfinite(index.timestamps_s)])
    step_s = float(np.median(np.diff(times))) / SETTINGS.clock_parts if len(times) > 1 else 0.0
    for number in range(
        -SETTINGS.clock_steps * SETTINGS.clock_parts,
        SETTINGS.clock_steps * SETTINGS.clock_parts + 1,
    ):
        shift_s = number * step_s
        if shift_s:
            moved = replace(trajectory, timestamps_s=trajectory.timestamps_s + shift_s)
            yield (
                f"{shift_s:+.2f} s added to the times of the poses",
                assign(index, moved, config).T_world_camera,
            )
