"""Painting of a page of texture: pixels of the images, with the corrections that level the seams."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.extras.export.texture.atlas import BLOCK_PX, PAD_PX, Page
from stereo_seecolor.extras.export.texture.charts import Charts
from stereo_seecolor.extras.export.texture.surface import Surface
from stereo_seecolor.extras.export.texture.views import Views


def paint(views: Views, surface: Surface, charts: Charts, page: Page, of_chart: Sequence[NDArray[np.int64]]) -> NDArray[np.uint8]:
    """Paint a page: (H, W, 3) RGB. of_chart: the triangles of each chart. Raises InputError if an image is gone or damaged."""
    width, height = page.size
    result = np.zeros((height, width, 3), np.uint8)
    for i in np.argsort(charts.view[page.charts], kind="stable"):  # each image is read once
        chart = page.charts[i]
        left, top, w, h = page.source[i]
        image = views.image(int(charts.view[chart]))
        rows, columns = (
            np.clip(np.arange(a, a + n), 0, size - 1) for a, n, size in ((top, h, len(image)), (left, w, image.shape[1]))
        )
        corners = charts.node[of_chart[chart]]
        patch = _leveled(
            image[np.ix_(rows, columns)], charts.pixel[corners] - (left, top), charts.correction[corners], PAD_PX * page.step
        )
        if page.step > 1:
            patch = cv2.resize(patch, (int(w) // page.step, int(h) // page.step), interpolation=cv2.INTER_AREA)
        x, y = page.place[i]
        result[y : y + len(patch), x : x + patch.shape[1]] = patch
    ramp = np.linspace(0, 1, BLOCK_PX)
    for face, (x, y) in zip(page.unseen, page.block, strict=True):
        a, b, c = surface.color[surface.triangles[face]].astype(np.float64)
        mixed = a + ramp[None, :, None] * (b - a) + ramp[:, None, None] * (c - a)
        result[y : y + BLOCK_PX, x : x + BLOCK_PX] = np.clip(np.rint(mixed), 0, 255)
    return result


def _leveled(
    patch: NDArray[np.uint8], corners: NDArray[np.float64], correction: NDArray[np.float32], margin_px: int
) -> NDArray[np.uint8]:
    """A patch with the corrections of its triangles, (F, 3, 2) pixels and (F, 3, 3); beyond them its mean color."""
    added = np.zeros(patch.shape, np.float32)
    inside = np.zeros(patch.shape[:2], np.uint8)
    spread(added, inside, corners, correction, margin_px)
    result: NDArray[np.uint8] = np.clip(np.rint(patch + added), 0, 255).astype(np.uint8)
    if (inside == 2).any():
        result[inside == 0] = result[inside == 2].mean(axis=0)
    return result


@compiled
def spread(added, inside, corners, correction, margin_px):  # type: ignore[no-untyped-def]
    """Interpolate corrections over triangles, and up to ``margin_px`` beyond them. inside: 2 in a triangle, 1 beside one."""
    height, width = inside.shape
    for f in range(len(corners)):
        ax, ay, bx, by = corners[f, 0, 0], corners[f, 0, 1], corners[f, 1, 0], corners[f, 1, 1]
        cx, cy = corners[f, 2, 0], corners[f, 2, 1]
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0:
            continue
        left = max(0, int(np.floor(min(ax, bx, cx))) - margin_px)
        right = min(width - 1, int(np.ceil(max(ax, bx, cx))) + margin_px)
        top = max(0, int(np.floor(min(ay, by, cy))) - margin_px)
        bottom = min(height - 1, int(np.ceil(max(ay, by, cy))) + margin_px)
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                if inside[y, x] == 2:
                    continue
                v = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
                w = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
                u = 1 - v - w
                within = u >= 0 and v >= 0 and w >= 0
                if not within:
                    if inside[y, x] == 1:
                        continue
                    u, v, w = max(u, 0.0), max(v, 0.0), max(w, 0.0)
                    total = u + v + w
                    u, v, w = u / total, v / total, w / total
                for k in range(3):
                    added[y, x, k] = u * correction[f, 0, k] + v * correction[f, 1, k] + w * correction[f, 2, k]
                inside[y, x] = 2 if within else 1
