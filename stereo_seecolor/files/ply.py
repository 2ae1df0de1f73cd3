"""Binary little-endian PLY: a pair's colored points, and the clouds and meshes of a map."""

import mmap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.whole_files import damaged_map, special_kind
from stereo_seecolor.records import Image, Map

POINT = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])
"""A point of a pair's cloud."""
VERTEX = np.dtype([("position", "<f4", 3), ("normal", "<f4", 3), ("color", "u1", 3)])
"""A vertex of a map."""
FACE = np.dtype([("count", "u1"), ("indices", "<i4", 3)])
"""A triangle of a map."""
HEADER_BYTES, FARTHEST_VERTEX_M = 1 << 16, 1e7
"""A longer header, and a vertex farther from the map's origin, are damage."""
AT_ONCE = 1_000_000
"""Records of a file that are checked at once: 13 to 27 MB."""
_PROPERTIES = {
    **{"xyz": ("float x", "float y", "float z"), "position": ("float x", "float y", "float z")},
    **{"normal": ("float nx", "float ny", "float nz")},
    **dict.fromkeys(("rgb", "color"), ("uchar red", "uchar green", "uchar blue")),
}


def header(comment: str, vertex: np.dtype[np.void], points: int, triangles: int = 0) -> bytes:
    """The header before ``points`` records of type ``vertex`` (POINT or VERTEX) and ``triangles``
    records of type FACE.
    """
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {line}" for line in comment.splitlines()),
    ]
    lines.append(f"element vertex {points}")
    lines += [f"property {p}" for name in vertex.names or () for p in _PROPERTIES[name]]
    if triangles:
        lines += [f"element face {triangles}", "property list uchar int vertex_indices"]
    return ("\n".join([*lines, "end_header"]) + "\n").encode("ascii")


def read_vertices(path: Path) -> NDArray[np.void]:
    """The vertices of a map's cloud or mesh, as VERTEX, read from disk where they are used.

    Raises InputError where the file is gone, damaged, or holds a place that is none.
    """
    head = _read_header(path)
    found = _records(path, VERTEX, len(head), _count(path, head, b"vertex"))
    for part in _parts(found):
        if not (np.abs(part["position"]) < FARTHEST_VERTEX_M).all():
            raise damaged_map(path, "a vertex has no finite position")
    return found


def read_triangles(path: Path) -> NDArray[np.void]:
    """The triangles of a map's mesh, as FACE, read from disk where they are used.

    Raises InputError where the file is missing or damaged, or a triangle names an unknown vertex.
    """
    head = _read_header(path)
    vertices = _count(path, head, b"vertex")
    offset = len(head) + vertices * VERTEX.itemsize
    found = _records(path, FACE, offset, _count(path, head, b"face"))
    for part in _parts(found):
        corners = part["indices"]
        if not ((part["count"] == 3).all() and corners.min() >= 0 and corners.max() < vertices):
            raise damaged_map(path, "a triangle names a vertex that does not exist")
    return found


def _parts(records: NDArray[np.void]) -> Iterator[NDArray[np.void]]:
    """Parts of mapped records, whose memory is returned after each."""
    for start in range(0, len(records), AT_ONCE):
        yield records[start : start + AT_ONCE]
        let_go(records)


def _read_header(path: Path) -> bytes:
    try:
        if kind := special_kind(path):
            raise InputError(f"{path}: is {kind}, not a file")
        with path.open("rb") as file:
            head = file.read(HEADER_BYTES)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    content, end, _ = head.partition(b"end_header\n")
    if not content.startswith(b"ply\nformat binary_little_endian 1.0\n") or not end:
        raise damaged_map(path, "no header of a binary PLY")
    properties = b"".join(
        f"property {p}\n".encode() for name in VERTEX.names or () for p in _PROPERTIES[name]
    )
    if properties not in content:
        raise damaged_map(path, "its vertices have other properties")
    return content + end


def _count(path: Path, head: bytes, element: bytes) -> int:
    _, found, rest = head.partition(b"\nelement " + element + b" ")
    number = rest.partition(b"\n")[0]
    if found and not (number.isdigit() and len(number) < 12):
        raise damaged_map(path, f"no number of elements {element.decode()}")
    return int(number) if found else 0


def _records(path: Path, record: np.dtype[np.void], offset: int, count: int) -> NDArray[np.void]:
    if path.stat().st_size < offset + count * record.itemsize:
        raise damaged_map(path, "it is truncated")
    return np.memmap(path, record, "r", offset, (count,)) if count else np.zeros(0, record)


def let_go(*mapped: NDArray[Any]) -> None:
    """Return the memory of mapped files that were read to the system, where it can; they are read
    again where they are used.
    """
    for array in mapped:
        if isinstance(array, np.memmap) and hasattr(mmap, "MADV_DONTNEED"):
            array._mmap.madvise(mmap.MADV_DONTNEED)  # type: ignore[attr-defined]


def encode_cloud(range_m: Map, rays: NDArray[np.float32], rgb: Image) -> memoryview:
    """The pixels with a known range: float32 x y z in meters, uchar red green blue.

    range_m: (H, W), unknown where not finite. rays: (H, W, 3) unit vectors. rgb: (H, W, 3), of 16
    bits the upper 8 are kept.
    """
    points = int(np.count_nonzero(np.isfinite(range_m)))
    head = header(
        "stereo-seecolor, meters, left rectified camera: x right, y down, z forward", POINT, points
    )
    content = np.empty(len(head) + points * POINT.itemsize, np.uint8)
    content[: len(head)] = np.frombuffer(head, np.uint8)
    vertices = content[len(head) :].view(POINT)
    _fill(
        range_m, rays, rgb, np.uint8(8 * (rgb.dtype.itemsize - 1)), vertices["xyz"], vertices["rgb"]
    )
    return content.data


@compiled
def _fill(range_m, rays, rgb, shift, xyz, colors):  # type: ignore[no-untyped-def]
    n = 0
    for row in range(range_m.shape[0]):
        for column in range(range_m.shape[1]):
            meters = range_m[row, column]
            if np.isfinite(meters):
                for i in range(3):
                    xyz[n, i] = rays[row, column, i] * meters
                    colors[n, i] = rgb[row, column, i] >> shift
                n += 1
