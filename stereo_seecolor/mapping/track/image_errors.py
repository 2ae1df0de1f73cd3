"""Errors that all frames have at the same place of the image: what calibration left of the lens,
estimated from the dive itself.

A flow field that is off by a few tenths of a pixel at the image's borders looks like a turn, and a
turn is taken for a part of the shift: the track bends a little with each frame, and comes out short
or long by a percent (Kreso and Segvic 2015 found the same on street stereo). What moves with the
scene is motion; what stays where it is in the image is the camera's.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from calibration.geometry import RectifiedPair
from calibration.transforms import rigid_transform, rotation_from_vector
from stereo_seecolor.mapping.track.features import Features
from stereo_seecolor.mapping.track.image_space import Observed, from_plane, move
from stereo_seecolor.mapping.track.relative_pose import SETTINGS as POSE
from stereo_seecolor.mapping.track.relative_pose import inverse_covariance, pulled
from stereo_seecolor.records import Array
from stereo_seecolor.sharpness import EQUALLY_SHARP, LessSharpSide

TERMS = 11
"""The first: the fraction by which relief is flattened. Ten of the lens: a radial term, three
square ones of the disparity (x x, x y, y y), a second radial term, four cubic ones of the
disparity, as two lenses that are off differently leave them, and one of the fourth order. Not the
disparity's mean, which is the scale, nor its slopes and the lens's tangential terms, which look
like a turn of the camera's axes.

A matcher flattens relief that one side shows less sharply. Without a term of its own that looks
like a lens that is off, and makes the track too long.
"""
NONE, RELIEF = slice(0, 0), slice(0, 1)
LAST = (TERMS, 5)
"""Where the terms end that are tried, the more first."""


@dataclass(frozen=True)
class ImageErrorSettings:
    """When errors of the image are estimated, and when they are used."""

    # pairs of frames: fewer views of the same places in other parts of the image tell nothing
    min_pairs: int = 10
    max_pairs: int = 60  # spread over the dive: more tell no more
    max_points: int = 1000  # of a pair
    rounds: int = 6  # of Gauss-Newton; it takes 2 to 4
    tolerance: float = 1e-4  # of the cost, when to stop: far below what decides
    # standard deviation of each term at the image's corner before anything is seen: of a calibrated
    # rig
    prior_px: float = 1.0
    prior_relief: float = 0.1  # the same of flattened relief: it was up to 0.17 on synthetic dives
    # points whose mean is a point's relief: of one alone, noise hides what is flattened
    relief_points: int = 16
    # of the cost of pairs left out of the fit, at most this must be left: 0.999 is, of a perfect
    # lens
    better: float = 0.995
    # standard deviation at the image's corner of each ramp and bend of the disparity that matching
    # leaves: without them the errors of twelve synthetic tracks were 1.8 times as large as stated
    disparity_px: float = 0.02


SETTINGS = ImageErrorSettings()


@dataclass(frozen=True, eq=False)
class FramePair:
    """Two frames' views of the same n points, and T_a_b (4, 4), p_a = T_a_b p_b."""

    T_a_b: Array
    a: Observed
    b: Observed


@dataclass(frozen=True, eq=False)
class ImageErrors:
    """Estimated errors of the image. values: (TERMS,) a fraction of the relief, then pixels at the
    image's corner.
    """

    values: Array
    geometry: RectifiedPair

    def corrected(self, features: Features) -> Features:
        """Features without the errors."""
        off = _field(features.points, self.geometry) @ self.values
        return replace(features, points=features.points - off, near=features.near - off[:, 2])


