"""The nonlinear least-squares problem of bundle adjustment: poses and points compared with all
observations and all that is known.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.geometry import inverse, rotation_from_vector, rotation_vector
from stereo_seecolor.mapping.track.bundle_kernels import (
    frame_rows,
    keep_points,
    own_errors,
    point_blocks,
    point_steps,
    robust_cost,
)
from stereo_seecolor.mapping.track.frame_blocks import SIDE, FrameBlocks, Layout, TrackObservations
from stereo_seecolor.mapping.track.loops import CAUCHY, Prior
from stereo_seecolor.mapping.track.relative_pose import cross

# Knowledge of points in the world: the distance between means of points, and the position of such
# a mean.

Array = NDArray[np.float64]


@dataclass(frozen=True)
class KnownLength:
    """The distance between the mean of some points and that of others, by their numbers; meters,
    with its standard error.
    """

    first: tuple[int, ...]
    second: tuple[int, ...]
    length_m: float
    std_m: float

    @property
    def points(self) -> tuple[int, ...]:
        """All points of both means."""
        return self.first + self.second

    def off(self, places: Array) -> tuple[Array, Array]:
        """Compute the error of the length between ``points`` at places (k, 3), (1,) in standard
        errors, and its slope (1, 3 k).
        """
        count = len(self.first)
        apart = places[:count].mean(axis=0) - places[count:].mean(axis=0)
        length = float(np.linalg.norm(apart))
        shares = np.repeat([1 / count, -1 / (len(places) - count)], [count, len(places) - count])
        return np.array([(self.length_m - length) / self.std_m]), np.kron(shares, apart / length)[
            None
        ] / self.std_m


@dataclass(frozen=True, eq=False)
class KnownPlace:
    """The position of the mean of some points: (3,) meters in the world, with the standard error of
    each axis.
    """

    points: tuple[int, ...]
    place_m: Array
    std_m: float

    def off(self, places: Array) -> tuple[Array, Array]:
        """Compute the error of the mean of ``points`` at places (k, 3), (3,) in standard errors,
        and the mean's slope (3, 3 k).
        """
        slope = np.tile(np.eye(3) / len(places), len(places))
        return (self.place_m - places.mean(axis=0)) / self.std_m, slope / self.std_m


Known = KnownLength | KnownPlace


Integers = NDArray[np.int64]
Result = TypeVar("Result")
LEAST_LEFT = 0.05
"""Of a residual's variance; where the point took more, nothing is learned from it."""
POINTS_AT_ONCE = 4096
"""A core's share of points or of observations, 1 ms of work; sums over shares are the same on any
number of cores.
"""
BLOCKS_AT_ONCE = 4
"""A core's share of frames."""


@dataclass(frozen=True, eq=False)
class State:
    """Poses T: (N, 4, 4) world from camera, and points: (m, 3) in the world."""

    T: Array
    points: Array


@dataclass(frozen=True, eq=False)
class Linearized:
    """Equations of the frames' moves and of points with a block of their own. W: (n, 3, 6), V: (m,
    3, 3), own_g: (m, 3), by which the other points follow.
    """

    blocks: FrameBlocks
    W: Array
    V: Array
    own_g: Array


