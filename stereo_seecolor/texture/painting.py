"""Pages of texture: charts packed as rectangles, each cut out of its image, row after row."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.texture.charts import Charts
from stereo_seecolor.texture.surface import PaintedSurface
from stereo_seecolor.texture.views import Views

MOST_PX = 4096
"""A side of a page, unless an image is larger: what every browser and phone takes."""
PAD_PX = 4
"""Around a chart, in pixels of the page: what smaller copies of a texture mix in."""
BLOCK_PX = 4
"""A side of the patch of a triangle that no view shows: it has the colors of its corners."""


@dataclass(frozen=True, eq=False)
class Page:
    """A page of texture.

    size: (width, height). step: pixels of the images to one of the page. charts (n,), and for each
    the rectangle of its view, source (n, 4) as left, top, width, height, and its place (n, 2) in
    the page. unseen (m,): triangles without a view, and block (m, 2): their places.
    """

    size: tuple[int, int]
    step: int
    charts: NDArray[np.int64]
    source: NDArray[np.int64]
    place: NDArray[np.int64]
    unseen: NDArray[np.int64]
    block: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class PageMesh:
    """The triangles of a page. vertex (N,): numbers in the surface. uv (N, 2): from the page's top
    left corner, 0 to 1.

    triangles (F, 3): into them.
    """

    vertex: NDArray[np.int64]
    uv: NDArray[np.float32]
    triangles: NDArray[np.int64]


def pack(charts: Charts, group: int, unseen: NDArray[np.int64], step: int) -> list[Page]:
    """The pages of a group's charts, and of triangles that no view shows."""
    own = np.flatnonzero(charts.group == group)
    source = _sources(charts, own, step)
    sizes = np.concatenate([source[:, 2:] // step, np.full((len(unseen), 2), BLOCK_PX, np.int64)])
    pages = []
    for chosen, places, size in _shelves(sizes):
        chart, block = chosen < len(own), chosen >= len(own)
        of_chart = chosen[chart]
        faces = unseen[chosen[block] - len(own)]
        pages.append(
            Page(size, step, own[of_chart], source[of_chart], places[chart], faces, places[block])
        )
    return pages


def page_mesh(
    charts: Charts, page: Page, triangles: NDArray[np.int32], of_chart: Sequence[NDArray[np.int64]]
) -> PageMesh:
    """Vertices of a page, with their places in it. of_chart: triangles of each chart."""
    faces = np.concatenate([np.zeros(0, np.int64), *(of_chart[chart] for chart in page.charts)])
    nodes, inverse = np.unique(charts.node[faces], return_inverse=True)
    position = np.zeros(len(charts.view), np.int64)
    position[page.charts] = np.arange(len(page.charts))
    at = position[charts.chart[nodes]]
    uv = (charts.pixel[nodes] + 0.5 - page.source[at, :2]) / page.step + page.place[at]
    corners = np.array([[0.5, 0.5], [BLOCK_PX - 0.5, 0.5], [0.5, BLOCK_PX - 0.5]])
    blocks = (page.block[:, None] + corners).reshape(-1, 2)
    vertex = np.concatenate([charts.vertex[nodes], triangles[page.unseen].ravel()])
    more = len(nodes) + np.arange(3 * len(page.unseen)).reshape(-1, 3)
    places = np.asarray(np.concatenate([uv, blocks]) / page.size, np.float32)
    return PageMesh(vertex, places, np.concatenate([inverse.reshape(-1, 3), more]))


def _sources(charts: Charts, own: NDArray[np.int64], step: int) -> NDArray[np.int64]:
    """(n, 4) rectangles of the views around charts, whole steps with the pad around."""
    low, high = np.full((len(charts.view), 2), np.inf), np.full((len(charts.view), 2), -np.inf)
    np.minimum.at(low, charts.chart, charts.pixel)
    np.maximum.at(high, charts.chart, charts.pixel)
    start = (np.floor(low[own] / step) - PAD_PX) * step
    end = (np.ceil((high[own] + 1) / step) + PAD_PX) * step
    return np.concatenate([start, end - start], axis=1).astype(np.int64)


def _shelves(
    sizes: NDArray[np.int64],
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], tuple[int, int]]]:
    """Rectangles (width, height) in rows of falling height: placed ones, places, page size."""
    if not len(sizes):
        return
    most = max(MOST_PX, int(sizes.max()))
    width = int(min(most, max(sizes[:, 0].max(), np.ceil(1.1 * np.sqrt(sizes.prod(axis=1).sum())))))
    order = np.argsort(-sizes[:, 1], kind="stable")
    places = np.zeros((len(sizes), 2), np.int64)
    x = y = shelf = begun = 0
    for number, rectangle in enumerate(order.tolist()):
        w, h = sizes[rectangle].tolist()
        if x + w > width:
            x, y, shelf = 0, y + shelf, 0
        if y + h > most:
            yield order[begun:number], places[order[begun:number]], (width, y)
            x, y, shelf, begun = 0, 0, 0, number
        places[rectangle] = x, y
        x, shelf = x + w, max(shelf, h)
    yield order[begun:], places[order[begun:]], (width, y + shelf)


