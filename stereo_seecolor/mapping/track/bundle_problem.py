"""The nonlinear least-squares problem of bundle adjustment: poses and points compared with all
observations and all that is known.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csr_array

from calibration.transforms import inverse, rotation_from_vector, rotation_vector, transform_points
from stereo_seecolor.compute.threads import core_pool
from stereo_seecolor.mapping.track.frame_blocks import SIDE, FrameBlocks, Integers, Layout
from stereo_seecolor.mapping.track.image_space import cross, inverses
from stereo_seecolor.mapping.track.known_points import Known
from stereo_seecolor.mapping.track.pose_graph import CAUCHY, Prior
from stereo_seecolor.mapping.track.shared_points import TrackObservations
from stereo_seecolor.records import Array

Result = TypeVar("Result")
LEAST_LEFT = 0.05
"""Of a residual's variance; where the point took more, nothing is learned from it."""
ROWS = 32
"""Frames whose equations points are eliminated from at once: the products of their observations
take some 20 MB, those of all frames would take more than all else.
"""
SLICE = 10_000
"""Observations whose products with moves of frames or points are made at once, for the same reason.
"""
BEHIND = 1e6
"""Squared standard errors of a point behind the camera: it pulls nowhere, and no step that puts one
there looks better.
"""


@dataclass(frozen=True, eq=False)
class State:
    """Poses T: (N, 4, 4) world from camera, and points: (m, 3) in the world."""

    T: Array
    points: Array


