"""Images and cameras for Agisoft Metashape."""

import xml.etree.ElementTree as ET
from pathlib import Path

from stereo_seecolor.extras.export.export_format import ExportFormat, join_numbers
from stereo_seecolor.extras.export.images_of_8_bits import write_images
from stereo_seecolor.run_folder.posed_run import PosedRun

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
