"""Finds plain white or light gray cards in an image: even, bright, with four straight sides."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from calibration.robust_statistics import deviation_about_zero
from stereo_seecolor.extras.evaluation.charts.flat_patches import PATCH_LIMITS as FLAT
from stereo_seecolor.extras.evaluation.charts.flat_patches import (
    Floats,
    Levels,
    flat_regions,
    pyramid,
)
from stereo_seecolor.files.decode import eight_bit
from stereo_seecolor.files.srgb import LUMINANCE, decode_srgb
from stereo_seecolor.mapping.marker_corners import intersections, line_through
from stereo_seecolor.records import Array, Image


@dataclass(frozen=True)
class CardLimits:
    """Limits of a card. Lengths without unit are fractions of its side."""

    area_px: tuple[int, int] = (60, 900)
    """Least and largest area of its flat part, in an image that is halved until it is so small:
    cards of 15 to 300 pixels.
    """
    least_fill: float = 0.85
    """Least fraction of its convex hull that is flat, and of the hull that four corners fill."""
    corner: float = 0.06
    """Largest distance of the hull from its four corners' outline, fraction of its length."""
    least_side_px: float = 12.0
    most_stretch: float = 3.5
    """Long over short side: A4, tilted by 65 degrees."""
    parallel: float = 0.25
    """Sine between opposite sides, and logarithm of their lengths' ratio: perspective."""
    least_corner_sine: float = 0.66
    """Least sine of the angle between sides that meet: a card tilted by 45 degrees."""
    reach: tuple[float, float] = (0.22, 0.055)
    """Distance from its expected place within which a side is sought, in each of two rounds."""
    samples: int = 32
    """Profiles along a side."""
    step: float = 0.15
    """Logarithm by which a card is brighter than what lies beside it."""
    least_brighter: float = 0.8
    """Least fraction of the places along each side that must be brighter. In 31 real pictures
    without a card no region of this shape has more than 0.54.
    """
    uneven: float = 0.06
    """Robust spread of its light about a plane, fraction: more is not a card, or one with
    writing.
    """
    apart: float = 3.0
    """Cards of like size nearer to each other are squares of a board, or tiles."""


LIMITS = CardLimits()
BLACK = 0.002
"""Light added before a logarithm is taken: a camera's offset."""


def white_cards(image: Image) -> tuple[Array, ...]:
    """(4, 2) corners, pixels, of each possible card in an image of 8 or 16 bits, (H, W, 3) RGB; its
    true color is not known.
    """
    picture = np.asarray(eight_bit(image) / np.float32(255), np.float32)
    light = np.asarray(decode_srgb(picture) @ LUMINANCE, np.float32)
    found: list[Array] = []
    for rough in _flat_quadrangles(picture):
        corners = _outlined(light, rough)
        if (
            corners is not None
            and _is_card(light, corners)
            and not any(_distance(corners, other) < 0.5 for other in found)
        ):
            found.append(corners)
    return tuple(
        card
        for card in found
        if not any(other is not card and _of_one_board(card, other) for other in found)
    )


def _flat_quadrangles(picture: Floats) -> Iterator[Array]:
    """Rough corners of four-cornered flat regions, widened to their outlines; smallest first."""
    for sized, pixel in pyramid(picture):
        if pixel >= 1:
            for corners in _quadrangles_of_size(sized):
                yield (corners + 0.5) * pixel - 0.5


