"""The textured surface as binary glTF 2.0: for Blender, game engines, phones and web viewers."""

from pathlib import Path

import cv2
import numpy as np

from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.gltf import Glb, unit
from stereo_seecolor.extras.export.texture.textured import Textured, open_surface, textured
from stereo_seecolor.run_folder.posed_run import PosedRun

QUALITY = 95
"""Of the textures' JPEG, with full color resolution: errors below those of the images' noise, a fifth of a PNG's size."""


def write(posed: PosedRun, folder: Path) -> str:
    """reef.glb; how good it is. Raises InputError for more than 4 GB, or if an image is gone or damaged."""
    made = textured(posed, open_surface(posed))
    write_group(made, folder / "reef.glb")
    return made.summary


def write_group(made: Textured, path: Path, group: int = 0, step: int = 1) -> None:
    """The triangles of one group."""
    with Glb(path, made.views.posed) as glb:
        for mesh, pixels in made.pages(group, step):
            position = made.surface.position[mesh.vertex].astype(np.float32)
            normal = unit(made.surface.normal[mesh.vertex])
            flags = [cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
            jpeg = cv2.imencode(".jpg", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), flags)[1].tobytes()
            glb.add({"POSITION": position, "NORMAL": normal, "TEXCOORD_0": mesh.uv}, mesh.triangles, jpeg)


FORMAT = ExportFormat(
    "the surface with the images on it, glTF 2.0", "Blender, three.js, Unreal and Unity, phones, Sketchfab", write
)
