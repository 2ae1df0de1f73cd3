"""The mesh as binary glTF 2.0: for Blender, game engines, phones and web viewers.

Colors are linear light, as the format asks, in 16 bits; unlit (KHR_materials_unlit), since the light of the dive is in them.
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.export.posed_run import PosedRun
from stereo_seecolor.files.ply import read_triangles, read_vertices
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.mapping.raster.georeference import crs_name
from stereo_seecolor.run_folder.layout import MESH
from stereo_seecolor.version import __version__

Y_UP = [-float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5))]
"""Quaternion that turns the map's z up to the format's y up."""
FLOAT, UNSIGNED_SHORT, UNSIGNED_INT = 5126, 5123, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
LARGEST_BYTES = (1 << 32) - 1
"""The format counts its bytes in 32 bits."""


def write(posed: PosedRun, folder: Path) -> None:
    """mesh.glb. Raises InputError for a mesh of more than 4 GB."""
    mesh = posed.map_folder / MESH
    vertices, triangles = read_vertices(mesh), read_triangles(mesh)
    arrays: dict[str, NDArray[Any]] = {
        "position": np.ascontiguousarray(vertices["position"], np.float32),
        "normal": _unit(vertices["normal"]),
        "color": _linear(vertices["color"]),
        "triangles": np.ascontiguousarray(triangles["indices"]).astype(np.uint32).reshape(-1),
    }
    document = json.dumps(_document(posed, arrays)).encode()
    document += b" " * (-len(document) % 4)
    size = sum(array.nbytes for array in arrays.values())
    total = 12 + 8 + len(document) + 8 + size
    if total > LARGEST_BYTES:
        raise InputError(f"{mesh}: is too large for one GLB (4 GB): fuse with a larger mapping.voxel_m")
    with (folder / "mesh.glb").open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, total))
        file.write(struct.pack("<I4s", len(document), b"JSON") + document)
        file.write(struct.pack("<I4s", size, b"BIN\0"))
        for array in arrays.values():
            file.write(array.tobytes())


def _document(posed: PosedRun, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    position = arrays["position"]
    kinds = {"position": (FLOAT, "VEC3"), "normal": (FLOAT, "VEC3"), "color": (UNSIGNED_SHORT, "VEC4")}
    kinds["triangles"] = (UNSIGNED_INT, "SCALAR")
    views, accessors, offset = [], [], 0
    for number, (name, array) in enumerate(arrays.items()):
        target = ELEMENT_ARRAY_BUFFER if name == "triangles" else ARRAY_BUFFER
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": array.nbytes, "target": target})
        component, kind = kinds[name]
        accessors.append({"bufferView": number, "componentType": component, "count": len(array), "type": kind})
        offset += array.nbytes
    accessors[0] |= {"min": position.min(axis=0).tolist(), "max": position.max(axis=0).tolist()}
    accessors[2] |= {"normalized": True}
    extras = {"offset_m": posed.offset_m.tolist(), "crs": crs_name(posed.origin)}
    attributes = {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2}
    return {
        "asset": {"version": "2.0", "generator": f"stereo-seecolor {__version__}", "extras": extras},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "rotation": Y_UP, "name": "reef"}],
        "materials": [{"extensions": {"KHR_materials_unlit": {}}, "pbrMetallicRoughness": {"metallicFactor": 0}}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 3, "material": 0}]}],
        "buffers": [{"byteLength": offset}],
        "bufferViews": views,
        "accessors": accessors,
    }


def _unit(normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit length, as the format asks; straight up where a normal is zero."""
    result = np.array(normals, np.float32)
    lengths = np.linalg.norm(result, axis=1, keepdims=True)
    result[lengths[:, 0] == 0] = (0, 0, 1)
    return (result / np.where(lengths > 0, lengths, 1)).astype(np.float32)


def _linear(color: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """(V, 4): linear light in 16 bits, and full opacity."""
    curve = np.round(65535 * decode_srgb(np.arange(256) / 255)).astype(np.uint16)
    return np.concatenate([curve[np.asarray(color)], np.full((len(color), 1), 65535, np.uint16)], axis=1)
