"""Changes of a reef between two dives: corals grow, are removed, bleach; sand moves."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.synthetic.bottom import SAND
from stereo_seecolor.extras.synthetic.reef import CELL_M, Reef, blocks, mips

EDGE_M = 0.01
"""Over which a change begins."""
BLEACHED = (0.72, 0.70, 0.64)


@dataclass(frozen=True)
class Change:
    """A change within ``radius_m`` of (x_m, y_m). amount_m: the largest rise; for ``removed`` what
    is left above the ground.
    """

    kind: Literal["grown", "removed", "bleached", "sand"]
    x_m: float
    y_m: float
    radius_m: float
    amount_m: float = 0.02


def changed_reef(reef: Reef, changes: Sequence[Change]) -> Reef:
    """The reef after all of them, one after the other; its own origin and size."""
    height, color = reef.height_m.copy(), reef.color[0].copy()
    y, x = (np.indices(height.shape) * CELL_M).astype(np.float32)
    for change in changes:
        distance = np.hypot(x + reef.origin_m[0] - change.x_m, y + reef.origin_m[1] - change.y_m)
        inside = np.clip((change.radius_m - distance) / EDGE_M, 0, 1)
        _apply(change, height, color, distance, inside)
    return replace(reef, height_m=height, color=mips(color), blocks=blocks(height))


def _apply(
    change: Change,
    height: NDArray[np.float32],
    color: NDArray[np.float32],
    distance: NDArray[np.float32],
    inside: NDArray[np.float32],
) -> None:
    """One change, in place."""
    if change.kind == "grown":
        height += change.amount_m * inside
    elif change.kind == "sand":
        height += change.amount_m * np.clip(1 - (distance / change.radius_m) ** 2, 0, 1)
        _paint(color, np.clip(2 * inside, 0, 1), SAND)
    elif change.kind == "removed":
        rim = (distance > change.radius_m) & (distance < change.radius_m + 0.05)
        ground = np.float32(np.quantile(height[rim], 0.25) + change.amount_m)
        rough = cv2.GaussianBlur(height, (0, 0), 2) - cv2.GaussianBlur(height, (0, 0), 8)
        height += inside * (np.minimum(ground + 0.3 * rough, height) - height)
        _paint(color, 0.8 * inside, (0.2, 0.18, 0.14))
    else:
        _paint(color, 0.9 * inside, BLEACHED)


def _paint(
    color: NDArray[np.float32], share: NDArray[np.float32], paint: tuple[float, float, float]
) -> None:
    """Cover the lit color (..., 4) with a paint that is as light and dark as what it covers."""
    brightness = color[..., :3].mean(axis=-1, keepdims=True)
    shade = np.clip(brightness / max(float(np.median(brightness)), 1e-6), 0.5, 1.3)
    color[..., :3] += share[..., None] * (shade * np.array(paint, np.float32) - color[..., :3])
