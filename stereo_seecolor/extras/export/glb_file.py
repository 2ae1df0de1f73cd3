"""Binary glTF 2.0 of a map, written part by part: one page of texture is in memory at a time.

Unlit (KHR_materials_unlit), because the colors already contain the light of the dive.
"""

import json
import shutil
import struct
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.mapping.raster.georeference import crs_name
from stereo_seecolor.run_folder.posed_run import PosedRun
from stereo_seecolor.version import __version__

Y_UP = [-float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5))]
"""Quaternion that turns the map's z up to the format's y up."""
COMPONENTS = {np.dtype(np.float32): 5126, np.dtype(np.uint16): 5123, np.dtype(np.uint32): 5125}
SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
LARGEST_BYTES = (1 << 32) - 1
"""The format counts its bytes in 32 bits."""
Attribute = Literal["POSITION", "NORMAL", "COLOR_0", "TEXCOORD_0"]


class Glb:
    """A GLB being written: ``with Glb(path, posed) as glb`` and ``add``; the file is there when the
    block ends well.

    Raises InputError then for more than 4 GB.
    """

    def __init__(self, path: Path, posed: PosedRun) -> None:
        self._path, self._posed = path, posed
        self._bytes = tempfile.TemporaryFile(dir=path.parent)  # noqa: SIM115  # closed by __exit__
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._primitives: list[dict[str, Any]] = []
        self._images: list[dict[str, Any]] = []
        self._materials: list[dict[str, Any]] = []

    def __enter__(self) -> "Glb":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, traceback: object) -> None:
        with self._bytes:
            if kind is None:
                self._save()

    def add(
        self,
        attributes: Mapping[Attribute, NDArray[Any]],
        triangles: NDArray[np.integer],
        jpeg: bytes = b"",
    ) -> None:
        """Triangles (F, 3) of vertices with these attributes (V, n); a texture of them. uint16
        colors are fractions of 65535.
        """
        numbers = {name: self._accessor(array, ARRAY_BUFFER) for name, array in attributes.items()}
        position = attributes["POSITION"]
        self._accessors[numbers["POSITION"]] |= {
            "min": position.min(axis=0).tolist(),
            "max": position.max(axis=0).tolist(),
        }
        if "COLOR_0" in numbers:
            self._accessors[numbers["COLOR_0"]] |= {"normalized": True}
        indices = self._accessor(triangles.astype(np.uint32).reshape(-1, 1), ELEMENT_ARRAY_BUFFER)
        self._primitives.append(
            {"attributes": numbers, "indices": indices, "material": len(self._materials)}
        )
        look: dict[str, Any] = {"metallicFactor": 0}
        if jpeg:
            look["baseColorTexture"] = {"index": len(self._images)}
            self._images.append({"bufferView": self._view(jpeg), "mimeType": "image/jpeg"})
        self._materials.append(
            {"extensions": {"KHR_materials_unlit": {}}, "pbrMetallicRoughness": look}
        )

    def _save(self) -> None:
        document = json.dumps(self._document()).encode()
        document += b" " * (-len(document) % 4)
        size = self._bytes.tell()
        total = 12 + 8 + len(document) + 8 + size
        if total > LARGEST_BYTES:
            raise InputError(
                f"{self._path.name}: the map is too large for one GLB (4 GB): export it --to "
                "3d-tiles"
            )
        with self._path.open("wb") as file:
            file.write(struct.pack("<4sII", b"glTF", 2, total))
            file.write(struct.pack("<I4s", len(document), b"JSON") + document)
            file.write(struct.pack("<I4s", size, b"BIN\0"))
            self._bytes.seek(0)
            shutil.copyfileobj(self._bytes, file)

    def _accessor(self, array: NDArray[Any], target: int) -> int:
        view = self._view(np.ascontiguousarray(array).tobytes(), target)
        kind = {
            "componentType": COMPONENTS[array.dtype],
            "count": len(array),
            "type": SHAPES[array.shape[1]],
        }
        self._accessors.append({"bufferView": view, **kind})
        return len(self._accessors) - 1

    def _view(self, content: bytes, target: int | None = None) -> int:
        about = {"buffer": 0, "byteOffset": self._bytes.tell(), "byteLength": len(content)}
        self._views.append(about | ({} if target is None else {"target": target}))
        self._bytes.write(content + b"\0" * (-len(content) % 4))
        return len(self._views) - 1

    def _document(self) -> dict[str, Any]:
        extras = {"offset_m": self._posed.offset_m.tolist(), "crs": crs_name(self._posed.origin)}
        textures = {
            "images": self._images,
            "textures": [{"source": k} for k in range(len(self._images))],
        }
        return {
            "asset": {
                "version": "2.0",
                "generator": f"stereo-seecolor {__version__}",
                "extras": extras,
            },
            "extensionsUsed": ["KHR_materials_unlit"],
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "rotation": Y_UP, "name": "reef"}],
            "materials": self._materials,
            "meshes": [{"primitives": self._primitives}],
            "buffers": [{"byteLength": self._bytes.tell()}],
            "bufferViews": self._views,
            "accessors": self._accessors,
            **(textures if self._images else {}),
        }


def unit(normals: Sequence[Any] | NDArray[np.float32]) -> NDArray[np.float32]:
    """Normalize (V, 3), as the format requires; straight up where a normal is zero."""
    result = np.array(normals, np.float32)
    lengths = np.linalg.norm(result, axis=1, keepdims=True)
    result[lengths[:, 0] == 0] = (0, 0, 1)
    return (result / np.where(lengths > 0, lengths, 1)).astype(np.float32)
