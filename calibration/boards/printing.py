"""Print a target at its true size: PDF with exact rectangles, or PNG of a stated resolution."""

import struct
import zlib
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from calibration.aprilgrid import CELLS, AprilGrid, marker
from calibration.boards.targets import Charuco, Chessboard, Target
from calibration.errors import CalibrationError
from calibration.files import write_atomic

POINTS_PER_M = 72 / 0.0254  # of PDF: 72 an inch
MAX_PIXELS = 200_000_000  # A0 at 200 dots an inch is 61 million; more is a mistake of unit
NOTE_M = 0.006  # height of the line that says what was printed


class _Rectangle(NamedTuple):
    x_m: float
    y_m: float
    width_m: float
    height_m: float
    black: bool


def print_target(target: Target, path: Path, dpi: int = 300) -> None:
    """Write ``target`` with a margin of one square or tag: ``.pdf`` at any size, or ``.png`` that
    carries its dpi.

    Raises CalibrationError for another extension, a PNG too large to be meant, or a place that
    cannot be written.
    """
    if path.suffix.lower() not in (".pdf", ".png"):
        raise CalibrationError(f"{path}: a target can be written as .pdf or .png")
    content = _pdf(target) if path.suffix.lower() == ".pdf" else _png(target, dpi)
    try:
        with write_atomic(path) as temporary:
            temporary.write_bytes(content)
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be written: {error.strerror or error}") from error


def _squares(target: Chessboard | Charuco) -> tuple[int, int]:
    if isinstance(target, Chessboard):
        return target.columns + 1, target.rows + 1
    return target.columns, target.rows


def _page_m(target: Target) -> tuple[float, float]:
    if isinstance(target, AprilGrid):
        across_m, down_m = (
            number * (target.tag_m + target.space_m) for number in (target.columns, target.rows)
        )
        margin_m = 2 * target.tag_m + target.space_m
        return across_m + margin_m, down_m + margin_m + NOTE_M
    columns, rows = _squares(target)
    return (columns + 2) * target.square_m, (rows + 2) * target.square_m + NOTE_M


def _note(target: Target) -> str:
    if isinstance(target, AprilGrid):
        across_mm = 1000 * (target.columns * (target.tag_m + target.space_m) - target.space_m)
        tags = (
            f"{target.columns} x {target.rows} tags of {target.tag_m * 1000:g} mm, "
            f"{target.space_m * 1000:g} mm apart"
        )
        return (
            f"AprilGrid 36h11, {tags}. Print at 100 %: the tags must measure {across_mm:g} mm "
            "across."
        )
    columns, rows = _squares(target)
    kind = f"ChArUco {target.dictionary}" if isinstance(target, Charuco) else "chessboard"
    across_mm = columns * target.square_m * 1000
    squares = f"{columns} x {rows} squares of {target.square_m * 1000:g} mm"
    return f"{kind}, {squares}. Print at 100 %: the squares must measure {across_mm:g} mm across."


def _rectangles(target: Target) -> list[_Rectangle]:
    """What to paint, in order, meters from the page's top left corner."""
    if isinstance(target, AprilGrid):
        return _april_rectangles(target)
    columns, rows = _squares(target)
    side = target.square_m
    if isinstance(target, Chessboard):
        black = [(i, j) for j in range(rows) for i in range(columns) if (i + j) % 2 == 0]
        return [_Rectangle((i + 1) * side, (j + 1) * side, side, side, True) for i, j in black]
    return _charuco_rectangles(target)


