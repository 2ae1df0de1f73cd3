"""The images as views of the surface: where each shows it, and how well."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache, partial

import cv2
import numpy as np
from numpy.typing import NDArray

from calibration.transforms import transform_points
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.records import Map
from stereo_seecolor.run_folder.posed_run import PosedRun
from stereo_seecolor.texture.surface import PaintedSurface


@dataclass(frozen=True)
class TextureLimits:
    """Which views of a triangle count, and how much."""

    kept: int = 8
    """Views a triangle keeps: more than overlap usefully in a survey."""
    same_range: float = 0.02
    """A view shows a place at the measured range within this fraction: else it is hidden."""
    border_px: float = 3.0
    """From the image's border, where rectification and correction have no full support."""
    corner_loss: float = 0.4
    """Of a view's value in the image's corners: lenses are less sharp and lamps weaker there."""
    color_std: float = 12.0
    """Of 255: as far as a view may be from the color of all frames together before it counts less
    (fish, particles, shadows).
    """


LIMITS = TextureLimits()


@dataclass(frozen=True, eq=False)
class Picture:
    """A corrected image, image (H, W, 3); the same without what is finer than some pixels, soft
    (H / 2, W / 2, 3); and how sharp it is.
    """

    image: NDArray[np.uint8]
    soft: NDArray[np.uint8]
    sharpness: float


SOFT_PX = 2.0
"""Before colors of views are compared: they may be off by a pixel or two."""
PICTURE_BYTES, RANGE_BYTES = 100_000_000, 20_000_000
"""In memory, of pictures, which neighboring places and the steps of a tile share, and of range
maps, which only the choice of views looks at, and which are read in half of the time.
"""


