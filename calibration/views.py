"""Limits of the rectified image: the directions that a camera sees, in rectified axes."""

from dataclasses import dataclass

import numpy as np

from calibration.errors import CalibrationError
from calibration.geometry import Array
from calibration.refraction import CameraInWater
from calibration.rig import MAX_IMAGE_SIDE_PX, Camera, quarter_turns_of

AnyCamera = Camera | CameraInWater
WIDEST_SLOPE = 2.0  # tan of 63 degrees: a pinhole image of more spends its pixels on the rim
# points along each edge of the raw image, and from its center to each: smooth lenses need no more
BORDER_STEPS = 33
# a whole view turned by 45 degrees takes 2.04 times a 4:3 image; more is a wide lens's rim
MAX_AREA_RATIO = 3.0


@dataclass(frozen=True)
class View:
    """A pinhole image: focal_px, principal point cx_px and cy_px, image_size (width, height)."""

    focal_px: float
    cx_px: float
    cy_px: float
    image_size: tuple[int, int]


def common_view(cameras: list[tuple[AnyCamera, Array]]) -> View:
    """The widest image, of the cameras' size, that all fill without an empty corner.

    cameras: each with its rotation (3, 3) into rectified axes. Raises CalibrationError if they
    share no field of view.
    """
    bounds = np.array([_inner_bounds(camera, R) for camera, R in cameras])
    x0, y0 = bounds[:, 0].max(axis=0)
    x1, y1 = bounds[:, 1].min(axis=0)
    if not (x1 > x0 and y1 > y0):
        raise CalibrationError(
            "the cameras share no field of view after rectification: check the rotation and the "
            "focal lengths"
        )
    width, height = cameras[0][0].image_size
    focal_px = max((width - 1) / (x1 - x0), (height - 1) / (y1 - y0))
    cx_px = (width - 1) / 2 - focal_px * (x0 + x1) / 2
    cy_px = (height - 1) / 2 - focal_px * (y0 + y1) / 2
    return View(focal_px, cx_px, cy_px, (width, height))


def whole_view(left: tuple[AnyCamera, Array], right: tuple[AnyCamera, Array], along: int) -> View:
    """The image that shows all that the left camera sees, as fine as the raw one, corners empty.

    along: the axis (0 = x, 1 = y) of the baseline; along it the right camera's view is shown too,
    where its matches lie.
    """
    low, high = _outer_bounds(*left)
    low_right, high_right = _outer_bounds(*right)
    low[along], high[along] = min(low[along], low_right[along]), max(high[along], high_right[along])
    focal_px = _central_focal_px(left[0])
    width, height = left[0].image_size
    extent = focal_px * (high - low)
    shrink = min(
        1.0,
        (MAX_IMAGE_SIDE_PX - 1) / extent.max(),
        np.sqrt(MAX_AREA_RATIO * width * height / extent.prod()),
    )
    focal_px *= float(shrink)
    size = (np.ceil(focal_px * (high - low)) + 1).astype(int).tolist()
    cx_px, cy_px = (-focal_px * low).tolist()
    return View(focal_px, cx_px, cy_px, (size[0], size[1]))


def _inner_bounds(camera: AnyCamera, R: Array) -> Array:
    """((x0, y0), (x1, y1)) slopes of the largest upright rectangle in the rectified outline."""
    edges = _edges(camera, R)
    # a camera turned by a quarter has its top edge at the right of the rectified view
    turns = quarter_turns_of(R)
    top, right, bottom, left = [edges[(i - turns) % 4] for i in range(4)]
    return np.array([[left[:, 0].max(), top[:, 1].max()], [right[:, 0].min(), bottom[:, 1].min()]])


def _outer_bounds(camera: AnyCamera, R: Array) -> tuple[Array, Array]:
    """(2,) least and (2,) largest slopes of the camera's rectified outline."""
    outline = np.concatenate(_edges(camera, R))
    return outline.min(axis=0), outline.max(axis=0)


def _edges(camera: AnyCamera, R: Array) -> list[Array]:
    """(n, 2) slopes of the top, right, bottom and left edge of the raw image."""
    width, height = camera.image_size
    along = np.linspace(0, 1, BORDER_STEPS)[:, None]
    center = np.array([(width - 1) / 2, (height - 1) / 2])
    corners = np.array(
        [[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], dtype=np.float64
    )
    return [
        _outermost(camera, R, center, corners[i] + along * (corners[(i + 1) % 4] - corners[i]))
        for i in range(4)
    ]


def _outermost(camera: AnyCamera, R: Array, center: Array, border: Array) -> Array:
    """(n, 2) slopes, in rectified axes, of the outermost ray on the way from the center to each
    border pixel.

    A lens model may reach no further (its polynomial turns back), and a fisheye sees wider than an
    image plane can show.
    """
    inwards = np.linspace(0, 1, BORDER_STEPS)[1:, None, None]
    pixels = center + inwards * (border - center)
    x, y, z = np.moveaxis(
        (camera.rays(pixels.reshape(-1, 2)) @ R.T).reshape(*pixels.shape[:2], 3), 2, 0
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        slopes = np.stack([x / z, y / z], axis=-1)
        usable = (z > 0) & (np.abs(slopes).max(axis=-1) < WIDEST_SLOPE)
    reached = np.cumprod(usable, axis=0).sum(axis=0) - 1
    if (reached < 0).any():
        raise CalibrationError(
            "the lens model of a camera reaches no pixel near the image center: check focal "
            "lengths and distortion"
        )
    return np.asarray(slopes[reached, np.arange(len(border))])


def _central_focal_px(camera: AnyCamera) -> float:
    """Pixels a unit of slope at the middle of the raw image."""
    width, height = camera.image_size
    center = np.array([(width - 1) / 2, (height - 1) / 2])
    step = camera.rays(center + np.array([[-1.0, -1.0], [1.0, 1.0]]))[:, :2]
    return float(np.sqrt(8) / np.linalg.norm(step[1] - step[0]))
