"""Measures from picked points: length along a line, and area inside it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from calibration import RectifiedPair
from stereo_seecolor.extras.reef.measure_limits import LIMITS
from stereo_seecolor.extras.reef.picking import FrameSurface, Pick, PickedPoint
from stereo_seecolor.extras.reef.polygons import inside, polygon_area
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class Measured:
    """A value in meters or square meters, NaN where the surface is unknown.

    std: its standard error by range and click. power: with which power of lengths it grows, and so
    how much of the calibration's error, which all measures of a dive share, it takes: 1 for a
    length, 2 for an area, 0 for a height.
    """

    value: float
    std: float
    power: int

    def total_std(self, calibration_std: float) -> float:
        """Standard error by all together. calibration_std: of a length, relative."""
        return float(np.hypot(self.std, self.power * calibration_std * self.value))


UNKNOWN = Measured(float("nan"), float("nan"), 2)


def range_of(pick: Pick) -> Measured:
    """The distance along the ray, with the error of the click."""
    ray = pick.point_m / pick.range_m
    return Measured(pick.range_m, float(np.sqrt(ray @ pick.covariance @ ray)), 1)


def straight_length(picks: Sequence[PickedPoint]) -> Measured:
    """Length of the straight lines through points; each inner point moves both lines that it
    joins. Errors across a line count to second order, which is all of them where they are across.
    """
    points = np.array([pick.point_m for pick in picks])
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    units = np.divide(steps, lengths[:, None], out=np.zeros_like(steps), where=lengths[:, None] > 0)
    pulls = np.vstack([units, np.zeros((1, 3))]) - np.vstack([np.zeros((1, 3)), units])
    variance = sum(
        float(pull @ pick.covariance @ pull) for pull, pick in zip(pulls, picks, strict=True)
    )
    squares = [
        _squared(a.covariance + b.covariance, unit, float(line_m))
        for a, b, unit, line_m in zip(picks[:-1], picks[1:], units, lengths, strict=True)
    ]
    variance += 0.5 * sum(squares) + (LIMITS.of_squares**2 - 0.5) * max(squares, default=0.0)
    length_m = float(lengths.sum())
    return Measured(length_m, float(np.sqrt(variance)), 1)


def _squared(covariance: Array, unit: Array, size: float) -> float:
    """Twice the variance that errors (covariance) of a vector of a size add to that size where they
    lie across it, which count squared over twice the size. Of the largest of several ``of_squares``
    counts, since squares of errors have long tails; those of a sum of many are short.
    """
    across = np.eye(3) - np.outer(unit, unit)
    spread = across @ covariance @ across
    most = max(size**2, float(np.trace(spread)))
    return float((spread**2).sum()) / most if most > 0 else 0.0


def length_along(line: Sequence[PickedPoint]) -> Measured:
    """Length of a line of points on a surface, each joined to the next.

    Where the surface at neither of two points leads to the other, by more than a gap, the part
    between them crosses a step, whose sides are not seen: its standard error carries a part of the
    step.
    """
    straight = straight_length(line)
    steps_m = [
        off_m
        for a, b in pairwise(line)
        if (off_m := min(a.off_m(b), b.off_m(a))) > max(a.gap_m, b.gap_m)
    ]
    return replace(
        straight, std=float(np.hypot(straight.std, LIMITS.of_step * np.linalg.norm(steps_m)))
    )


def along_surface(surface: FrameSurface, picks: Sequence[Pick]) -> list[Pick]:
    """Points of the surface along the lines between picked ones, far enough apart that noise does
    not lengthen the way.
    """
    line = [picks[0]]
    for a, b in pairwise(picks):
        count = max(1, int(np.hypot(b.x_px - a.x_px, b.y_px - a.y_px) / _step_px(surface, a, b)))
        for i in range(1, count):
            x_px, y_px = (
                a.x_px + (b.x_px - a.x_px) * i / count,
                a.y_px + (b.y_px - a.y_px) * i / count,
            )
            if (pick := surface.pick(x_px, y_px, 0.0)) is not None:
                line.append(pick)
        line.append(b)
    return line


def _step_px(surface: FrameSurface, a: Pick, b: Pick) -> float:
    noise_m = max(a.pixel_std_m, b.pixel_std_m)
    pixel_m = max(min(a.point_m[2], b.point_m[2]) / surface.geometry.focal_px, 1e-9)
    return max(float(LIMITS.least_step_px), LIMITS.step_stds * noise_m / float(pixel_m))


def planar_area(picks: Sequence[PickedPoint]) -> Measured:
    """Area of the polygon through points, seen along its mean normal (Newell's sum of cross
    products). Errors along the normal count to second order.
    """
    points = np.array([pick.point_m for pick in picks])
    center = points.mean(axis=0)
    edges = points - center
    vector = 0.5 * np.cross(edges, np.roll(edges, -1, axis=0)).sum(axis=0)
    area_m2 = float(np.linalg.norm(vector))
    if area_m2 == 0:
        return Measured(0.0, float("nan"), 2)
    unit = vector / area_m2
    chords = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    # (N, 3, 3) by how much of the vector each corner's shift changes
    turns = 0.5 * np.cross(np.eye(3)[None], chords[:, None]).swapaxes(1, 2)
    covariance = np.sum(
        [turn @ pick.covariance @ turn.T for turn, pick in zip(turns, picks, strict=True)], axis=0
    )
    variance = float(unit @ covariance @ unit) + LIMITS.of_squares**2 * _squared(
        covariance, unit, area_m2
    )
    return Measured(area_m2, float(np.sqrt(variance)), 2)


def surface_area(surface: FrameSurface, picks: Sequence[Pick]) -> tuple[Measured, float]:
    """Area of the surface inside the outline of points, and the fraction of it that is known; what
    is not, counts as the rest.

    It is the mean area that a pixel sees, at nodes inside the outline, times the outline's area in
    pixels. The area that a pixel sees is depth^3 |k| / focal^2, where 1 / depth = k . (x / z, y /
    z, 1) is the fitted plane; what errors of the plane's slopes add on average is taken off.
    """
    outline = np.array([(pick.x_px, pick.y_px) for pick in picks])
    nodes = _nodes(surface, outline)
    if not nodes.areas_m2.size:
        return UNKNOWN, 0.0
    planar = planar_area(picks)
    by_outline = planar.std / planar.value if planar.value > 0 else float("nan")
    area_m2 = float(nodes.areas_m2.mean()) * polygon_area(outline)
    relative = np.linalg.norm(
        [by_outline, nodes.relative_std, unseen_std(nodes.areas_m2, nodes.known)]
    )
    return Measured(area_m2, area_m2 * float(relative), 2), nodes.known


def known_area(
    surface: FrameSurface, places: Sequence[tuple[float, float]]
) -> tuple[Measured, float]:
    """Area of the part of an outline in which the surface is known, and the fraction that it is;
    for corners that are not known.
    """
    outline = np.array(places)
    nodes = _nodes(surface, outline)
    if not nodes.areas_m2.size:
        return UNKNOWN, 0.0
    area_m2 = float(nodes.areas_m2.mean()) * polygon_area(outline) * nodes.known
    around_px = float(np.hypot(*(outline - np.roll(outline, 1, axis=0)).T).sum())
    border_px = LIMITS.area_step_px / 2  # to which the edge of what is known is found
    border = border_px * around_px / np.sqrt(len(outline)) / (polygon_area(outline) * nodes.known)
    return Measured(area_m2, area_m2 * float(np.hypot(border, nodes.relative_std)), 2), nodes.known


def unseen_std(values: Array, known: float) -> float:
    """Relative standard error of a mean of values (N,), all positive, of which a part was not seen.

    The mean of that part may differ from the rest's by the standard deviation of the seen.
    """
    return float((1 - known) * values.std() / values.mean())


@dataclass(frozen=True, eq=False)
class _Nodes:
    """areas_m2: (n,) what a pixel sees, at nodes inside an outline that are known. known: fraction
    of the nodes that are.

    relative_std: of their mean, by the errors of ranges and slopes.
    """

    areas_m2: Array
    known: float
    relative_std: float


def _nodes(surface: FrameSurface, outline: Array) -> _Nodes:
    step = LIMITS.area_step_px
    low, high = np.ceil(outline.min(axis=0) / step) * step, outline.max(axis=0)
    x, y = np.meshgrid(*(np.arange(low[k], high[k] + 1e-9, step) for k in (0, 1)))
    places = np.column_stack([x.ravel(), y.ravel()])
    places = places[inside(places, outline)]
    picks = [pick for place in places if (pick := surface.pick(*place)) is not None]
    if not picks:
        return _Nodes(np.zeros(0), 0.0, float("nan"))
    area_m2, added_m2 = np.array([_pixel_area_m2(pick, surface.geometry) for pick in picks]).T
    relative, known = sum(pick.range_std_m / pick.range_m for pick in picks), len(picks)
    independent = max(1.0, known * step**2 / (2 * LIMITS.half_window_px + 1) ** 2)
    by_range = 2 * relative / known / np.sqrt(independent)
    by_slopes = LIMITS.of_slopes * added_m2.mean() / area_m2.mean()
    return _Nodes(area_m2, known / len(places), float(np.hypot(by_range, by_slopes)))


def _pixel_area_m2(pick: Pick, geometry: RectifiedPair) -> tuple[float, float]:
    """The area that a pixel sees, and what errors of the slopes had added to it, to second order:
    half their variance times the second derivatives of |k| by them.
    """
    focal_px, depth_m = geometry.focal_px, float(pick.point_m[2])
    x_px, y_px = pick.x_px - geometry.cx_left_px, pick.y_px - geometry.cy_px
    by_slope = np.array([[focal_px, 0], [0, focal_px], [-x_px, -y_px]])
    k = by_slope @ pick.slope + (0, 0, 1 / depth_m)
    size = np.linalg.norm(k)
    curvature = (by_slope**2).sum() - ((by_slope.T @ k / size) ** 2).sum()
    added = 0.5 * pick.slope_std**2 * curvature / size
    scale = depth_m**3 / focal_px**2
    return float(scale * (size - added)), float(scale * added)