def _charuco_rectangles(target: Charuco) -> list[_Rectangle]:
    board, side = target.board(), target.square_m
    markers = {
        int(number): corners[0, :2]
        for number, corners in zip(board.getIds(), np.array(board.getObjPoints()), strict=True)
    }
    with_marker = {(round(float(x // side)), round(float(y // side))) for x, y in markers.values()}
    rectangles = [
        _Rectangle((i + 1) * side, (j + 1) * side, side, side, True)
        for j in range(target.rows)
        for i in range(target.columns)
        if (i, j) not in with_marker
    ]
    dictionary = board.getDictionary()
    cells = dictionary.markerSize + 2
    cell = target.marker_m / cells
    for number, (x, y) in markers.items():
        rectangles.append(_Rectangle(x + side, y + side, target.marker_m, target.marker_m, True))
        picture = cv2.aruco.generateImageMarker(dictionary, number, cells)
        for row, column in np.argwhere(picture > 0).tolist():
            rectangles.append(
                _Rectangle(x + side + column * cell, y + side + row * cell, cell, cell, False)
            )
    return rectangles


def _april_rectangles(target: AprilGrid) -> list[_Rectangle]:
    """Tags, and the squares that touch their corners: each corner is one of a chessboard."""
    pitch, cell, space = target.tag_m + target.space_m, target.tag_m / CELLS, target.space_m
    rectangles = [
        _Rectangle(target.tag_m + column * pitch, target.tag_m + row * pitch, space, space, True)
        for row in range(target.rows + 1)
        for column in range(target.columns + 1)
    ]
    for number, corner in enumerate(target.points_m[::4, :2] + pitch):
        x, y = corner.tolist()
        rectangles.append(_Rectangle(x, y, target.tag_m, target.tag_m, True))
        for row, column in np.argwhere(~marker(target.first_id + number)).tolist():
            rectangles.append(_Rectangle(x + column * cell, y + row * cell, cell, cell, False))
    return rectangles


def _pdf(target: Target) -> bytes:
    """One page of filled rectangles and one line of text (PDF 1.4, ISO 32000-1)."""
    width, height = (length * POINTS_PER_M for length in _page_m(target))
    lines = [f"BT /F1 8 Tf 12 8 Td ({_note(target)}) Tj ET"]
    for x, y, w, h, black in _rectangles(target):
        corner = f"{x * POINTS_PER_M:.4f} {height - (y + h) * POINTS_PER_M:.4f}"
        lines.append(
            f"{0 if black else 1} g {corner} {w * POINTS_PER_M:.4f} {h * POINTS_PER_M:.4f} re f"
        )
    content = zlib.compress("\n".join(lines).encode())
    page = (
        f"/Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents 4 0 R /Resources << "
        "/Font << /F1 5 0 R >> >>"
    )
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page {page} >>".encode(),
        f"<< /Length {len(content)} /Filter /FlateDecode >>\nstream\n".encode()
        + content
        + b"\nendstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    document = b"%PDF-1.4\n"
    offsets = []
    for number, body in enumerate(objects, 1):
        offsets.append(len(document))
        document += f"{number} 0 obj\n".encode() + body + b"\nendobj\n"
    table = "".join(f"{offset:010d} 00000 n \n" for offset in offsets)
    return document + (
        f"xref\n0 6\n0000000000 65535 f \n{table}trailer\n<< /Size 6 /Root 1 0 R "
        f">>\nstartxref\n{len(document)}\n%%EOF\n".encode()
    )


def _png(target: Target, dpi: int) -> bytes:
    pixels_per_m = dpi / 0.0254
    width, height = (round(length * pixels_per_m) for length in _page_m(target))
    if dpi < 1 or width * height > MAX_PIXELS:
        raise CalibrationError(
            f"the target at {dpi} dpi has {width}x{height} pixels: choose fewer dpi, or print a PDF"
        )
    image = np.full((height, width), 255, np.uint8)
    for x, y, w, h, black in _rectangles(target):
        left, top, right, bottom = (round(edge * pixels_per_m) for edge in (x, y, x + w, y + h))
        image[top:bottom, left:right] = 0 if black else 255
    cv2.putText(
        image,
        _note(target),
        (12, height - 12),
        cv2.FONT_HERSHEY_SIMPLEX,
        dpi / 500,
        0,
        1,
        cv2.LINE_AA,
    )
    encoded: bytes = cv2.imencode(".png", image)[1].tobytes()
    size = b"pHYs" + struct.pack(">IIB", round(pixels_per_m), round(pixels_per_m), 1)
    chunk = struct.pack(">I", 9) + size + struct.pack(">I", zlib.crc32(size))
    after_header = 8 + 25  # signature and IHDR, the PNG specification's fixed lengths
    return encoded[:after_header] + chunk + encoded[after_header:]
