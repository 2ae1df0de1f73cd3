"""The images as views of the surface: where each shows it, and how well."""

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.geometry import transformed
from stereo_seecolor.records import Map
from stereo_seecolor.run_folder.posed_run import PosedRun
from stereo_seecolor.texture.surface import Surface


@dataclass(frozen=True)
class TextureLimits:
    """Which views of a triangle count, and how much."""

    kept: int = 6
    """Views a triangle keeps: more than overlap usefully in a survey."""
    same_range: float = 0.02
    """A view shows a place whose distance is the measured range within this fraction: else
    something stands before it.
    """
    border_px: float = 3.0
    """From the image's border, where rectification and correction have no full support."""
    corner_loss: float = 0.4
    """Of a view's value in the image's corners: lenses are less sharp and lamps weaker there."""
    color_std: float = 12.0
    """Of 255: as far as a view may be from the color of all frames together before it counts less
    (fish, particles, shadows).
    """


LIMITS = TextureLimits()


class Views:
    """The corrected images of a run; the last few are kept."""

    def __init__(self, posed: PosedRun, kept: int = 4) -> None:
        self.posed = posed
        self.image = lru_cache(kept)(self._read)

    def _read(self, number: int) -> NDArray[np.uint8]:
        """(H, W, 3). Raises InputError if it is gone or damaged."""
        return eight_bit(self.posed.frames[number].read("corrected"))

    def project(
        self, number: int, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels (..., 2), with (0, 0) in the center of the top left one, and depths (...) of
        points (..., 3) of the map.
        """
        seen = transformed(self.posed.T_camera_map[number], points.reshape(-1, 3)).reshape(
            points.shape
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = seen @ self.posed.geometry.P_left.T
            return pixels[..., :2] / pixels[..., 2:], seen[..., 2]


@dataclass(frozen=True, eq=False)
class Candidates:
    """view (F, K) int32, -1 for none; value (F, K) float32, higher is better, 0 for none."""

    view: NDArray[np.int32]
    value: NDArray[np.float32]


def candidates(views: Views, surface: Surface) -> Candidates:
    """The best views of each triangle: by pixels a meter (range and slant), sharpness, place in the
    image, and agreement in color.

    A view counts only where its measured range agrees with the surface at the triangle's center,
    and contradicts it at no corner.
    """
    corners = surface.position[surface.triangles]
    centers, tree = corners.mean(axis=1), cKDTree(corners.mean(axis=1))
    view = np.full((len(corners), LIMITS.kept), -1, np.int32)
    value = np.zeros((len(corners), LIMITS.kept), np.float32)
    for number, frame in enumerate(views.posed.frames):
        range_m = views.posed.measured_range_m(frame)
        if not np.isfinite(range_m).any():
            continue
        reach_m = float(np.nanmax(range_m)) * (1 + LIMITS.same_range)
        near = np.array(
            tree.query_ball_point(views.posed.T_map_camera[number, :3, 3], reach_m), np.int64
        )
        if not len(near):
            continue
        points = np.concatenate([corners[near], centers[near, None]], axis=1)
        seen, pixels = _seen(views, number, range_m, surface.bound_m, points)
        near, pixels = near[seen], pixels[seen]
        found = _value(
            views.image(number), pixels, corners[near], surface.color[surface.triangles[near]]
        )
        worst = value[near].argmin(axis=1)
        better = found > value[near, worst]
        view[near[better], worst[better]] = number
        value[near[better], worst[better]] = found[better]
    return Candidates(view, value)


def _seen(
    views: Views, number: int, range_m: Map, bound_m: float, points: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Which of triangles, points (n, 4, 3) with their centers last, a view shows, and the pixels
    (n, 4, 2).
    """
    pixels, depth_m = views.project(number, points)
    height, width = range_m.shape
    low, high = LIMITS.border_px, np.array([width, height]) - 1 - LIMITS.border_px
    inside = (depth_m > 0).all(axis=1) & ((pixels >= low) & (pixels <= high)).all(axis=(1, 2))
    distance_m = np.linalg.norm(points[inside] - views.posed.T_map_camera[number, :3, 3], axis=-1)
    column, row = np.rint(pixels[inside]).astype(np.int64).transpose(2, 0, 1)
    apart_m = np.abs(range_m[row, column] - distance_m)
    most_m = np.maximum(LIMITS.same_range * distance_m, 2 * bound_m)
    agree = (apart_m[:, 3] <= most_m[:, 3]) & ~(apart_m > most_m).any(axis=1)
    result = np.zeros(len(points), np.bool_)
    result[inside] = agree & (_twice_area_px(pixels[inside]) > 0)
    return result, pixels


def _twice_area_px(pixels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positive for triangles that face the camera: their corners run the other way round where y
    points down.
    """
    a, b = pixels[:, 1] - pixels[:, 0], pixels[:, 2] - pixels[:, 0]
    return np.asarray(a[:, 1] * b[:, 0] - a[:, 0] * b[:, 1])


def _value(
    image: NDArray[np.uint8],
    pixels: NDArray[np.float64],
    corners: NDArray[np.float64],
    colors: NDArray[np.uint8],
) -> NDArray[np.float64]:
    height, width = image.shape[:2]
    area_m2 = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    px_a_meter = np.sqrt(_twice_area_px(pixels) / np.maximum(area_m2, 1e-12))
    middle = np.array([width - 1, height - 1]) / 2
    off_center = ((pixels[:, 3] - middle) ** 2).sum(axis=1) / (middle**2).sum()
    blurred = cv2.GaussianBlur(image, (0, 0), 3)
    column, row = np.rint(pixels[:, 3]).astype(np.int64).T
    difference = np.abs(blurred[row, column].astype(np.float64) - colors.mean(axis=1)).max(axis=1)
    agreement = 1 / (1 + (difference / LIMITS.color_std) ** 2)
    return np.asarray(
        _sharpness(image) * px_a_meter * (1 - LIMITS.corner_loss * off_center) * agreement
    )


def _sharpness(image: NDArray[np.uint8]) -> float:
    """Contrast from pixel to pixel against that over some pixels: falls with motion and defocus,
    not with what is seen.
    """
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    fine = np.abs(gray - cv2.GaussianBlur(gray, (0, 0), 1)).mean()
    coarse = np.abs(cv2.GaussianBlur(gray, (0, 0), 2) - cv2.GaussianBlur(gray, (0, 0), 6)).mean()
    return float((fine + 0.1) / (coarse + 0.1))


# Patches of the surface that share a view: each lies in the texture as it lies in that image.


@dataclass(frozen=True, eq=False)
class Charts:
    """of_face (F,): the chart of each triangle, -1 where no view shows it. view, group (C,): of
    each chart.

    A node is a vertex in a chart. node (F, 3): of each corner, -1 without a chart. vertex, chart
    (N,): of each node. pixel (N, 2): where the chart's view shows it, (0, 0) in the center of the
    top left one. correction (N, 3): what is added there to its colors.
    """

    of_face: NDArray[np.int64]
    view: NDArray[np.int32]
    group: NDArray[np.int64]
    node: NDArray[np.int64]
    vertex: NDArray[np.int64]
    chart: NDArray[np.int64]
    pixel: NDArray[np.float64]
    correction: NDArray[np.float32]

    def leveled(self, correction: NDArray[np.float32]) -> "Charts":
        """Replace the correction."""
        return replace(self, correction=correction)


def build_charts(
    views: Views,
    surface: Surface,
    label: NDArray[np.int32],
    across: NDArray[np.int64],
    group: NDArray[np.int64],
) -> Charts:
    """Charts: connected triangles of one view (F,) and one group (F,)."""
    of_face = _components(label, across, group)
    seen = np.flatnonzero(of_face >= 0)
    charts = int(of_face.max(initial=-1)) + 1
    view, of_group = np.full(charts, -1, np.int32), np.zeros(charts, np.int64)
    view[of_face[seen]], of_group[of_face[seen]] = label[seen], group[seen]
    key = of_face[seen, None] * len(surface.position) + surface.triangles[seen]
    unique, inverse = np.unique(key, return_inverse=True)
    node = np.full(surface.triangles.shape, -1, np.int64)
    node[seen] = inverse.reshape(-1, 3)
    chart, vertex = np.divmod(unique, max(len(surface.position), 1))
    pixel = np.zeros((len(unique), 2))
    for number in np.unique(view):
        of_view = np.flatnonzero(view[chart] == number)
        pixel[of_view] = views.project(int(number), surface.position[vertex[of_view]])[0]
    return Charts(
        of_face, view, of_group, node, vertex, chart, pixel, np.zeros((len(unique), 3), np.float32)
    )


def _components(
    label: NDArray[np.int32], across: NDArray[np.int64], group: NDArray[np.int64]
) -> NDArray[np.int64]:
    one = np.repeat(np.arange(len(label)), 3)
    other = across.ravel()
    joined = other >= 0
    one, other = one[joined], other[joined]
    same = (label[one] == label[other]) & (group[one] == group[other]) & (label[one] >= 0)
    graph = coo_array(
        (np.ones(int(same.sum()), np.int8), (one[same], other[same])),
        shape=(len(label), len(label)),
    )
    component = np.asarray(connected_components(graph, directed=False)[1])
    result = np.full(len(label), -1, np.int64)
    seen = label >= 0
    result[seen] = np.unique(component[seen], return_inverse=True)[1]
    return result


# Choice of one view for each triangle: a good one, and the same as its neighbors' where that
# costs little.

SEAM = 0.4
"""Cost of an edge between two views, as a fraction of a view's value (Potts model): patches of some
hundred triangles.
"""
SWEEPS = 30
"""Iterated conditional modes (Besag 1986) change next to nothing after some twenty."""


def choose(found: Candidates, across: NDArray[np.int64]) -> NDArray[np.int32]:
    """Choose the view of each triangle: (F,), -1 where none shows it. across: (F, 3), neighbors or
    -1.
    """
    with np.errstate(divide="ignore"):
        cost = np.where(found.view >= 0, -np.log(np.maximum(found.value, 1e-9)), np.inf)
    faces = np.arange(len(cost))
    label = np.where(
        np.isfinite(cost).any(axis=1), found.view[faces, cost.argmin(axis=1)], -1
    ).astype(np.int32)
    rng = np.random.default_rng(0)
    for _ in range(SWEEPS):
        # half at a time: two neighbors must not swap for ever
        turn = np.flatnonzero(rng.random(len(cost)) < 0.5)
        beside = np.where(across[turn] >= 0, label[across[turn]], -1)
        differ = (beside[:, None, :] != found.view[turn, :, None]) & (beside[:, None, :] >= 0)
        total = cost[turn] + SEAM * differ.sum(axis=2)
        best = total.argmin(axis=1)
        label[turn] = np.where(
            np.isfinite(total[np.arange(len(turn)), best]), found.view[turn, best], -1
        )
    return label
