"""Weighted TSDF integration of one frame into a range of voxel blocks."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.geometry import RectifiedPair
from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.compute.threads import in_parts
from stereo_seecolor.records import Map, SurveyFrame

# The weight of a view's color where several views are averaged, in the fused surface and in the
# mosaic alike.

DOUBTFUL_WEIGHT = 0.02
"""Weight of a color that is clipped or beyond recovery: counts only where there is no other."""


@compiled
def color_weight(coarseness: Any, doubtful: Any) -> Any:
    """Compute the weight 1 / (1 + coarseness^2) of a pixel whose size on the bottom is
    ``coarseness`` voxels or cells.

    Not more than that: with light and water taken out, caustics, shadows and what is left of the
    lamps' pattern are the larger part of a color's error, and they are independent of range; the
    average over many views is truer than the nearest one.
    """
    weight = 1 / (1 + coarseness * coarseness)
    return weight * DOUBTFUL_WEIGHT if doubtful else weight


# The slant of measured surfaces: where one is seen at a grazing angle, the truncation along the
# ray is longer.

SLANT_PX = 8
"""Pixels over which the slant of a surface is measured: an error of a fifth of a pixel of disparity
slants it by 30 degrees at a disparity of 10 px and a focal length of 350 px.
"""
LEAST_SINE = 0.35
"""Of the angle between ray and surface, from which on the truncation of 3 voxels reaches a whole
voxel below the surface. At 10 degrees it is half a voxel, and ground then comes out in stripes.
"""
MOST_STRETCH = 4.0
"""Rays at 5 degrees: what is seen from farther aside is too uncertain."""


@compiled
def stretches(
    # (H + 2 SLANT_PX, W + 2 SLANT_PX) float32, 1 / depth inside a frame of zeros: 0 where nothing
    # was measured
    inverse: Any,
    camera: Any,  # (3,) float64: focal_px, cx, cy
    # (H, W) float32, written: by how much the truncation grows along a pixel's ray, 1 for none
    stretch: Any,
    left: int,
    right: int,
    first: int,
    last: int,
) -> None:
    """Write by how much the truncation grows along each pixel's ray, in the columns from left to
    right - 1 and the rows from first to last - 1.

    The inverse depth of a plane is linear in pixels, so that its slopes and its value give the
    normal. Without branches, for vector instructions.
    """
    focal_px, cx, cy = np.float32(camera[0]), np.float32(camera[1]), np.float32(camera[2])
    one, least_sine, most = np.float32(1), np.float32(LEAST_SINE), np.float32(MOST_STRETCH)
    scale = focal_px / np.float32(SLANT_PX)
    for row in range(first, last):
        y = (np.float32(row) - cy) / focal_px
        above, here = inverse[row], inverse[row + SLANT_PX]
        below = inverse[row + 2 * SLANT_PX]
        for column in range(left, right):
            x = (np.float32(column) - cx) / focal_px
            middle = here[column + SLANT_PX]
            a = scale * _slope(here[column], middle, here[column + 2 * SLANT_PX])
            b = scale * _slope(above[column + SLANT_PX], middle, below[column + SLANT_PX])
            c = middle - a * x - b * y
            sine = middle / np.sqrt((a * a + b * b + c * c) * (one + x * x + y * y))
            stretch[row, column] = min(max(least_sine / sine, one), most)


@compiled
def _slope(before: Any, middle: Any, behind: Any) -> Any:
    """Change of the inverse depth over SLANT_PX along one axis: the smaller of both sides, so that
    it holds on both.

    0 where they differ in sign (a branch, a ridge) or one is not measured (an edge of what was
    seen).
    """
    rise, fall = behind - middle, middle - before
    slope = rise if abs(rise) < abs(fall) else fall
    return slope if (before > 0) & (behind > 0) & (rise * fall > 0) else np.float32(0)


BLOCK = 8
"""Voxels along the edge of a block."""

CELL = 16
"""Pixels along the edge of the cells whose deepest measurement is known."""
NEAREST_DEPTH_M = 0.05
"""Nearer than the cameras' housing nothing is measured, meters."""
BITS = 21
"""Of a block's coordinate in a packed number: three of them fit into 63."""
OFFSET = 1 << (BITS - 1)


