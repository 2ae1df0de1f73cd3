"""The mesh with its vertices' colors as binary glTF 2.0: linear light in 16 bits, as asked."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.glb_file import Attribute, Glb, unit
from stereo_seecolor.files.ply import read_triangles, read_vertices
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.run_folder.layout import MESH
from stereo_seecolor.run_folder.posed_run import PosedRun


def write(posed: PosedRun, folder: Path) -> None:
    """mesh.glb. Raises InputError for a mesh of more than 4 GB."""
    mesh = posed.map_folder / MESH
    vertices, triangles = read_vertices(mesh), read_triangles(mesh)
    position = np.ascontiguousarray(vertices["position"], np.float32)
    attributes: dict[Attribute, NDArray[Any]] = {
        "POSITION": position,
        "NORMAL": unit(vertices["normal"]),
        "COLOR_0": _linear(vertices["color"]),
    }
    with Glb(folder / "mesh.glb", posed) as glb:
        glb.add(attributes, np.ascontiguousarray(triangles["indices"]))


def _linear(color: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """(V, 4): linear light in 16 bits, and full opacity."""
    curve = np.round(65535 * decode_srgb(np.arange(256) / 255)).astype(np.uint16)
    return np.concatenate(
        [curve[np.asarray(color)], np.full((len(color), 1), 65535, np.uint16)], axis=1
    )


FORMAT = ExportFormat(
    "the whole mesh with the colors of its vertices, glTF 2.0",
    "Blender, three.js, Windows and phone viewers, Sketchfab",
    write,
)