class Views:
    """The corrected images of a run and their measured ranges (H, W), NaN where there are none; the
    last ones are kept. Any thread may ask for them. Raise InputError if a file is gone or damaged.

    unreadable: messages of frames with a file that is gone or damaged; they show nothing.
    """

    def __init__(self, posed: PosedRun) -> None:
        self.posed, self.unreadable = posed, dict[int, str]()
        pixels = int(np.prod(posed.geometry.image_size))
        # of functions, not of methods: pictures are freed with the views
        self.picture = lru_cache(max(4, PICTURE_BYTES // (4 * pixels)))(partial(_picture, posed))
        self.range_m = lru_cache(max(4, RANGE_BYTES // (4 * pixels)))(partial(_range_m, posed))
        self._reaches_m = dict[int, float]()

    def reach_m(self, number: int) -> float:
        """The largest range that a frame measured; 0 without any, and if it is unreadable."""
        if number not in self._reaches_m:
            try:
                self.picture(number)
                range_m = self.range_m(number)
            except InputError as error:
                self.unreadable[number], range_m = str(error), np.zeros(0, np.float32)
            self._reaches_m[number] = float(np.fmax.reduce(range_m, axis=None, initial=0))
        return self._reaches_m[number]

    def near(self, low: NDArray[np.float64], high: NDArray[np.float64]) -> Iterator[int]:
        """The frames that may show something of a box."""
        ends = np.stack([low, high])
        corners = np.stack(np.meshgrid(*ends.T), axis=-1).reshape(-1, 3)
        T = self.posed.T_camera_map
        x, y, z = np.moveaxis(corners @ T[:, :3, :3].transpose(0, 2, 1) + T[:, None, :3, 3], -1, 0)
        g, (width, height) = self.posed.geometry, self.posed.geometry.image_size
        u, v = g.focal_px * x + g.cx_left_px * z, g.focal_px * y + g.cy_px * z
        inside = (z, u, v, (width - 1) * z - u, (height - 1) * z - v)
        in_sight = np.all([(side > 0).any(axis=1) for side in inside], axis=0)
        eye = self.posed.T_map_camera[:, :3, 3]
        away_m = np.linalg.norm(np.maximum(np.maximum(low - eye, eye - high), 0), axis=1)
        for number in np.flatnonzero(in_sight).tolist():
            if away_m[number] <= self.reach_m(number) * (1 + LIMITS.same_range):
                yield number

    def project(self, number: int, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels (N, 2), (0, 0) the center of the top left one, of points (N, 3) of the map."""
        seen = transform_points(self.posed.T_camera_map[number], points)
        return self.posed.geometry.project(seen)


def _range_m(posed: PosedRun, number: int) -> Map:
    return posed.measured_range_m(posed.frames[number])


def _picture(posed: PosedRun, number: int) -> Picture:
    image = eight_bit(posed.frames[number].read("corrected"))
    half = [-(-side // 2) for side in image.shape[1::-1]]
    soft = cv2.resize(image, half, interpolation=cv2.INTER_AREA)
    soft = np.asarray(cv2.GaussianBlur(soft, (0, 0), SOFT_PX / 2), np.uint8)
    return Picture(image, soft, _sharpness(image))


@dataclass(frozen=True, eq=False)
class Candidates:
    """view (F, K) int32, -1 for none; value (F, K) float32, higher is better, 0 for none."""

    view: NDArray[np.int32]
    value: NDArray[np.float32]


def candidates(views: Views, surface: PaintedSurface) -> Candidates:
    """The best views of each triangle: by pixels a meter (range and slant), sharpness, place in the
    image, and agreement in color.

    A view counts only where its measured range agrees with the surface at the triangle's center,
    and contradicts it at no corner.
    """
    faces = len(surface.triangles)
    view = np.full((faces, LIMITS.kept), -1, np.int32)
    value = np.zeros((faces, LIMITS.kept), np.float32)
    if not faces:
        return Candidates(view, value)
    corners = surface.position[surface.triangles]
    for number in views.near(corners.min(axis=(0, 1)), corners.max(axis=(0, 1))):
        eye = views.posed.T_map_camera[number, :3, 3]
        seen = views.picture(number)
        rate(
            (surface.position, surface.triangles, surface.color, surface.bound_m),
            (views.posed.geometry.P_left @ views.posed.T_camera_map[number, :3], eye),
            (views.range_m(number), seen.soft, seen.sharpness),
            (LIMITS.same_range, LIMITS.border_px, LIMITS.corner_loss, LIMITS.color_std),
            number,
            view,
            value,
        )
    return Candidates(view, value)


@compiled
def rate(surface, camera, seen, limits, number, view, value):  # type: ignore[no-untyped-def]
    """Put a view among the best of triangles that it shows. camera: (3, 4), place (3,)."""
    position, triangles, color, bound_m = surface
    range_m, soft, sharpness = seen
    same_range, border_px, corner_loss, color_std = limits
    most = same_range, 2 * bound_m, border_px
    middle_x, middle_y = (range_m.shape[1] - 1) / 2, (range_m.shape[0] - 1) / 2
    point, pixel = np.empty((4, 3)), np.empty((4, 2))
    for f in range(len(triangles)):
        for c in range(3):
            for k in range(3):
                point[k, c] = position[triangles[f, k], c]
            point[3, c] = (point[0, c] + point[1, c] + point[2, c]) / 3
        shown = True
        for turn in range(4):  # the center first: nearly all that is not shown fails there
            shown = shown and agrees(
                point[3 - turn], camera, range_m, most, turn == 0, pixel[3 - turn]
            )
        if not shown:
            continue
        ax, ay = pixel[1, 0] - pixel[0, 0], pixel[1, 1] - pixel[0, 1]
        bx, by = pixel[2, 0] - pixel[0, 0], pixel[2, 1] - pixel[0, 1]
        # positive where it faces the camera: y points down there, and corners run the other way
        area_px = ay * bx - ax * by
        if area_px <= 0:
            continue
        off = ((pixel[3, 0] - middle_x) ** 2 + (pixel[3, 1] - middle_y) ** 2) / (
            middle_x**2 + middle_y**2
        )
        found = (
            sharpness
            * np.sqrt(area_px / max(twice_area_m2(point), 1e-12))
            * (1 - corner_loss * off)
        )
        at = soft[int(np.rint(pixel[3, 1])) // 2, int(np.rint(pixel[3, 0])) // 2]
        found /= 1 + (difference(at, color, triangles[f]) / color_std) ** 2
        worst = 0
        for k in range(1, value.shape[1]):
            if value[f, k] < value[f, worst]:
                worst = k
        if found > value[f, worst]:
            view[f, worst], value[f, worst] = number, found


@compiled
def agrees(point, camera, range_m, most, is_sure, pixel):  # type: ignore[no-untyped-def]
    """Whether a view shows a point by its measured range, and where, into ``pixel`` (2,). is_sure:
    not where nothing was measured.
    """
    projection, eye = camera
    same_range, least_m, border_px = most
    p, (x, y, z) = projection, (point[0], point[1], point[2])
    depth_m = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
    if depth_m <= 0:
        return False
    u = (p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]) / depth_m
    v = (p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]) / depth_m
    right, bottom = range_m.shape[1] - 1 - border_px, range_m.shape[0] - 1 - border_px
    if not (border_px <= u <= right and border_px <= v <= bottom):
        return False
    pixel[0], pixel[1] = u, v
    away_m = np.sqrt((x - eye[0]) ** 2 + (y - eye[1]) ** 2 + (z - eye[2]) ** 2)
    apart_m = abs(range_m[int(np.rint(v)), int(np.rint(u))] - away_m)
    most_m = max(same_range * away_m, least_m)
    return apart_m <= most_m if is_sure else not apart_m > most_m


@compiled
def twice_area_m2(point):  # type: ignore[no-untyped-def]
    """Twice the area of the triangle of the first three points."""
    a0, a1, a2 = point[1, 0] - point[0, 0], point[1, 1] - point[0, 1], point[1, 2] - point[0, 2]
    b0, b1, b2 = point[2, 0] - point[0, 0], point[2, 1] - point[0, 1], point[2, 2] - point[0, 2]
    return np.sqrt((a1 * b2 - a2 * b1) ** 2 + (a2 * b0 - a0 * b2) ** 2 + (a0 * b1 - a1 * b0) ** 2)


@compiled
def difference(at, color, corners):  # type: ignore[no-untyped-def]
    """The largest of the three channels between a color and the mean of three vertices."""
    largest = 0.0
    for c in range(3):
        mean = float(color[corners[0], c]) + float(color[corners[1], c])
        mean = (mean + float(color[corners[2], c])) / 3
        largest = max(largest, abs(float(at[c]) - mean))
    return largest


COARSE_PX = 4
"""What is compared with the finest contrast is seen in a picture reduced so much."""


def _sharpness(image: NDArray[np.uint8]) -> float:
    """Contrast from pixel to pixel against that over some pixels, in the middle of an image: falls
    with motion and defocus, not with what is seen.
    """
    height, width = image.shape[:2]
    middle = image[height // 4 : -(-3 * height // 4), width // 4 : -(-3 * width // 4)]
    gray = cv2.cvtColor(np.ascontiguousarray(middle), cv2.COLOR_RGB2GRAY).astype(np.float32)
    fine = np.abs(gray - cv2.GaussianBlur(gray, (0, 0), 1)).mean()
    size = [max(1, side // COARSE_PX) for side in gray.shape[::-1]]
    small = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
    coarse = np.abs(small - cv2.GaussianBlur(small, (0, 0), 6 / COARSE_PX)).mean()
    return float((fine + 0.1) / (coarse + 0.1))
