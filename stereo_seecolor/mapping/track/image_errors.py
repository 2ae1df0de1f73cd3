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
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.geometry import pose, rotation_from_vector
from stereo_seecolor.mapping.track.features import Features
from stereo_seecolor.mapping.track.image_space import Observed, move
from stereo_seecolor.mapping.track.relative_pose import SETTINGS as POSE
from stereo_seecolor.mapping.track.relative_pose import weighed

Array = NDArray[np.float64]
MODELS = (10, 4)
"""Numbers of terms that are tried, the more first. The first four: a radial term of the lens, and
three square ones of the disparity (x x, x y, y y). The others: a second radial term, four cubic
ones of the disparity, as two lenses that are off differently leave them, and one of the fourth
order. Not the disparity's mean, which is the scale, nor its slopes and the lens's tangential terms,
which look like a turn of the camera's axes.
"""


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
    """Estimated errors of the image. values: (k,) pixels at the image's corner, the first k of
    MODELS' terms.
    """

    values: Array
    geometry: RectifiedPair

    def corrected(self, features: Features) -> Features:
        """Features without the errors."""
        off = _field(features.points, self.geometry, len(self.values)) @ self.values
        return replace(features, points=features.points - off, near=features.near - off[:, 2])


def find_image_errors(pairs: Sequence[FramePair], geometry: RectifiedPair) -> ImageErrors | None:
    """The errors that explain best what all pairs have in common; None where pairs left out of the
    fit do not confirm them.
    """
    if len(pairs) < SETTINGS.min_pairs:
        return None
    pairs = [_thinned(pair) for pair in pairs[:: -(-len(pairs) // SETTINGS.max_pairs)]]
    for terms in MODELS:
        if _confirmed(pairs, geometry, terms):
            return ImageErrors(_solve(pairs, geometry, np.zeros(terms), free=True)[0], geometry)
    return None


def _confirmed(pairs: Sequence[FramePair], geometry: RectifiedPair, terms: int) -> bool:
    """True where errors that are fitted to one half of the pairs explain the other half better than
    none, both ways.
    """
    none = np.zeros(terms)
    for fitted, left_out in ((pairs[::2], pairs[1::2]), (pairs[1::2], pairs[::2])):
        values, _ = _solve(fitted, geometry, none, free=True)
        if (
            _solve(left_out, geometry, values, free=False)[1]
            > SETTINGS.better * _solve(left_out, geometry, none, free=False)[1]
        ):
            return False
    return True


def _solve(
    pairs: Sequence[FramePair], geometry: RectifiedPair, values: Array, free: bool
) -> tuple[Array, float]:
    """Gauss-Newton over the values, if they are free, and each pair's pose; the values, and the
    robust cost of a point.
    """
    terms = len(values)
    poses = [pair.T_a_b for pair in pairs]
    fields = [
        (_field(pair.a.points, geometry, terms), _field(pair.b.points, geometry, terms))
        for pair in pairs
    ]
    cost = np.inf
    for _ in range(SETTINGS.rounds):
        H, g = np.eye(terms) / SETTINGS.prior_px**2, -values / SETTINGS.prior_px**2
        normals = [_normal(*item, values) for item in zip(pairs, fields, poses, strict=True)]
        before, cost = cost, sum(normal.cost for normal in normals)
        if before - cost < SETTINGS.tolerance * cost:
            break
        for normal in normals:
            H += normal.H_values - normal.H_mixed.T @ np.linalg.solve(normal.H_pose, normal.H_mixed)
            g += normal.g_values - normal.H_mixed.T @ np.linalg.solve(normal.H_pose, normal.g_pose)
        step = np.linalg.solve(H, g) if free else np.zeros(terms)
        values = values + step
        for number, normal in enumerate(normals):
            move_by = np.asarray(
                np.linalg.solve(normal.H_pose, normal.g_pose - normal.H_mixed @ step), np.float64
            )
            poses[number] = poses[number] @ pose(rotation_from_vector(move_by[:3]), move_by[3:])
    points = sum(len(pair.a.points) for pair in pairs)
    return values, cost / points


@dataclass(frozen=True, eq=False)
class _ImageErrorNormal:
    """Normal equations of a pair's pose (6) and of the values that all pairs share; its robust
    cost.
    """

    H_pose: Array
    H_mixed: Array
    H_values: Array
    g_pose: Array
    g_values: Array
    cost: float


def _normal(
    pair: FramePair, fields: tuple[Array, Array], T: Array, values: Array
) -> _ImageErrorNormal:
    field_a, field_b = fields
    moved = move(T, pair.b.points - field_b @ values)
    seen = Observed(pair.a.points - field_a @ values, pair.a.std)
    weight, pull, squared = weighed(moved, seen, pair.b)
    ratio = squared / POSE.outlier_sigmas**2
    robust = 1 / (1 + ratio)
    slope = np.concatenate([moved.by_pose, field_a - moved.by_point @ field_b], axis=2)
    weighted, both = (robust[:, None, None] * weight) @ slope, slope.shape[2]
    rows = slope.reshape(-1, both).T
    H, g = rows @ weighted.reshape(-1, both), rows @ (robust[:, None] * pull).ravel()
    return _ImageErrorNormal(
        H[:6, :6], H[:6, 6:], H[6:, 6:], g[:6], g[6:], float(np.log1p(ratio).sum())
    )


def _field(points: Array, geometry: RectifiedPair, terms: int) -> Array:
    """(n, 3, terms) error of points (n, 3) in image space by each of the first terms, for a pixel
    at the image's corner.
    """
    corner = float(np.hypot(*geometry.image_size)) / 2 / geometry.focal_px
    x, y = points[:, 0] / corner, points[:, 1] / corner
    square = x * x + y * y
    radial = [(x * square, y * square), (x * square**2, y * square**2)]
    depth = [x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3, square**2]
    found = np.zeros((len(points), 3, 2 + len(depth)))
    found[:, :2, 0], found[:, :2, 4] = (
        np.stack(term, axis=1) / geometry.focal_px for term in radial
    )
    found[:, 2, [1, 2, 3, 5, 6, 7, 8, 9]] = np.stack(depth, axis=1) / (
        geometry.focal_px * geometry.baseline_m
    )
    return found[:, :, :terms]


def disparity_errors(points: Array, geometry: RectifiedPair) -> Iterator[Array]:
    """Ramps (x, y) and bends (x x, x y, y y) of the disparity that all frames share, each as large
    as its standard deviation.

    Ramps look like a turn of the camera, so that no dive shows them, and a track bends by them.

    Yields:
        Five errors of points (n, 3) in image space, each (n, 3).
    """
    corner = float(np.hypot(*geometry.image_size)) / 2 / geometry.focal_px
    x, y = points[:, 0] / corner, points[:, 1] / corner
    inverse_m = SETTINGS.disparity_px / (geometry.focal_px * geometry.baseline_m)
    for first, second in ((x, 1.0), (y, 1.0), (x, x), (x, y), (y, y)):
        error = np.zeros_like(points)
        error[:, 2] = inverse_m * (first * second)
        yield error


def _thinned(pair: FramePair) -> FramePair:
    every = slice(None, None, -(-len(pair.a.points) // SETTINGS.max_points))
    return FramePair(pair.T_a_b, pair.a.chosen(every), pair.b.chosen(every))
