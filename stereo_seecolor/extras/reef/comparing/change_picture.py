"""The picture of a change: before, after, height and color."""

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.comparing.site_change import SiteChange

Picture = NDArray[np.uint8]

PANEL_PX = 900
TITLE_PX = 30
LEAST_SCALE_M = 0.02
MOST_DELTA_E = 40.0
RAMP = np.array(
    [(33, 60, 150), (120, 160, 220), (240, 240, 240), (240, 160, 110), (160, 30, 30)], np.float32
)
"""Loss blue, growth red, RGB."""
INK = (20, 20, 20)


def picture(change: SiteChange) -> Picture:
    """Draw the first survey, the second in the first's colors, the change of height with its
    patches, and that of color: (H, W, 3) RGB.
    """
    known = np.isfinite(change.difference.dz_m)
    heights = np.abs(change.difference.dz_m[known])
    scale_m = max(LEAST_SCALE_M, float(np.quantile(heights, 0.995)))
    panels = [
        ("before", _colors(change.before.color, change.before.known)),
        ("after, in the colors of before", _colors(change.color.b_as_a, change.after.known)),
        (
            f"height: blue -{100 * scale_m:.0f} cm, red +{100 * scale_m:.0f} cm",
            _ramp(change.difference.dz_m / scale_m),
        ),
        (
            f"color: white 0, red {MOST_DELTA_E:.0f} CIELAB units",
            _ramp(change.color.delta_e / MOST_DELTA_E),
        ),
    ]
    drawn = [_titled(_sized(image), title) for title, image in panels]
    for number in (2, 3):
        _outline(drawn[number], change, heights_too=number == 2)
    return np.asarray(np.vstack([np.hstack(drawn[:2]), np.hstack(drawn[2:])]))


def _colors(color: NDArray[np.float32], known: NDArray[np.bool_]) -> Picture:
    return np.where(known[..., None], np.nan_to_num(color), 255).clip(0, 255).astype(np.uint8)


def _ramp(values: NDArray[np.floating]) -> Picture:
    """-1 to 1 as RAMP; unknown white."""
    place = (np.clip(np.nan_to_num(values), -1, 1) + 1) * (len(RAMP) - 1) / 2
    image = np.stack(
        [np.interp(place, np.arange(len(RAMP)), RAMP[:, c]) for c in range(3)], axis=-1
    )
    image[~np.isfinite(values)] = 255
    return np.asarray(image.astype(np.uint8))


def _sized(image: Picture) -> Picture:
    factor = PANEL_PX / max(image.shape[:2])
    method = cv2.INTER_AREA if factor < 1 else cv2.INTER_NEAREST
    return np.asarray(cv2.resize(image, None, fx=factor, fy=factor, interpolation=method))


def _titled(image: Picture, title: str) -> Picture:
    framed = cv2.copyMakeBorder(
        image, TITLE_PX, 4, 4, 4, cv2.BORDER_CONSTANT, value=(255, 255, 255)
    )
    cv2.putText(
        framed, title, (8, TITLE_PX - 9), cv2.FONT_HERSHEY_SIMPLEX, 0.6, INK, 1, cv2.LINE_AA
    )
    return np.asarray(framed)


def _outline(image: Picture, change: SiteChange, heights_too: bool) -> None:
    """Draw the patches of a panel, and their numbers, into it."""
    rows, columns = change.before.grid.shape
    factor = PANEL_PX / max(rows, columns)
    for patch in change.patches:
        if (patch.kind in ("growth", "loss")) != heights_too:
            continue
        mask = change.masks[patch.number - 1].astype(np.uint8)
        mask = cv2.resize(mask, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
        contours, _ = cv2.findContours(
            mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(4, TITLE_PX)
        )
        cv2.drawContours(image, contours, -1, INK, 1, cv2.LINE_AA)
        corner = max(contours, key=len)[:, 0].max(axis=0)
        cv2.putText(
            image,
            f"{patch.number}",
            tuple(int(v) for v in corner),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.5,
            INK,
            1,
            cv2.LINE_AA,
        )
