"""Images and cameras for Metashape, KWIVER and Nerfstudio."""

import json
import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from stereo_seecolor.extras.export.export_format import ExportFormat
from stereo_seecolor.extras.export.images_of_8_bits import write_images
from stereo_seecolor.files.encode import encode_depth_mm
from stereo_seecolor.run_folder.finished_run import FinishedFrame
from stereo_seecolor.run_folder.layout import CLOUD
from stereo_seecolor.run_folder.posed_run import PosedRun, join_numbers

LOCAL = 'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1]]'


def write_metashape(posed: PosedRun, folder: Path) -> None:
    """Write ``images/`` and cameras.xml for Agisoft Metashape (File, Import, Import Cameras), whose
    chunk has the map's coordinates.

    Axes as here: x right, y down, z forward; cx and cy from the image's center (Metashape
    Professional's manual, appendix C and D).
    """
    images = write_images(posed.frames, folder)
    document = ET.Element("document", version="1.5.0")
    chunk = ET.SubElement(document, "chunk", label="stereo-seecolor", enabled="true")
    _add_sensor(ET.SubElement(chunk, "sensors", next_id="1"), posed)
    cameras = ET.SubElement(chunk, "cameras", next_id=str(len(posed.frames)))
    for number, (image, T) in enumerate(zip(images, posed.T_map_camera, strict=True)):
        camera = ET.SubElement(
            cameras, "camera", id=str(number), sensor_id="0", label=image.stem, enabled="true"
        )
        ET.SubElement(camera, "transform").text = join_numbers(T.ravel())
    transform = ET.SubElement(chunk, "transform")
    for name, numbers in (
        ("rotation", (1, 0, 0, 0, 1, 0, 0, 0, 1)),
        ("translation", (0, 0, 0)),
        ("scale", (1,)),
    ):
        ET.SubElement(transform, name).text = join_numbers(numbers)
    ET.SubElement(chunk, "reference").text = LOCAL
    ET.indent(document)
    ET.ElementTree(document).write(folder / "cameras.xml", encoding="UTF-8", xml_declaration=True)


def _add_sensor(sensors: ET.Element, posed: PosedRun) -> None:
    g = posed.geometry
    width, height = g.image_size
    size = {"width": str(width), "height": str(height)}
    sensor = ET.SubElement(sensors, "sensor", id="0", label="rectified left", type="frame")
    ET.SubElement(sensor, "resolution", size)
    calibration = ET.SubElement(sensor, "calibration", {"type": "frame", "class": "adjusted"})
    ET.SubElement(calibration, "resolution", size)
    middle_px = (width - 1) / 2, (height - 1) / 2
    for name, value in (
        ("f", g.focal_px),
        ("cx", g.cx_left_px - middle_px[0]),
        ("cy", g.cy_px - middle_px[1]),
    ):
        ET.SubElement(calibration, name).text = join_numbers((value,))


METASHAPE = ExportFormat("images and cameras.xml", "Agisoft Metashape", write_metashape)


def write_kwiver(posed: PosedRun, folder: Path) -> None:
    """Write ``images/``, ``krtd/NAME.krtd``, image_list.txt and cloud.ply for KWIVER's tools.

    A KRTD file holds K (3, 3), R (3, 3) and t (3,) of x = K (R X + t), and the distortion, with
    blank lines between them. Pixel (0, 0) is the center of the top left one.
    """
    (folder / "krtd").mkdir()
    shutil.copyfile(posed.map_folder / CLOUD, folder / "cloud.ply")
    images = write_images(posed.frames, folder)
    for image, T in zip(images, posed.T_camera_map, strict=True):
        parts = (
            *map(join_numbers, posed.geometry.P_left),
            "",
            *map(join_numbers, T[:3, :3]),
            "",
            join_numbers(T[:3, 3]),
            "",
            "0",
        )
        (folder / "krtd" / f"{image.stem}.krtd").write_text(
            "\n".join(parts) + "\n", encoding="ascii"
        )
    (folder / "image_list.txt").write_text(
        "".join(f"images/{image.name}\n" for image in images), encoding="utf-8"
    )


KWIVER = ExportFormat(
    "images, a KRTD camera for each, and the cloud", "KWIVER, TeleSculptor, VIAME", write_kwiver
)


OPENGL_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
METERS_PER_UNIT = 0.001
"""Of the depth maps: 16-bit millimeters, which is what Nerfstudio takes unless told otherwise."""


def write_nerfstudio(posed: PosedRun, folder: Path) -> None:
    """Write transforms.json, ``images/``, ``depth/`` (along the optical axis; 0 unknown) and
    points.ply.

    Poses are camera to world in OpenGL's axes: x right, y up, z backward (Nerfstudio, "Data
    conventions").
    """
    (folder / "depth").mkdir()
    g, images = posed.geometry, write_images(posed.frames, folder)
    shutil.copyfile(posed.map_folder / CLOUD, folder / "points.ply")
    content = {
        "camera_model": "OPENCV",
        **{"w": g.image_size[0], "h": g.image_size[1], "fl_x": g.focal_px, "fl_y": g.focal_px},
        **dict(zip(("cx", "cy"), posed.principal_point_px, strict=True)),
        **{"k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0},
        "ply_file_path": "points.ply",
        "depth_unit_scale_factor": METERS_PER_UNIT,
        "frames": [
            {
                "file_path": f"images/{image.name}",
                "depth_file_path": f"depth/{_write_depth(posed, frame, folder / 'depth')}",
                "transform_matrix": (T @ OPENGL_FROM_OPENCV).tolist(),
            }
            for frame, image, T in zip(posed.frames, images, posed.T_map_camera, strict=True)
        ],
    }
    (folder / "transforms.json").write_text(json.dumps(content, indent=1), encoding="utf-8")


def _write_depth(posed: PosedRun, frame: FinishedFrame, folder: Path) -> str:
    name = f"{frame.name}.png"
    (folder / name).write_bytes(
        encode_depth_mm(posed.geometry.depth_from_range(posed.measured_range_m(frame)))
    )
    return name


NERFSTUDIO = ExportFormat(
    "images, transforms.json, depth maps, points.ply", "Nerfstudio, Instant-NGP", write_nerfstudio
)