def paint(
    views: Views,
    surface: PaintedSurface,
    charts: Charts,
    page: Page,
    of_chart: Sequence[NDArray[np.int64]],
) -> NDArray[np.uint8]:
    """Paint a page: (H, W, 3) RGB. of_chart: triangles of each chart. Raises InputError."""
    width, height = page.size
    between = int(surface.color.mean())  # what coarser copies of the texture mix in
    result = np.full((height, width, 3), between, np.uint8)
    for i in np.argsort(charts.view[page.charts], kind="stable"):  # each image is read once
        chart, (x, y) = page.charts[i], page.place[i]
        faces = of_chart[chart]
        corners = charts.node[faces]
        shown = (charts.pixel[corners], charts.correction[corners], charts.on_edge[faces])
        image, source = views.picture(int(charts.view[chart])).image, page.source[i]
        if page.step == 1:
            cut(image, source, shown, PAD_PX, result, page.place[i])
            continue
        size = source[2:] // page.step
        patch = np.full((source[3], source[2], 3), between, np.uint8)
        cut(image, source, shown, PAD_PX * page.step, patch, np.zeros(2, np.int64))
        part = cv2.resize(patch, size.tolist(), interpolation=cv2.INTER_AREA)
        result[y : y + len(part), x : x + part.shape[1]] = part
    ramp = np.linspace(0, 1, BLOCK_PX)
    for face, (x, y) in zip(page.unseen, page.block, strict=True):
        a, b, c = surface.color[surface.triangles[face]].astype(np.float64)
        mixed = a + ramp[None, :, None] * (b - a) + ramp[:, None, None] * (c - a)
        result[y : y + BLOCK_PX, x : x + BLOCK_PX] = np.clip(np.rint(mixed), 0, 255)
    return result


@compiled
def cut(image, source, shown, margin_px, page, place):  # type: ignore[no-untyped-def]
    """Cut triangles out of an image into a page at a place (2,), with their corrections; those on
    the chart's edge with ``margin_px`` around. source: left, top, width and height in the image.
    """
    left, top, width, height = source
    pixel, correction, on_edge = shown
    done = np.zeros((height, width), np.uint8)  # 2 in a triangle, 1 beside one
    for f in range(len(pixel)):
        ax, ay = pixel[f, 0, 0] - left, pixel[f, 0, 1] - top
        bx, by = pixel[f, 1, 0] - left, pixel[f, 1, 1] - top
        cx, cy = pixel[f, 2, 0] - left, pixel[f, 2, 1] - top
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0:
            continue
        margin = margin_px if on_edge[f] else 1
        first_x = max(0, int(np.floor(min(ax, bx, cx))) - margin)
        last_x = min(width - 1, int(np.ceil(max(ax, bx, cx))) + margin)
        first_y = max(0, int(np.floor(min(ay, by, cy))) - margin)
        last_y = min(height - 1, int(np.ceil(max(ay, by, cy))) + margin)
        for y in range(first_y, last_y + 1):
            row = min(max(top + y, 0), image.shape[0] - 1)
            for x in range(first_x, last_x + 1):
                if done[y, x] == 2:
                    continue
                v = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
                w = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
                within = v >= 0 and w >= 0 and v + w <= 1
                if done[y, x] == 1 and not within:
                    continue
                done[y, x] = 2 if within else 1
                column = min(max(left + x, 0), image.shape[1] - 1)
                corrected(image[row, column], correction[f], v, w, page[place[1] + y, place[0] + x])


@compiled(inline=True)
def corrected(color, correction, v, w, into):  # type: ignore[no-untyped-def]
    """A color with the correction of a place in a triangle, the nearest of it beyond."""
    u, v, w = max(1 - v - w, 0.0), max(v, 0.0), max(w, 0.0)
    total = u + v + w
    for c in range(3):
        added = u * correction[0, c] + v * correction[1, c] + w * correction[2, c]
        into[c] = np.uint8(min(max(np.rint(color[c] + added / total), 0), 255))
