"""Metashape's cameras (XML) of a multi-camera system: two sensors, the second with its place on the
first, its master.

Axes are x right, y down, z forward. ``rotation`` and ``location`` take a point of the second sensor
to the first, in the chunk's own unit, which the scale of its transform makes meters. The lens as in
the appendix of the *Agisoft Metashape User Manual*: the principal point from the middle of the
image, whose pixels begin at the corner; p1 and p2 are OpenCV's p2 and p1.
"""

from functools import partial
from typing import Any
from xml.etree import ElementTree

import numpy as np

from calibration.bounded_text import decode_text, load_xml
from calibration.errors import CalibrationError
from calibration.formats.calibration_format import RigFormat
from calibration.formats.cameras import make_camera
from calibration.formats.reading.lens_models import fitted_camera, metashape
from calibration.formats.reading.section import Section, naming
from calibration.formats.reading.units import to_meters
from calibration.rig import Camera, StereoRig
from calibration.transforms import inverse, rigid_transform

SENSORS, SCALE = "sensors of Metashape", "scale"
TYPES = ("frame", "fisheye")


def decode(raw: bytes) -> dict[str, Any] | None:
    """The sensors of a document, and its scale, as keys and values; None for other files."""
    if b"<chunk" not in raw:
        return None
    try:
        document = load_xml(decode_text(raw))
    except (UnicodeDecodeError, ElementTree.ParseError):
        return None
    if document.tag != "document" or document.find("chunk") is None:
        return None
    sensors = []
    for sensor in document.iter("sensor"):
        lenses = {lens.get("class", ""): lens for lens in sensor.findall("calibration")}
        lens = lenses.get("adjusted", next(iter(lenses.values()), None))
        if lens is not None:
            size = sensor.find("resolution")
            numbers = {child.tag: child.text for child in lens if child.text and child.text.strip()}
            place = {
                tag: (sensor.findtext(tag) or "").split()
                for tag in ("rotation", "location")
                if sensor.find(tag) is not None
            }
            attributes = {
                **sensor.attrib,
                **({} if size is None else size.attrib),
                "lens": lens.get("type", "frame"),
            }
            sensors.append({**numbers, **place, **attributes})
    return {SENSORS: sensors, SCALE: document.findtext(".//chunk/transform/scale")}


def matches(document: Section) -> bool:
    """True for cameras of Metashape."""
    return document.has(SENSORS)


def parse(document: Section, image_size: tuple[int, int] | None) -> StereoRig:
    """The rig, the master left. image_size is not needed. Raises CalibrationError where there is no
    place of the second sensor.
    """
    sensors = [
        Section(f"{document.where}: sensor {sensor.get('id')}", sensor)
        for sensor in document.content[SENSORS]
    ]
    masters = {sensor.content.get("id"): sensor for sensor in sensors}
    placed = [
        sensor
        for sensor in sensors
        if sensor.has("rotation", "location") and sensor.content.get("master_id") in masters
    ]
    if len(placed) != 1:
        raise CalibrationError(
            f"{document.where}: holds {len(placed)} cameras with a position relative to a "
            "master: expected one; import the images as a multi-camera system, and export "
            "the cameras after alignment"
        )
    slave, master = placed[0], masters[placed[0].content.get("master_id")]
    T_master_slave = rigid_transform(slave.matrix("rotation", 3, 3), slave.numbers("location", 3))
    T = inverse(T_master_slave)
    T[:3, 3], doubts = _in_meters(document, T[:3, 3])
    left, right = _camera(master), _camera(slave)
    with naming(slave.where):
        return StereoRig(left, right, T, doubts=doubts)


def _in_meters(document: Section, T: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    if document.content.get(SCALE) is None:
        return to_meters(T, None)
    scale = document.number(SCALE)
    doubt = (
        f"the baseline is {np.linalg.norm(T) * scale * 1000:.1f} mm with the chunk's scale of "
        f"{scale:.4g}: is this the baseline of the rig?"
    )
    return T * scale, (doubt,)


def _camera(section: Section) -> Camera:
    if section.text("lens") not in TYPES:
        raise CalibrationError(
            f"{section.where}: a lens of type {section.text('lens')!r} is not supported: "
            "calibrate as frame or fisheye"
        )
    size = section.image_size("width", "height")
    number = partial(section.number, default=0.0)
    center = (np.array(size) - 1) / 2 + [number("cx"), number("cy")]
    f = section.number("f")
    K = np.array([[f + number("b1"), number("b2"), center[0]], [0, f, center[1]], [0, 0, 1]])
    radial = np.array([number(f"k{n}") for n in (1, 2, 3, 4)])
    tangential = np.array([number("p1"), number("p2")])
    fisheye = section.text("lens") == "fisheye"
    if fisheye and not tangential.any():
        return make_camera(section.where, K, radial, size, "fisheye")
    if not fisheye and not radial[3]:
        distortion = np.array([radial[0], radial[1], tangential[1], tangential[0], radial[2]])
        return make_camera(section.where, K, distortion, size, "pinhole")
    return fitted_camera(
        section.where,
        metashape(radial, tangential, fisheye),
        K,
        size,
        f"{section.text('lens')} of Metashape",
    )


FORMAT = RigFormat(matches, parse, decode)