def _quadrangles_of_size(picture: Levels) -> Iterator[Array]:
    """(4, 2) corners of regions with four corners, where a card has about LIMITS.area_px."""
    labels, stats = flat_regions(picture)
    area = stats[:, cv2.CC_STAT_AREA]
    least, most = LIMITS.area_px
    for number in np.flatnonzero((area >= least) & (area <= most)):
        x, y, width, height = (int(value) for value in stats[number, :4])
        if number == 0 or max(width, height) > 4 * min(width, height):
            continue
        region = np.pad((labels[y : y + height, x : x + width] == number).astype(np.uint8), 2)
        outlines, _ = cv2.findContours(
            cv2.dilate(region, np.ones((3, 3))), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        hull = cv2.convexHull(max(outlines, key=len))
        four = cv2.approxPolyDP(hull, LIMITS.corner * cv2.arcLength(hull, True), True)
        whole, border = cv2.contourArea(hull), cv2.arcLength(hull, True)
        full = (
            area[number] >= LIMITS.least_fill * (whole - border)
            and cv2.contourArea(four) >= LIMITS.least_fill * whole
        )
        if len(four) == 4 and full:
            corners, side = four[:, 0].astype(np.float64), np.sqrt(area[number])
            middle = corners.mean(axis=0)
            yield (
                middle + (corners - middle) * (side + FLAT.border_px) / (side + 2) + [x - 2, y - 2]
            )


def _outlined(light: Floats, corners: Array) -> Array | None:
    """The corners moved onto the edges next to them; None where four sides cannot be found, or do
    not have the shape of a card.
    """
    for reach in LIMITS.reach:
        if not _has_shape(corners, light.shape):
            return None
        lines = [_side(light, *ends, reach * _size(corners)) for ends in _sides(corners)]
        known = [line for line in lines if line is not None]
        if len(known) < 4:
            return None
        met = intersections(np.array(known))
        if not met[:, 2].all():
            return None
        corners = met[:, :2] / met[:, 2:]
    return corners if _has_shape(corners, light.shape) else None


def _sides(corners: Array) -> Iterator[tuple[Array, Array]]:
    """The two ends of each side."""
    return pairwise([*corners, corners[0]])


def _has_shape(corners: Array, shape: tuple[int, ...]) -> bool:
    """Whether the outline is nearly a parallelogram, not too narrow, and inside the image."""
    sides = np.roll(corners, -1, axis=0) - corners
    length = np.hypot(*sides.T)
    if (
        not np.isfinite(length).all()
        or length.min() < LIMITS.least_side_px
        or length.max() > LIMITS.most_stretch * length.min()
    ):
        return False
    along = sides / length[:, None]
    sine = along[:, 0] * np.roll(along[:, 1], -1) - along[:, 1] * np.roll(along[:, 0], -1)
    turned = along[:2, 0] * along[2:, 1] - along[:2, 1] * along[2:, 0]
    unlike = np.maximum(np.abs(turned), np.abs(np.log(length[:2] / length[2:])))
    inside = (corners >= 2).all() and (corners <= np.array(shape[1::-1]) - 3).all()
    return bool(
        inside
        and (unlike < LIMITS.parallel).all()
        and (np.abs(sine) > LIMITS.least_corner_sine).all()
    )


def _side(light: Floats, start: Array, end: Array, reach_px: float) -> Array | None:
    """(3,) the line a x + b y + c = 0 through the steepest point of each profile across a side;
    None where these do not agree.
    """
    along = end - start
    across = np.array([-along[1], along[0]]) / np.hypot(*along)
    offsets = np.arange(-max(reach_px, 2), max(reach_px, 2) + 0.25, 0.5)
    feet = start + np.linspace(0.15, 0.85, LIMITS.samples)[:, None] * along
    profiles = _sampled(light, feet[:, None] + offsets[:, None] * across)
    steepest = np.abs(np.diff(profiles, axis=1)).argmax(axis=1)
    at = (offsets[steepest] + offsets[steepest + 1]) / 2
    near = np.abs(at - np.median(at)) < max(1.5, 0.3 * reach_px)
    if near.sum() < LIMITS.samples / 2:
        return None
    return line_through((feet + at[:, None] * across)[near].astype(np.float32))


def _is_card(light: Floats, corners: Array) -> bool:
    """Whether the region is brighter than what surrounds all four sides, and even inside."""
    middle, offset_px = corners.mean(axis=0), np.clip(0.06 * _size(corners), 2, 6)
    for start, end in _sides(corners):
        across = np.array([-(end - start)[1], (end - start)[0]]) / np.hypot(*(end - start))
        inward = offset_px * across * np.sign(across @ (middle - start))
        places = start + np.linspace(0.12, 0.88, LIMITS.samples)[:, None] * (end - start)
        step = np.log(_sampled(light, places + inward) + BLACK) - np.log(
            _sampled(light, places - inward) + BLACK
        )
        if (step > LIMITS.step).mean() < LIMITS.least_brighter:
            return False
    return _unevenness(light, inner(corners)) < LIMITS.uneven


def inner(corners: Array) -> Array:
    """(4, 2) the card without its border, which is blurred."""
    middle = corners.mean(axis=0)
    return np.asarray(middle + 0.75 * (corners - middle))


def _unevenness(light: Floats, corners: Array) -> float:
    """Robust spread of the light inside about a plane, fraction of its median."""
    mask = np.zeros(light.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.round(corners).astype(np.int32), 1)
    y, x = np.nonzero(mask)
    values = cv2.GaussianBlur(light, (3, 3), 0.7)[y, x].astype(np.float64)
    plane = np.stack([x - x.mean(), y - y.mean(), np.ones(len(x))], axis=1)
    left = values - plane @ np.linalg.lstsq(plane, values, rcond=None)[0]
    return deviation_about_zero(left) / max(float(np.median(values)), BLACK)


def _sampled(light: Floats, points: Array) -> Floats:
    """The light at (..., 2) points, pixels."""
    x, y = np.moveaxis(points.reshape(len(points), -1, 2).astype(np.float32), -1, 0)
    return np.asarray(
        cv2.remap(light, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32
    ).reshape(points.shape[:-1])


def _size(corners: Array) -> float:
    return float(np.sqrt(cv2.contourArea(corners.astype(np.float32))))


def _distance(one: Array, other: Array) -> float:
    """Distance between the middles of two cards, in sides of the larger one."""
    return float(np.hypot(*(one.mean(axis=0) - other.mean(axis=0))) / max(_size(one), _size(other)))


def _of_one_board(one: Array, other: Array) -> bool:
    alike = abs(np.log(_size(one) / _size(other))) < 0.3
    return bool(alike and _distance(one, other) < LIMITS.apart)