@compiled
def weigh(
    range_m: Any,  # (H, W) float32
    range_std_m: Any,  # (H, W) float32
    confidence: Any,  # (H, W) uint8, 255 for 1
    ray_length: Any,  # (H, W) float32: range over depth
    voxel_m: float,
    depth_m: Any,  # (H, W) float32, written
    weight: Any,  # (H, W) float32, written: 0 where nothing was measured
    # (H + 2 SLANT_PX, W + 2 SLANT_PX) float32: written inside a frame of zeros: 1 / depth_m, 0
    # where there is none
    inverse: Any,
    # (H / CELL, W / CELL) float32, rounded up, written: of each cell of CELL x CELL pixels, 0 where
    # there is none
    deepest_m: Any,
    left: int,
    right: int,
    first: int,
    last: int,
) -> None:
    """Compute depths and weights of a frame's pixels, in the columns of cells from left to right -
    1 and the rows from first to last - 1.

    Weight = confidence (voxel / standard error)^2. The error of stereo grows with the square of the
    range; without regard to that, one near fish would outweigh all that see through it.
    """
    for row in range(first * CELL, min(last * CELL, range_m.shape[0])):
        if row % CELL == 0:
            deepest_m[row // CELL, left:right] = 0
        for column in range(left * CELL, min(right * CELL, range_m.shape[1])):
            measured, std = range_m[row, column], range_std_m[row, column]
            trust = np.float32(confidence[row, column]) / np.float32(255)
            weight[row, column] = 0
            inverse[row + SLANT_PX, column + SLANT_PX] = 0
            if not (measured > 0 and trust > 0 and measured < np.inf):
                continue
            depth = np.float32(measured / ray_length[row, column])
            depth_m[row, column] = depth
            inverse[row + SLANT_PX, column + SLANT_PX] = np.float32(1) / depth
            weight[row, column] = trust * (voxel_m / std) ** 2 if std > 0 else trust
            cell = column // CELL
            deepest_m[row // CELL, cell] = max(deepest_m[row // CELL, cell], depth)


@compiled
def cells_of(
    keys: Any,  # (B, 3) int32 block coordinates
    shape: Any,  # rows and columns of cells of an image
    camera: Any,  # (3,) float64: focal_px, cx, cy
    T: Any,  # (4, 4) float64, camera from world
    voxel_m: float,
) -> Any:
    """Find the window of cells that the blocks cover in the image: top, bottom, left, right; bottom
    and right are excluded.
    """
    top, bottom, left, right = shape[0], 0, shape[1], 0
    for b in range(len(keys)):
        window = _window(keys[b], shape, camera, T, voxel_m)
        if window[0] < window[1] and window[2] < window[3]:
            top, bottom = min(top, window[0]), max(bottom, window[1])
            left, right = min(left, window[2]), max(right, window[3])
    return top, bottom, left, right


@compiled
def in_sight(
    keys: Any,  # (B, 3) int32 block coordinates
    deepest_m: Any,  # of ``weigh``, known where ``cells_of`` says
    camera: Any,  # (3,) float64: focal_px, cx, cy
    T: Any,  # (4, 4) float64, camera from world
    voxel_m: float,
    truncation_m: float,
) -> Any:
    """Find the blocks of which a part may lie in front of a measurement, or no deeper behind it
    than the truncation: their numbers.

    Of each block its enclosing sphere is compared with the deepest measurement in the window of the
    image that it covers.
    """
    chosen = np.empty(len(keys), np.int64)
    count = 0
    for b in range(len(keys)):
        top, bottom, left, right, nearest_m = _window(keys[b], deepest_m.shape, camera, T, voxel_m)
        if _deepest(deepest_m, top, bottom, left, right) > max(nearest_m - truncation_m, 0.0):
            chosen[count] = b
            count += 1
    return chosen[:count]


@compiled
def _window(key: Any, shape: Any, camera: Any, T: Any, voxel_m: float) -> Any:
    """The cells that the sphere around a block covers, as ``cells_of`` gives them, and its least
    depth; none behind the camera.
    """
    half, radius = BLOCK / 2, 0.87 * BLOCK * voxel_m
    x, y, z = _in_camera(
        T,
        (key[0] * BLOCK + half) * voxel_m,
        (key[1] * BLOCK + half) * voxel_m,
        (key[2] * BLOCK + half) * voxel_m,
    )
    if z < -radius:
        return 0, 0, 0, 0, 0.0
    if z < 2 * radius:
        return 0, shape[0], 0, shape[1], 0.0
    across, down, margin = x / z, y / z, 2 * radius / (z - radius)
    top, bottom = _cells(
        camera[0] * (down - margin) + camera[2], camera[0] * (down + margin) + camera[2], shape[0]
    )
    left, right = _cells(
        camera[0] * (across - margin) + camera[1],
        camera[0] * (across + margin) + camera[1],
        shape[1],
    )
    return top, bottom, left, right, z - radius


@compiled
def _deepest(deepest_m: Any, top: int, bottom: int, left: int, right: int) -> Any:
    """In a window of cells; 0 where nothing was measured."""
    deepest = np.float32(0)
    for row in range(top, bottom):
        for column in range(left, right):
            deepest = max(deepest, deepest_m[row, column])
    return deepest


@compiled
def _cells(low_px: float, high_px: float, count: int) -> Any:
    """The cells from the first to before the last that an interval of pixels meets, one pixel more
    at each end.
    """
    low, high = np.floor((low_px - 1) / CELL), np.floor((high_px + 1) / CELL) + 1
    return int(min(max(low, 0.0), float(count))), int(min(max(high, 0.0), float(count)))


@compiled
def integrate(
    keys: Any,  # (B, 3) int32 block coordinates
    tsdf: Any,  # (B, 8, 8, 8) float32 in units of the truncation, index z, y, x
    weight: Any,  # (B, 8, 8, 8) float32
    color: Any,  # (B, 8, 8, 8, 3) float32, 0..255
    color_weights: Any,  # (B, 8, 8, 8) float32
    rgb: Any,  # (H, W, 3) uint8
    doubtful: Any,  # (H, W) bool: its color counts next to nothing
    depth_m: Any,  # (H, W) float32, of ``weigh``
    pixel_weight: Any,  # (H, W) float32, of ``weigh``
    stretch: Any,  # (H, W) float32, of ``stretches``: of the truncation
    camera: Any,  # (3,) float64: focal_px, cx, cy
    T: Any,  # (4, 4) float64, camera from world
    voxel_m: float,
    truncation_m: float,
    chosen: Any,  # (n,) int64, of ``in_sight``
    first: int,
    last: int,
) -> None:
    """Update the voxels of the blocks chosen[first:last] that project onto a measured pixel and lie
    no deeper behind it than the truncation.

    Curless and Levoy's (1996) running weighted mean, of distance and of color. Voxels in front of
    the surface are updated as well: that carves away what other frames saw only once, such as fish.
    """
    for b in chosen[first:last]:
        corner = (
            keys[b, 0] * BLOCK * voxel_m,
            keys[b, 1] * BLOCK * voxel_m,
            keys[b, 2] * BLOCK * voxel_m,
        )
        for k, j in np.ndindex((BLOCK, BLOCK)):
            start = _in_camera(T, corner[0], corner[1] + j * voxel_m, corner[2] + k * voxel_m)
            for i in range(BLOCK):
                along = i * voxel_m
                z = start[2] + T[2, 0] * along
                if z <= NEAREST_DEPTH_M:
                    continue
                across, down = (start[0] + T[0, 0] * along) / z, (start[1] + T[1, 0] * along) / z
                u, v = camera[0] * across + camera[1] + 0.5, camera[0] * down + camera[2] + 0.5
                w = _at(pixel_weight, v, u)
                if w == 0:
                    continue
                row, column = np.uint64(v), np.uint64(u)
                # Compared by depth, which is the same all over a pixel that looks at level ground;
                # range is not.
                measured, ray_length = (
                    depth_m[row, column],
                    np.sqrt(1 + across * across + down * down),
                )
                signed, reach_m = (measured - z) * ray_length, truncation_m * stretch[row, column]
                if signed < -reach_m:
                    continue
                # free space: as certain as a measurement at the voxel's own distance
                if signed > reach_m:
                    w *= (measured / z) ** 4
                total = weight[b, k, j, i] + w
                value = min(1.0, signed / reach_m)
                tsdf[b, k, j, i] += (value - tsdf[b, k, j, i]) * w / total
                weight[b, k, j, i] = total
                if signed <= reach_m:
                    vertical = abs(T[0, 2] * across + T[1, 2] * down + T[2, 2]) / ray_length
                    pixel_m = z * ray_length / (camera[0] * max(vertical, 0.05))
                    w = color_weight(pixel_m / voxel_m, doubtful[row, column])
                    color_weights[b, k, j, i] += w
                    for c in range(3):
                        color[b, k, j, i, c] += (
                            (rgb[row, column, c] - color[b, k, j, i, c])
                            * w
                            / color_weights[b, k, j, i]
                        )


@compiled
def _at(image: Any, row: float, column: float) -> Any:
    """The value of the pixel there; 0 beside the image."""
    inside = row >= 0 and column >= 0 and row < image.shape[0] and column < image.shape[1]
    return image[np.uint64(row), np.uint64(column)] if inside else np.float32(0)


@compiled
def _in_camera(T: Any, x: float, y: float, z: float) -> Any:
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3],
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3],
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3],
    )