@dataclass(frozen=True, eq=False)
class Linearized:
    """Equations of the frames' moves and of points with a block of their own.

    W: (n, 3, 6) each observation's block of point and pose; V: (m, 3, 3) inverses of the other
    points' own blocks; own_g: (m, 3) their right sides: by these they follow.
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
    seen, weight: (n, 3) what was seen in image space, and inverse standard errors. near: (n,) as
    Features have it. priors: of poses. known: of points.
    """

    frames: Integers
    point: Integers
    frame: Integers
    seen: Array
    weight: Array
    near: Array
    priors: Sequence[Prior]
    known: Sequence[Known]

    @classmethod
    def of(
        cls,
        observations: TrackObservations,
        priors: Sequence[Prior] = (),
        known: Sequence[Known] = (),
    ) -> "BundleProblem":
        """Set up the problem from observations with their stated errors; frames of these and of
        priors are their numbers. known: lengths between points, and their places.
        """
        order = np.argsort(observations.point, kind="stable")
        frames = np.union1d(
            observations.frame, np.array([prior.frame for prior in priors], np.int64)
        ).astype(np.int64)
        frame = np.searchsorted(frames, observations.frame[order])
        seen, near = observations.seen.chosen(order), observations.near[order]
        own = [replace(prior, frame=int(np.searchsorted(frames, prior.frame))) for prior in priors]
        point = observations.point[order]
        return cls(frames, point, frame, seen.points, 1 / seen.std, near, own, known)

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
        robust = self._each_frame(state, lambda one: float(np.log1p(one.squared / CAUCHY**2).sum()))
        rest = [_prior_off(prior, state.T[prior.frame])[0] for prior in self.priors]
        rest += [known.off(state.points[list(known.points)])[0] for known in self.known]
        return 0.5 * CAUCHY**2 * sum(robust) + 0.5 * sum(float(off @ off) for off in rest)

    def errors(self, state: State) -> Array:
        """Residuals in standard errors, (n, 3), as if no point had been fitted to them."""
        off, own = np.empty_like(self.seen), np.empty((len(self.seen), 3, 3))

        def weigh(one: _FrameSightings) -> None:
            by_point = one.slopes()[1]
            own[one.which] = by_point.transpose(0, 2, 1) @ by_point

        self._each_frame(state, weigh)
        V = inverses(np.add.reduceat(own, self.start[:-1]))

        def compare(one: _FrameSightings) -> None:
            by_point = one.slopes()[1]
            along = by_point @ V[self.point[one.which]]
            # the share of its variance that its point left
            left = 1 - (by_point * along).sum(axis=2)
            off[one.which] = one.off / np.sqrt(np.maximum(left, LEAST_LEFT))

        self._each_frame(state, compare)
        return off

    def linearize(self, state: State, damping: float = 0.0) -> Linearized:
        """Set up the equations of a step: points are eliminated, but for those of which something
        is known. damping: by which the diagonal is larger (Marquardt).
        """
        of_frames, W, V, g = self._of_frames(state, damping)
        blocks = self._layout.zeros()
        for frame, (H, right) in enumerate(of_frames):
            blocks.add(frame, frame, H)
            blocks.add_right(frame, right)
        kept = np.flatnonzero(self._own >= 0)
        self._add_kept(blocks, kept, W, V, g)
        V = inverses(V)
        V[kept] = 0
        self._eliminate(blocks, W, V, g)
        self._add_priors(blocks, state)
        self._add_known(blocks, state)
        return Linearized(blocks, W, V, g)

    def _of_frames(
        self, state: State, damping: float
    ) -> tuple[list[tuple[Array, Array]], Array, Array, Array]:
        """Each frame's own block (6, 6) and right side (6,); W (n, 3, 6), as in Linearized, the
        points' own blocks (m, 3, 3) and right sides (m, 3).
        """
        n, points = len(self.frame), len(self.start) - 1
        # what stays before what goes: the frames' equations take the place of that
        W, V, g = np.empty((n, 3, SIDE)), np.empty((points, 3, 3)), np.empty((points, 3))
        own, own_g = np.empty((n, 3, 3)), np.empty((n, 3))

        def work(one: _FrameSightings) -> tuple[Array, Array]:
            by_pose, by_point = one.slopes()
            robust = (1 / (1 + one.squared / CAUCHY**2))[:, None, None]
            pull = (robust * by_point).transpose(0, 2, 1)
            W[one.which], own[one.which] = pull @ by_pose, pull @ by_point
            own_g[one.which] = (pull @ one.off[:, :, None])[:, :, 0]
            rows, weighted = by_pose.reshape(-1, SIDE), (robust * by_pose).reshape(-1, SIDE)
            H = weighted.T @ rows
            H[np.diag_indices(SIDE)] *= 1 + damping
            return H, weighted.T @ one.off.ravel()

        of_frames = self._each_frame(state, work)
        np.add.reduceat(own, self.start[:-1], out=V)
        np.add.reduceat(own_g, self.start[:-1], out=g)
        V[:, range(3), range(3)] *= 1 + damping
        return of_frames, W, V, g

    def moved(self, state: State, step: Linearized) -> State:
        """Move poses and points by the solution. Raises LinAlgError for singular equations."""
        moves = step.blocks.solve()
        of_frames = np.ascontiguousarray(moves[: len(self.frames)])
        taken = np.empty((len(self.frame), 3))
        for some in self._slices():
            taken[some] = (step.W[some] @ of_frames[self.frame[some]][:, :, None])[:, :, 0]
        left = step.own_g - np.add.reduceat(taken, self.start[:-1])
        points = (step.V @ left[:, :, None])[:, :, 0]
        kept = np.flatnonzero(self._own >= 0)
        points[kept] = moves[self._own[kept], :3]
        by = np.zeros_like(state.T)
        by[:, :3, :3] = rotation_from_vector(of_frames[:, :3])
        by[:, :3, 3] = of_frames[:, 3:]
        by[:, 3, 3] = 1
        return State(state.T @ by, state.points + points)

    def moves_by(self, state: State, step: Linearized, error: Array) -> Array:
        """Compute how far frames move, (N, 6), where inverse depths are off by ``error`` (n,), 1/m.
        step: linearized there. Raises LinAlgError where the equations are singular.
        """
        right, own = np.zeros((self._layout.place.size, SIDE)), np.empty((len(self.frame), 3))

        def work(one: _FrameSightings) -> None:
            by_pose, by_point = one.slopes()
            off = one.weight[:, 2] * error[one.which] / (1 + one.squared / CAUCHY**2)
            right[one.frame] = off @ by_pose[:, 2]
            own[one.which] = off[:, None] * by_point[:, 2]

        self._each_frame(state, work)
        own_g = np.add.reduceat(own, self.start[:-1])
        points = step.V @ own_g[:, :, None]
        for some in self._slices():
            taken = step.W[some].transpose(0, 2, 1) @ points[self.point[some]]
            np.subtract.at(right, self.frame[some], taken[:, :, 0])
        kept = np.flatnonzero(self._own >= 0)
        right[self._own[kept], :3] = own_g[kept]
        return step.blocks.solve_for(right)[: len(self.frames)]

    def _slices(self) -> Iterator[slice]:
        """Observations, SLICE at a time."""
        return (slice(first, first + SLICE) for first in range(0, len(self.frame), SLICE))

    def _each_frame(
        self, state: State, work: "Callable[[_FrameSightings], Result]"
    ) -> list[Result]:
        """``work`` of each frame's observations, on all cores; results in order."""
        order, row_start = self._by_block

        def of(frame: int, T: Array) -> Result:
            row = self._layout.place[frame]
            which = order[row_start[row] : row_start[row + 1]]
            at = transform_points(T, state.points[self.point[which]])
            ahead = at[:, 2] > 0
            depth = np.where(ahead, at[:, 2], 1.0)[:, None]
            image = np.concatenate([at[:, :2], np.ones_like(depth)], axis=1) / depth
            weight = self.weight[which]
            off = ahead[:, None] * (self.seen[which] - image) * weight
            squared = np.where(ahead, (off**2).sum(axis=1), BEHIND)
            return work(_FrameSightings(frame, which, T[:3, :3], at, ahead, weight, off, squared))

        return list(core_pool().map(of, range(len(state.T)), inverse(state.T)))

    def _eliminate(self, blocks: FrameBlocks, W: Array, V: Array, own_g: Array) -> None:
        """Take the points' Schur complement off the frames' equations, some rows at a time."""
        order, row_start = self._by_block
        points = 3 * len(V)
        from_points = bsr_array(
            (W, self._layout.place[self.frame], self.start),
            shape=(points, SIDE * len(self._layout.place)),
        )
        for first in range(0, len(self._layout.place), ROWS):
            start = row_start[first : first + ROWS + 1]
            which = order[start[0] : start[-1]]
            Y = (V[self.point[which]] @ W[which]).transpose(0, 2, 1)
            to_points = bsr_array(
                (Y, self.point[which], start - start[0]), shape=(SIDE * (len(start) - 1), points)
            )
            blocks.subtract(first, to_points @ from_points, to_points @ own_g.ravel())

    def _add_kept(
        self, blocks: FrameBlocks, kept: Integers, W: Array, V: Array, own_g: Array
    ) -> None:
        """The equations of points that stay: the first three numbers of their blocks."""
        for p in kept.tolist():
            own, H, g = int(self._own[p]), np.zeros((SIDE, SIDE)), np.zeros(SIDE)
            H[:3, :3], g[:3] = V[p], own_g[p]
            blocks.add(own, own, H)
            blocks.add_right(own, g)
            for k in range(self.start[p], self.start[p + 1]):
                H = np.zeros((SIDE, SIDE))
                H[:3] = W[k]
                blocks.add(own, int(self.frame[k]), H)

    @cached_property
    def start(self) -> Integers:
        """Where each point's observations begin: (m + 1,)."""
        return np.searchsorted(self.point, np.arange(int(self.point[-1]) + 2)).astype(np.int64)

    @cached_property
    def _own(self) -> Integers:
        """(m,) the block of a point of which something is known, after the frames'; else -1."""
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
        """(n,) observations by their frame's block, and (blocks + 1,) where each begins."""
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


