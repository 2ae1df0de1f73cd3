"""The textured surface as Wavefront OBJ with MTL and PNG: for CloudCompare, MeshLab, Metashape and most others. z is up."""

from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.texture.atlas import PageMesh
from stereo_seecolor.extras.export.texture.textured import open_surface, textured
from stereo_seecolor.files.encode import encode_image
from stereo_seecolor.mapping.raster.georeference import crs_name
from stereo_seecolor.run_folder.posed_run import PosedRun


def write(posed: PosedRun, folder: Path) -> str:
    """reef.obj, reef.mtl, reef_PAGE.png; how good it is. Raises InputError if an image is gone or damaged."""
    made, offset_m = textured(posed, open_surface(posed)), " ".join(f"{value:.6f}" for value in posed.offset_m)
    with (folder / "reef.obj").open("w", encoding="ascii") as file, (folder / "reef.mtl").open("w", encoding="ascii") as materials:
        file.write(f"# meters, z up; add {offset_m} for: {crs_name(posed.origin)}\nmtllib reef.mtl\n")
        before = 1
        for number, (mesh, pixels) in enumerate(made.pages()):
            name = f"reef_{number}"
            (folder / f"{name}.png").write_bytes(encode_image(pixels, "png"))
            materials.write(f"newmtl {name}\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 0\nmap_Kd {name}.png\n")
            file.write(f"usemtl {name}\n")
            _write_page(file, mesh, made.surface.position[mesh.vertex], before)
            before += len(mesh.vertex)
    return made.summary


def _write_page(file: TextIO, mesh: PageMesh, position: NDArray[np.float64], before: int) -> None:
    """Vertices, places in the texture (from its lower left corner), and triangles, counted on from those before."""
    np.savetxt(file, position, fmt="v %.5f %.5f %.5f")
    np.savetxt(file, np.stack([mesh.uv[:, 0], 1 - mesh.uv[:, 1]], axis=1), fmt="vt %.7f %.7f")
    np.savetxt(file, np.repeat(mesh.triangles + before, 2, axis=1), fmt="f %d/%d %d/%d %d/%d")


FORMAT = ExportFormat("the same as OBJ, MTL and PNG", "CloudCompare, MeshLab, Metashape, Blender", write)
