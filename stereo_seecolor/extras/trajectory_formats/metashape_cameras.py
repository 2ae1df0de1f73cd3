"""Metashape's exported cameras (XML): camera-to-chunk matrices, and the chunk's place on Earth."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np

from calibration.transforms import rigid_transform
from stereo_seecolor.config import MountConfig
from stereo_seecolor.earth import east_north_up_axes, geodetic_from_geocentric
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.trajectories.table import Lines
from stereo_seecolor.inputs.trajectories.trajectory_format import TextFormat
from stereo_seecolor.records import Array, GeoOrigin, Trajectory

_CAMERA_IN_CHUNK = 16
_UNIT = np.array([1.0, *np.eye(3).ravel(), 0, 0, 0])


def recognizes(lines: Lines) -> bool:
    """XML with a document that holds a chunk."""
    head = "".join(lines.all[:4])
    return (
        head.startswith("<?xml")
        and "<document" in head
        and any(line.startswith("<chunk") for line in lines.all[:10])
    )


def read(lines: Lines, mount: MountConfig) -> Trajectory:
    """Cameras that were aligned, by their labels. Axes as here: x right, y down, z forward.

    With a reference on Earth the chunk's transform leads to geocentric meters, which become
    east-north-up at the first camera.
    With local coordinates z is up. Without a transform neither scale nor up is known.
    """
    root = _parse(lines)
    names, matrices, placed = [], [], []
    components = {
        node.get("id"): _similarity(node.find("transform")) for node in root.iter("component")
    }
    chunk = _similarity(root.find("chunk/transform"))
    for camera, matrix in _aligned(lines, root):
        component = components.get(camera.get("component_id"))
        similarity = chunk if component is None else component
        names.append(camera.get("label", ""))
        placed.append(similarity is not None)
        matrices.append(_moved(_UNIT if similarity is None else similarity, matrix))
    if not names:
        raise InputError(
            f"{lines.path}: holds no aligned camera: align the photos in Metashape and export the "
            "cameras again"
        )
    T, times = np.array(matrices), np.full(len(names), np.nan)
    if not all(placed):
        return Trajectory(tuple(names), times, T, up="unknown", camera="raw")
    origin = None
    if _is_on_earth(root):
        T, origin = _east_north_up(T)
    return Trajectory(tuple(names), times, T, origin=origin, camera="raw")


def _parse(lines: Lines) -> ET.Element:
    text = "\n".join(lines.all)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(f"{lines.path}: defines entities, which Metashape never does: not read")
    try:
        return ET.fromstring(text.encode())
    except ET.ParseError as error:
        raise InputError(f"{lines.path}: is not XML: {error}") from error


def _aligned(lines: Lines, root: ET.Element) -> Iterator[tuple[ET.Element, Array]]:
    for camera in root.iter("camera"):
        transform = camera.find("transform")
        if transform is not None:
            values = _numbers(transform)
            if len(values) != _CAMERA_IN_CHUNK:
                raise InputError(
                    f"{lines.path}: camera {camera.get('label')!r}: its transform needs 16 numbers"
                )
            yield camera, values.reshape(4, 4)


def _similarity(node: ET.Element | None) -> Array | None:
    """(13,) scale, rotation (9), translation (3); None without a readable one."""
    if node is None:
        return None
    parts = [_numbers(node.find(name)) for name in ("scale", "rotation", "translation")]
    found = np.concatenate([parts[0] if parts[0].size else np.ones(1), *parts[1:]])
    return found if found.size == _UNIT.size else None


def _numbers(node: ET.Element | None) -> Array:
    try:
        return (
            np.array([float(word) for word in (node.text or "").split()])
            if node is not None
            else np.zeros(0)
        )
    except ValueError:
        return np.zeros(0)


def _moved(similarity: Array, T_chunk_camera: Array) -> Array:
    R = similarity[1:10].reshape(3, 3)
    return rigid_transform(
        R @ T_chunk_camera[:3, :3], similarity[0] * R @ T_chunk_camera[:3, 3] + similarity[10:]
    )


def _is_on_earth(root: ET.Element) -> bool:
    """A coordinate system that is geographic, geocentric or projected; a local one has none, or is
    called LOCAL_CS.
    """
    reference = root.findtext("chunk/reference") or root.findtext("reference") or ""
    return bool(reference.strip()) and not reference.strip().startswith("LOCAL_CS")


def _east_north_up(T: Array) -> tuple[Array, GeoOrigin]:
    """Geocentric poses as east-north-up about the first finite camera; z: ellipsoid height."""
    known = np.flatnonzero(np.isfinite(T).all(axis=(1, 2)))
    first = T[known[0] if known.size else 0, :3, 3]
    latitude_deg, longitude_deg, height_m = geodetic_from_geocentric(first)
    axes = east_north_up_axes(latitude_deg, longitude_deg)
    position_m = (T[:, :3, 3] - first) @ axes.T + [0, 0, height_m]
    return rigid_transform(axes @ T[:, :3, :3], position_m), GeoOrigin(latitude_deg, longitude_deg)


FORMAT = TextFormat("Metashape cameras", recognizes, read)