class _FrameSightings(NamedTuple):
    """The observations of one frame, compared with their points.

    which: (k,) their numbers. R: (3, 3) camera from world. at: (k, 3) the points in the camera.
    ahead: (k,) whether they lie in front of it. weight: (k, 3) inverse standard errors. off: (k, 3)
    residuals in image space, in standard errors; squared: (k,) their squares.
    """

    frame: int
    which: Integers
    R: Array
    at: Array
    ahead: NDArray[np.bool_]
    weight: Array
    off: Array
    squared: Array

    def slopes(self) -> tuple[Array, Array]:
        """Derivatives of what should be seen, in standard errors: by a turn (rad) and then a shift
        (m) of the pose in its own axes, (k, 3, 6), and by the point in the world, (k, 3, 3). 0 of
        points behind the camera.
        """
        inverse = self.ahead / np.where(self.ahead, self.at[:, 2], 1.0)
        slope = np.zeros((len(self.at), 3, 3))  # by the point in the camera
        slope[:, 0, 0] = slope[:, 1, 1] = inverse
        slope[:, :2, 2] = -self.at[:, :2] * inverse[:, None] ** 2
        slope[:, 2, 2] = -(inverse**2)
        slope *= self.weight[:, :, None]
        return np.concatenate([slope @ cross(self.at), -slope], axis=2), slope @ self.R


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
