"""The surface of a map with its texture, page by page, as binary glTF 2.0 and as Wavefront OBJ."""

from pathlib import Path
from typing import TextIO

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.glb_file import Glb, unit
from stereo_seecolor.extras.export.simplified_surface import SimplifiedSurface, read_surface
from stereo_seecolor.files.encode import encode_image
from stereo_seecolor.mapping.raster.georeference import crs_name
from stereo_seecolor.run_folder.posed_run import PosedRun
from stereo_seecolor.texture.painting import PageMesh
from stereo_seecolor.texture.textured import Textured, textured
from stereo_seecolor.texture.views import Views


def summary(made: Textured, surface: SimplifiedSurface) -> str:
    """The outcome of the map's surface, for a person."""
    pixel_mm = 1000 * made.views.posed.pixel_m
    largest_mm, bound_mm, rms_mm = (
        1000 * value for value in (surface.largest_m, surface.bound_m, surface.rms_m)
    )
    seen, frames = float((made.charts.of_face >= 0).mean()), len(np.unique(made.charts.view))
    return (
        f"{len(surface.triangles):,} of {surface.original:,} triangles; the map's vertices lie "
        f"at most {largest_mm:.2f} mm from them (bound {bound_mm:.2f} mm, rms {rms_mm:.2f} "
        f"mm); texture at the images' {pixel_mm:.2f} mm per pixel from {frames} frames, on "
        f"{seen:.1%} of the triangles"
    )


def open_surface(posed: PosedRun) -> SimplifiedSurface:
    """The run's mesh, with as few triangles as the bound allows. Raises InputError if empty."""
    surface = read_surface(posed)
    if not len(surface.triangles):
        raise InputError(f"{posed.map_folder}: its mesh has no triangles")
    return surface


def painted(
    views: Views, surface: SimplifiedSurface, group: NDArray[np.int64] | None = None
) -> Textured:
    """The surface with all images on it. Raises InputError if one is gone or damaged."""
    made = textured(views, surface, group)
    for message in views.unreadable.values():
        raise InputError(message)
    return made


QUALITY = 95
"""Of the textures' JPEG, with full color resolution: errors below those of the images' noise, a
fifth of a PNG's size.
"""


def write_textured_glb(posed: PosedRun, folder: Path) -> str:
    """Write reef.glb (binary glTF 2.0); return how good it is. Raises InputError for more than 4
    GB, or if an image is gone or damaged.
    """
    surface = open_surface(posed)
    made = painted(Views(posed), surface)
    write_group(made, surface, folder / "reef.glb")
    return summary(made, surface)


def write_group(
    made: Textured, surface: SimplifiedSurface, path: Path, group: int = 0, step: int = 1
) -> None:
    """The triangles of one group."""
    with Glb(path, made.views.posed) as glb:
        for mesh, pixels in made.pages(group, step):
            position = surface.position[mesh.vertex].astype(np.float32)
            normal = unit(surface.normal[mesh.vertex])
            flags = [
                cv2.IMWRITE_JPEG_QUALITY,
                QUALITY,
                cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
                cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
            ]
            jpeg = cv2.imencode(".jpg", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), flags)[1].tobytes()
            glb.add(
                {"POSITION": position, "NORMAL": normal, "TEXCOORD_0": mesh.uv},
                mesh.triangles,
                jpeg,
            )


TEXTURED_GLB = ExportFormat(
    "the surface with the images on it, glTF 2.0",
    "Blender, three.js, Unreal and Unity, phones, Sketchfab",
    write_textured_glb,
)


def write_textured_obj(posed: PosedRun, folder: Path) -> str:
    """Write reef.obj (z up), reef.mtl and reef_PAGE.png; return how good they are. Raises
    InputError if an image is gone or damaged.
    """
    surface = open_surface(posed)
    made = painted(Views(posed), surface)
    offset_m = " ".join(f"{value:.6f}" for value in posed.offset_m)
    with (
        (folder / "reef.obj").open("w", encoding="ascii") as file,
        (folder / "reef.mtl").open("w", encoding="ascii") as materials,
    ):
        file.write(
            f"# meters, z up; add {offset_m} for: {crs_name(posed.origin)}\nmtllib reef.mtl\n"
        )
        before = 1
        for number, (mesh, pixels) in enumerate(made.pages()):
            name = f"reef_{number}"
            (folder / f"{name}.png").write_bytes(encode_image(pixels, "png"))
            materials.write(
                f"newmtl {name}\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 0\nmap_Kd {name}.png\n"
            )
            file.write(f"usemtl {name}\n")
            _write_page(file, mesh, surface.position[mesh.vertex], before)
            before += len(mesh.vertex)
    return summary(made, surface)


def _write_page(file: TextIO, mesh: PageMesh, position: NDArray[np.float64], before: int) -> None:
    """Vertices, places in the texture (from its lower left corner), and triangles, counted on from
    those before.
    """
    np.savetxt(file, position, fmt="v %.5f %.5f %.5f")
    np.savetxt(file, np.stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]], axis=1), fmt="vt %.7f %.7f")
    np.savetxt(file, np.repeat(mesh.triangles + before, 2, axis=1), fmt="f %d/%d %d/%d %d/%d")


TEXTURED_OBJ = ExportFormat(
    "the textured surface as OBJ, MTL and PNG",
    "CloudCompare, MeshLab, Metashape, Blender",
    write_textured_obj,
)