def find_image_errors(
    pairs: Sequence[FramePair], geometry: RectifiedPair, less_sharp: LessSharpSide = EQUALLY_SHARP
) -> ImageErrors | None:
    """The errors that explain best what all pairs have in common; None where pairs left out of the
    fit confirm none.

    A lens is off where that explains more in addition to flattened relief than this does alone.
    Where a side is blurred, relief is flattened for sure, and a lens takes more evidence: what is
    flattened and no term describes looks like one. Of 54 synthetic dives with a perfect lens it
    explained up to 0.3, 1.5 and 2.9 % with a blur of 1, 2 and 3 px; 0.8, 2.2 and 5.2 % are asked.
    """
    better = 1 - (1 - SETTINGS.better) / less_sharp.contrast**2
    if len(pairs) < SETTINGS.min_pairs:
        return None
    some = [
        _WeighedPair.of(pair, geometry) for pair in pairs[:: -(-len(pairs) // SETTINGS.max_pairs)]
    ]
    none, relief = _left_out(some, NONE), _left_out(some, RELIEF)
    flattened = less_sharp.is_blurred or bool((relief <= SETTINGS.better * none).all())
    used = RELIEF if flattened else NONE
    for last in LAST:
        both = _left_out(some, slice(0, last))
        if (both <= np.minimum(better, relief / none) * relief).all():
            used = slice(0 if flattened else RELIEF.stop, last)
            break
    return None if used == NONE else ImageErrors(_solve(some, np.zeros(TERMS), used)[0], geometry)


def _left_out(pairs: "Sequence[_WeighedPair]", free: slice) -> Array:
    """(2,) the cost of each half of the pairs with the errors that are fitted to the other half."""
    halves = pairs[::2], pairs[1::2]
    fitted = [_solve(half, np.zeros(TERMS), free)[0] for half in halves]
    return np.array([_solve(halves[1 - k], fitted[k], NONE)[1] for k in range(2)])


def _solve(pairs: "Sequence[_WeighedPair]", values: Array, free: slice) -> tuple[Array, float]:
    """Gauss-Newton over the values that are free, and each pair's pose; the values, and the robust
    cost of a point.
    """
    values = values.copy()
    prior = np.full(TERMS, SETTINGS.prior_px**-2)
    prior[RELIEF] = SETTINGS.prior_relief**-2
    poses = [pair.T_a_b for pair in pairs]
    cost = np.inf
    for _ in range(SETTINGS.rounds):
        H, g = np.diag(prior[free]), -(values * prior)[free]
        normals = [_normal(pair, T, values, free) for pair, T in zip(pairs, poses, strict=True)]
        before, cost = cost, sum(own_cost for *_, own_cost in normals)
        if before - cost < SETTINGS.tolerance * cost:
            break
        for own, right, _ in normals:
            pose, mixed = own[:6, :6], own[:6, 6:]
            H += own[6:, 6:] - mixed.T @ np.linalg.solve(pose, mixed)
            g += right[6:] - mixed.T @ np.linalg.solve(pose, right[:6])
        step = np.linalg.solve(H, g)
        values[free] += step
        for number, (own, right, _) in enumerate(normals):
            by = np.linalg.solve(own[:6, :6], right[:6] - own[:6, 6:] @ step).astype(np.float64)
            poses[number] = poses[number] @ rigid_transform(rotation_from_vector(by[:3]), by[3:])
    return values, cost / sum(len(pair.a) for pair in pairs)


@dataclass(frozen=True, eq=False)
class _WeighedPair:
    """Two frames' views a, b: (n, 3), the fields (n, 3, k) of all terms there, T_a_b, and the
    weight (n, 3, 3) of their difference.

    Weights stay as they are at first: else a longer track, which makes differences less certain,
    seems to fit better.
    """

    T_a_b: Array
    a: Array
    b: Array
    field_a: Array
    field_b: Array
    weight: Array

    @classmethod
    def of(cls, pair: FramePair, geometry: RectifiedPair) -> "_WeighedPair":
        """Of two frames' views, as many of their points as tell."""
        every = slice(None, None, -(-len(pair.a.points) // SETTINGS.max_points))
        a, b = pair.a.chosen(every), pair.b.chosen(every)
        weight = inverse_covariance(move(pair.T_a_b, b.points), a, b)
        fields = _field(a.points, geometry), _field(b.points, geometry)
        return cls(pair.T_a_b, a.points, b.points, *fields, weight)


def _normal(pair: _WeighedPair, T: Array, values: Array, free: slice) -> tuple[Array, Array, float]:
    """Normal equations of a pair's pose (6) and of the shared values, and its robust cost."""
    moved = move(T, pair.b - pair.field_b @ values)
    pull, squared = pulled(pair.weight, pair.a - pair.field_a @ values - moved.points)
    ratio = squared / POSE.outlier_sigmas**2
    robust = 1 / (1 + ratio)
    by_values = pair.field_a[:, :, free] - moved.by_point @ pair.field_b[:, :, free]
    slope = np.concatenate([moved.by_pose, by_values], axis=2)
    weighted, both = (robust[:, None, None] * pair.weight) @ slope, slope.shape[2]
    rows = slope.reshape(-1, both).T
    H, g = rows @ weighted.reshape(-1, both), rows @ (robust[:, None] * pull).ravel()
    return H, g, float(np.log1p(ratio).sum())


def _field(points: Array, geometry: RectifiedPair) -> Array:
    """(n, 3, TERMS) error of points (n, 3) in image space by each term: where all relief is gone,
    and for a pixel at the image's corner.
    """
    x, y = _from_corner(points, geometry)
    square = x * x + y * y
    radial = [(x * square, y * square), (x * square**2, y * square**2)]
    depth = [x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3, square**2]
    found = np.zeros((len(points), 3, TERMS))
    found[:, 2, 0] = -_wide_relief(points)
    found[:, :2, 1], found[:, :2, 5] = (
        np.stack(term, axis=1) / geometry.focal_px for term in radial
    )
    found[:, 2, [2, 3, 4, 6, 7, 8, 9, 10]] = np.stack(depth, axis=1) / (
        geometry.focal_px * geometry.baseline_m
    )
    return found


def _from_corner(points: Array, geometry: RectifiedPair) -> Array:
    """(2, n) directions of points in image space, 1 at the image's corner."""
    corner = float(np.hypot(*geometry.image_size)) / 2 / geometry.focal_px
    return np.asarray(points[:, :2].T / corner)


def _wide_relief(points: Array) -> Array:
    """(n,) relief of points (n, 3) in image space, a mean over each point's neighbors."""
    if not len(points):
        return np.zeros(0)
    near = np.arange(1, min(SETTINGS.relief_points, len(points)) + 1)
    return np.asarray(
        from_plane(points)[cKDTree(points[:, :2]).query(points[:, :2], near)[1]].mean(1)
    )


def disparity_errors(points: Array, geometry: RectifiedPair) -> Iterator[Array]:
    """Ramps (x, y) and bends (x x, x y, y y) of the disparity that all frames share, each as large
    as its standard deviation.

    Ramps look like a turn of the camera, so that no dive shows them, and a track bends by them: by
    those that matching leaves, and by those of a refined rig.

    Yields:
        Five errors of the inverse depths of points (n, 3) in image space, each (n,), 1/m.
    """
    corner_px = float(np.hypot(*geometry.image_size)) / 2
    x, y = _from_corner(points, geometry)
    ramps_px = np.hypot(SETTINGS.disparity_px, corner_px * np.array(geometry.slope_std))
    x_px, y_px = ramps_px[::-1] if geometry.quarter_turns % 2 else ramps_px
    bend_px = SETTINGS.disparity_px
    for std_px, error in (
        (x_px, x),
        (y_px, y),
        (bend_px, x * x),
        (bend_px, x * y),
        (bend_px, y * y),
    ):
        yield std_px / (geometry.focal_px * geometry.baseline_m) * error