@dataclass(frozen=True, eq=False)
class BundleProblem:
    """Observations, priors of poses, and knowledge of points.

    frames: (N,) those that take part, by ascending number; all else is by position among them.
    point, frame: (n,) sorted by point.
    seen, weight: (n, 3) what was seen in image space, and inverse standard errors. priors: of
    poses. known: of points.
    """

    frames: Integers
    point: Integers
    frame: Integers
    seen: Array
    weight: Array
    priors: Sequence[Prior]
    known: Sequence[Known]

    @classmethod
    def of(
        cls, observations: TrackObservations, priors: Sequence[Prior], known: Sequence[Known]
    ) -> "BundleProblem":
        """Set up the problem from observations with their stated errors."""
        order = np.argsort(observations.point, kind="stable")
        frames = np.union1d(
            observations.frame, np.array([prior.frame for prior in priors], np.int64)
        ).astype(np.int64)
        frame, seen = (
            np.searchsorted(frames, observations.frame[order]),
            observations.seen.chosen(order),
        )
        own = [replace(prior, frame=int(np.searchsorted(frames, prior.frame))) for prior in priors]
        return cls(frames, observations.point[order], frame, seen.points, 1 / seen.std, own, known)

    def scaled(self, directions: float, depths: float) -> "BundleProblem":
        """Scale the errors of directions and of inverse depths by these factors."""
        return replace(self, weight=self.weight / [directions, directions, depths])

    def first_places(self, T: Array) -> Array:
        """Compute the mean position of each point over its observations: (m, 3)."""
        local = np.column_stack([self.seen[:, :2], np.ones(len(self.seen))]) / self.seen[:, 2:]
        world = np.einsum("nij,nj->ni", T[self.frame, :3, :3], local) + T[self.frame, :3, 3]
        sums = np.stack([np.bincount(self.point, column) for column in world.T], axis=-1)
        return np.asarray(sums / np.diff(self.start)[:, None])

    def cost(self, state: State) -> float:
        """Compute half of the sum of squares, those of observations under a Cauchy kernel."""
        seen = (
            inverse(state.T),
            state.points,
            self.frame,
            self.point,
            self.seen,
            self.weight,
            CAUCHY,
        )
        observations = sum(_shared(lambda *part: robust_cost(*seen, *part), len(self.frame)))
        rest = [_prior_off(prior, state.T[prior.frame])[0] for prior in self.priors]
        rest += [known.off(state.points[list(known.points)])[0] for known in self.known]
        return observations + 0.5 * sum(float(off @ off) for off in rest)

    def errors(self, state: State) -> Array:
        """Compute residuals in standard errors, (n, 3), as large as if no point's position had been
        fitted to them.
        """
        found = np.empty_like(self.seen)
        seen = (
            inverse(state.T),
            state.points,
            self.start,
            self.frame,
            self.seen,
            self.weight,
            LEAST_LEFT,
            found,
        )
        _shared(lambda *part: own_errors(*seen, *part), len(state.points))
        return found

    def linearized(self, state: State, damping: float = 0.0) -> Linearized:
        """Set up the equations of a step. damping: by which the diagonal is larger (Marquardt)."""
        layout, blocks, m = self._layout, self._layout.zeros(), len(state.points)
        found = Linearized(
            blocks, np.empty((len(self.frame), 3, SIDE)), np.empty((m, 3, 3)), np.empty((m, 3))
        )
        seen = inverse(state.T), state.points, self.start, self.frame
        how: tuple[Any, ...] = (
            self.seen,
            self.weight,
            CAUCHY,
            damping,
            self._own >= 0,
            found.W,
            found.V,
            found.own_g,
        )
        _shared(lambda *part: point_blocks(*seen, *how, *part), m)
        place, where = (
            layout.place[: len(self.frames)],
            (layout.size, blocks.diagonal, blocks.below, blocks.g),
        )
        rows: tuple[Any, ...] = *seen, self.point, *how, place, *self._by_block, *where
        _shared(lambda *part: frame_rows(*rows, *part), len(layout.place), BLOCKS_AT_ONCE)
        kept = np.flatnonzero(self._own >= 0)
        own_place = layout.place[self._own[kept]]
        keep_points(
            kept, own_place, self.start, self.frame, found.W, found.V, found.own_g, place, *where
        )
        self._add_priors(blocks, state)
        self._add_known(blocks, state)
        return found

    def moved(self, state: State, step: Linearized) -> State:
        """Move poses and points by the solution of the equations. Raises LinAlgError where they are
        singular.
        """
        moves, points = step.blocks.solve(), np.empty_like(state.points)
        of_frames = np.ascontiguousarray(moves[: len(self.frames)])
        seen = self.start, self.frame, step.W, step.V, step.own_g, of_frames, points
        _shared(lambda *part: point_steps(*seen, *part), len(points))
        kept = np.flatnonzero(self._own >= 0)
        points[kept] = moves[self._own[kept], :3]
        by = np.zeros_like(state.T)
        by[:, :3, :3], by[:, :3, 3], by[:, 3, 3] = (
            rotation_from_vector(of_frames[:, :3]),
            of_frames[:, 3:],
            1,
        )
        return State(state.T @ by, state.points + points)

    @cached_property
    def start(self) -> Integers:
        """Where each point's observations begin: (m + 1,)."""
        return np.searchsorted(self.point, np.arange(int(self.point[-1]) + 2)).astype(np.int64)

    @cached_property
    def _own(self) -> Integers:
        """(m,) the block of a point of which something is known, after those of the frames; -1 for
        all others.
        """
        own = np.full(len(self.start) - 1, -1)
        points = sorted({point for known in self.known for point in known.points})
        own[points] = np.arange(len(self.frames), len(self.frames) + len(points))
        return own

    @cached_property
    def _layout(self) -> Layout:
        """Of blocks that share points, or are themselves points of which something is known."""
        kept = np.flatnonzero(self._own >= 0)
        several = [
            (point, len(self._own) + k)
            for k, known in enumerate(self.known)
            for point in known.points
        ]
        points, groups = np.array(several, np.int64).reshape(-1, 2).T
        blocks = np.concatenate([self.frame, self._own[kept], self._own[points]])
        columns = np.concatenate([self.point, kept, groups])
        shape = len(self.frames) + len(kept), len(self._own) + len(self.known)
        together = csr_array((np.ones(len(blocks), np.int32), (blocks, columns)), shape=shape)
        return Layout.of(csr_array(together @ together.T))

    @cached_property
    def _by_block(self) -> tuple[Integers, Integers]:
        """(n,) observations by the place of their frame's block, and (blocks + 1,) where each
        block's begin.
        """
        place = self._layout.place[self.frame]
        order = np.argsort(place, kind="stable")
        return order, np.searchsorted(place[order], np.arange(len(self._layout.place) + 1)).astype(
            np.int64
        )

    def _add_priors(self, blocks: FrameBlocks, state: State) -> None:
        for prior in self.priors:
            off, slope = _prior_off(prior, state.T[prior.frame])
            blocks.add(prior.frame, prior.frame, slope.T @ slope)
            blocks.add_right(prior.frame, slope.T @ off)

    def _add_known(self, blocks: FrameBlocks, state: State) -> None:
        for known in self.known:
            off, slopes = known.off(state.points[list(known.points)])
            slope = np.zeros((len(off), SIDE, len(known.points)))
            slope[:, :3] = slopes.reshape(len(off), -1, 3).swapaxes(1, 2)
            own = self._own[list(known.points)].tolist()
            for a, first in enumerate(own):
                blocks.add_right(first, slope[:, :, a].T @ off)
                for b, second in enumerate(own[: a + 1]):
                    blocks.add(first, second, slope[:, :, a].T @ slope[:, :, b])


def _shared(
    work: Callable[[int, int], Result], count: int, at_once: int = POINTS_AT_ONCE
) -> list[Result]:
    """``work`` of each range of so many things, its first and its end, on all cores; results in
    order.
    """
    return list(
        core_pool().map(
            lambda first: work(first, min(first + at_once, count)), range(0, count, at_once)
        )
    )


def _prior_off(prior: Prior, T: Array) -> tuple[Array, Array]:
    """(6,) from a pose to what navigation says of it, turn and place, in standard errors; the
    pose's slope (6, 6).
    """
    given, R = prior.T_world_camera, T[:3, :3]
    turn, slope = rotation_vector(given[:3, :3].T @ R), np.zeros((SIDE, SIDE))
    slope[:3, :3] = (np.eye(3) + 0.5 * cross(turn[None])[0]) / prior.attitude_std_rad
    slope[3:, 3:] = R / prior.position_std_m[:, None]
    return np.concatenate(
        [-turn / prior.attitude_std_rad, (given[:3, 3] - T[:3, 3]) / prior.position_std_m]
    ), slope
