"""The export formats: what each is for, and the function that writes it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.extras.export import (
    biigle,
    colmap,
    copc_file,
    glb,
    ifdo,
    kwiver,
    metashape,
    mosaic_tiles,
    nerfstudio,
    stac,
    taglab,
    textured_glb,
    textured_obj,
    tiles_3d,
)
from stereo_seecolor.extras.streams import mcap_file
from stereo_seecolor.run_folder.posed_run import PosedRun


@dataclass(frozen=True)
class ExportFormat:
    """An export format. what: what is written. opens: the programs it is for. write: returns a note for the user, or None."""

    what: str
    opens: str
    write: Callable[[PosedRun, Path], str | None]


EXPORT_FORMATS: dict[str, ExportFormat] = {
    "colmap": ExportFormat(
        "images, their camera and poses, and points with the frames that see them, as a model in text and binary",
        "COLMAP, gsplat and other splat trainers, OpenMVS",
        colmap.write,
    ),
    "nerfstudio": ExportFormat("images, transforms.json, depth maps, points.ply", "Nerfstudio, Instant-NGP", nerfstudio.write),
    "metashape": ExportFormat("images and cameras.xml", "Agisoft Metashape", metashape.write),
    "kwiver": ExportFormat("images, a KRTD camera for each, and the cloud", "KWIVER, TeleSculptor, VIAME", kwiver.write),
    "textured-glb": ExportFormat(
        "the surface with the images on it, glTF 2.0", "Blender, three.js, Unreal and Unity, phones, Sketchfab", textured_glb.write
    ),
    "obj": ExportFormat("the same as OBJ, MTL and PNG", "CloudCompare, MeshLab, Metashape, Blender", textured_obj.write),
    "glb": ExportFormat(
        "the whole mesh with the colors of its vertices, glTF 2.0",
        "Blender, three.js, Windows and phone viewers, Sketchfab",
        glb.write,
    ),
    "copc": ExportFormat(
        "the point cloud as COPC, loaded piece by piece", "QGIS, PDAL, CloudCompare, viewer.copc.io", copc_file.write
    ),
    "tiles": ExportFormat(
        "the orthomosaic in tiles of at most 8000 px, and the meters a pixel of each", "CoralNet, BIIGLE", mosaic_tiles.write
    ),
    "taglab": ExportFormat("orthomosaic and terrain model of one size, and a project that names them", "TagLab", taglab.write),
    "biigle": ExportFormat("images, and metadata.csv with time, place, distance and area of each", "BIIGLE", biigle.write),
    "mcap": ExportFormat(
        "corrected images, ranges, points, camera and track as ROS 2 messages in one file", "Foxglove, RViz, ROS 2", mcap_file.write
    ),
    "3d-tiles": ExportFormat(
        "the surface with the images on it as a tree of 3-D Tiles 1.1, on Earth where the map is", "CesiumJS, QGIS", tiles_3d.write
    ),
    "stac": ExportFormat("an item and a collection that name the run's files, STAC 1.0.0", "STAC catalogs, QGIS", stac.write),
    "ifdo": ExportFormat("images and their metadata, iFDO 2.1", "PANGAEA, BIIGLE, FathomNet", ifdo.write),
}