def packed(x: Any, y: Any, z: Any) -> Any:
    """Pack the int64 coordinates of a block into one number, which sorts as (x, y, z) does."""
    return ((x + OFFSET) << (2 * BITS)) | ((y + OFFSET) << BITS) | (z + OFFSET)


# Depths and weights of a frame's pixels, computed where blocks of the tile project into the
# image.

Cells = tuple[int, int, int, int]
"""A window of cells of CELL x CELL pixels: top, bottom, left, right; the rows top to bottom - 1,
the columns left to right - 1.
"""


@dataclass(frozen=True, eq=False)
class MeasuredPixels:
    """Buffers that one frame after the other is weighed in: new memory for each would take as long
    as the work.

    camera: (3,) focal_px, cx, cy. depth_m, weight, inverse, deepest_m, stretch: as the kernels
    write them, valid in the cells that were weighed last.
    """

    geometry: RectifiedPair
    camera: NDArray[np.float64]
    depth_m: Map
    weight: Map
    inverse: Map
    deepest_m: Map
    stretch: Map

    @classmethod
    def room(cls, geometry: RectifiedPair) -> "MeasuredPixels":
        """Allocate the buffers for images of this geometry; their content is undefined until
        ``weigh`` is called.
        """
        width, height = geometry.image_size
        camera = np.array([geometry.focal_px, geometry.cx_left_px, geometry.cy_px])
        depth_m, weight, stretch = (np.empty((height, width), np.float32) for _ in range(3))
        inverse = np.zeros((height + 2 * SLANT_PX, width + 2 * SLANT_PX), np.float32)
        deepest_m = np.empty((-(-height // CELL), -(-width // CELL)), np.float32)
        return cls(geometry, camera, depth_m, weight, inverse, deepest_m, stretch)

    def weigh(self, frame: SurveyFrame, cells: Cells, voxel_m: float) -> None:
        """Compute depths, weights and stretches of a frame's pixels in these cells.

        Depths are also computed in the cells next to them, since the slant of a surface is measured
        over its neighborhood.
        """
        top, bottom, left, right = cells
        if top >= bottom or left >= right:
            return
        self._weigh_cells(frame, voxel_m, self._wider(cells))
        self._stretch_cells(cells)

    def _wider(self, cells: Cells) -> Cells:
        """The window with one cell more on each side, within the image."""
        top, bottom, left, right = cells
        rows, columns = self.deepest_m.shape
        return max(top - 1, 0), min(bottom + 1, rows), max(left - 1, 0), min(right + 1, columns)

    def _weigh_cells(self, frame: SurveyFrame, voxel_m: float, cells: Cells) -> None:
        top, bottom, left, right = cells

        def weigh_rows(first: int, last: int) -> None:
            weigh(
                frame.range_m, frame.range_std_m, frame.confidence, self.geometry.ray_length,
                voxel_m,
                self.depth_m, self.weight, self.inverse, self.deepest_m, left, right, top + first,
                top + last,
            )  # fmt: skip

        in_parts(weigh_rows, bottom - top)

    def _stretch_cells(self, cells: Cells) -> None:
        height, width = self.depth_m.shape
        top, bottom = cells[0] * CELL, min(cells[1] * CELL, height)
        left, right = cells[2] * CELL, min(cells[3] * CELL, width)

        def stretch_rows(first: int, last: int) -> None:
            stretches(self.inverse, self.camera, self.stretch, left, right, top + first, top + last)

        in_parts(stretch_rows, bottom - top)
