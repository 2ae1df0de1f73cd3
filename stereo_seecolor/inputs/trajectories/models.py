"""Trajectories of reconstructions: COLMAP, Metashape, transforms.json, OpenSfM."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.files import load_json
from stereo_seecolor.config import MountConfig
from stereo_seecolor.earth import east_north_up_axes, geodetic_from_geocentric
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.text_documents import read_text
from stereo_seecolor.geometry import pose, rotation_from_quaternion, rotation_from_vector
from stereo_seecolor.inputs.trajectories.axes import VehicleTrack, from_degrees
from stereo_seecolor.inputs.trajectories.table import LARGEST, Lines, Table, is_number
from stereo_seecolor.records import GeoOrigin, Trajectory

# COLMAP images.txt: ``ID qw qx qy qz tx ty tz CAM NAME``, world to camera, w first, every second
# line the image's points.


def is_colmap(lines: Lines) -> bool:
    """The comment COLMAP writes, or ten fields of which the last is a name."""
    fields = lines.first.split()
    return any("QW, QX, QY, QZ" in line for line in lines.all[:6]) or (
        len(fields) == 10 and not is_number(fields[9])
    )


def read_colmap(lines: Lines, mount: MountConfig) -> Trajectory:
    """COLMAP's world is arbitrary: up is unknown, and so is the scale unless the model was made
    metric.

    The pictures it was given are taken to be the raw left ones (as they are, or undistorted, which
    does not turn them).
    """
    rows, names = [], []
    for number, line in _image_lines(lines):
        fields = line.split(maxsplit=9)
        if len(fields) < 10:
            raise lines.error(number, "expected ID qw qx qy qz tx ty tz CAM NAME")
        rows.append(lines.numbers(number, fields[1:8]))
        names.append(fields[9])
    table = np.reshape(rows, (-1, 7))
    R_camera_world = rotation_from_quaternion(table[:, [1, 2, 3, 0]])
    R_world_camera = R_camera_world.transpose(0, 2, 1)
    position_m = -np.einsum("nij,nj->ni", R_world_camera, table[:, 4:])
    T = pose(R_world_camera, position_m)
    return Trajectory(tuple(names), np.full(len(names), np.nan), T, up="unknown", camera="raw")


def _image_lines(lines: Lines) -> list[tuple[int, str]]:
    """Every second line that is not a comment; the lines of points may be empty, so empty lines
    count.
    """
    text = read_text(lines.path).splitlines()
    uncommented = [(i, line) for i, line in enumerate(text, start=1) if not line.startswith("#")]
    return [(i, line) for i, line in uncommented[::2] if line.strip()]


# Metashape's exported cameras (XML): camera-to-chunk matrices, and the transform that puts the
# chunk onto Earth.

Array = NDArray[np.float64]

_CAMERA_IN_CHUNK = 16
_UNIT = np.array([1.0, *np.eye(3).ravel(), 0, 0, 0])


def is_metashape_xml(lines: Lines) -> bool:
    """XML with a document that holds a chunk."""
    head = "".join(lines.all[:4])
    return (
        head.startswith("<?xml")
        and "<document" in head
        and any(line.startswith("<chunk") for line in lines.all[:10])
    )


def read_metashape_xml(lines: Lines, mount: MountConfig) -> Trajectory:
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
    """(13,) scale, rotation (9), translation (3); None where there is none, or one that cannot be
    read.
    """
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
    T = np.eye(4)
    T[:3, :3] = R @ T_chunk_camera[:3, :3]
    T[:3, 3] = similarity[0] * R @ T_chunk_camera[:3, 3] + similarity[10:]
    return T


def _is_on_earth(root: ET.Element) -> bool:
    """A coordinate system that is geographic, geocentric or projected; a local one has none, or is
    called LOCAL_CS.
    """
    reference = root.findtext("chunk/reference") or root.findtext("reference") or ""
    return bool(reference.strip()) and not reference.strip().startswith("LOCAL_CS")


def _east_north_up(T: Array) -> tuple[Array, GeoOrigin]:
    """Geocentric poses as east-north-up about the first finite camera; z is the height above the
    ellipsoid.
    """
    known = np.flatnonzero(np.isfinite(T).all(axis=(1, 2)))
    first = T[known[0] if known.size else 0, :3, 3]
    latitude_deg, longitude_deg, height_m = geodetic_from_geocentric(first)
    axes = east_north_up_axes(latitude_deg, longitude_deg)
    position_m = (T[:, :3, 3] - first) @ axes.T + [0, 0, height_m]
    return pose(axes @ T[:, :3, :3], position_m), GeoOrigin(latitude_deg, longitude_deg)


# Metashape's exported reference (text): a line a photo with coordinates and yaw, pitch, roll, as
# given or as estimated.

_AXES = ("x", "y", "z", "yaw", "pitch", "roll")
_SEPARATORS = ("\t", ";", ",")


def is_metashape_reference(lines: Lines) -> bool:
    """A commented header that begins with Label and has an x or a longitude."""
    header = _header(lines)
    return bool(header) and header[0] == "label" and "x" in header


def read_metashape_reference(lines: Lines, mount: MountConfig) -> Trajectory:
    """Estimated values where the file has them, else the given ones.

    The angles are the camera's own, whatever the mount: all zero looks down with the top of the
    image to the north, yaw turns clockwise, pitch up, roll to starboard, as a vehicle's with a
    camera mounted the usual way (MountConfig's defaults).
    """
    header = _header(lines)
    table = Table.read(lines, _separator(lines), header, lines.content)
    estimated = all(f"{name}_est" in header for name in _AXES)
    columns = {name: np.array(table.column(f"{name}_est" if estimated else name)) for name in _AXES}
    attitude_deg = np.column_stack([columns[name] for name in ("roll", "pitch", "yaw")])
    north_east_m, origin = np.column_stack([columns["y"], columns["x"]]), None
    if _is_geographic(lines):
        north_east_m, origin = from_degrees(columns["y"], columns["x"])
    times = np.full(len(table.rows), np.nan)
    return VehicleTrack(
        tuple(table.text("label")), times, north_east_m, -columns["z"], attitude_deg, origin
    ).camera(MountConfig())


def _header_line(lines: Lines) -> str:
    return next(
        (
            line.lstrip("# ")
            for line in lines.all[:5]
            if line.lstrip("# ").lower().startswith("label")
        ),
        "",
    )


def _separator(lines: Lines) -> str:
    return max(_SEPARATORS, key=_header_line(lines).count)


def _header(lines: Lines) -> list[str]:
    """Names in lower case, without units; ``X/Longitude`` and its fellows are x, y and z."""
    names = [name.strip().lower() for name in _header_line(lines).split(_separator(lines))]
    return [name.split("/")[0] for name in names]


def _is_geographic(lines: Lines) -> bool:
    """Longitude and latitude, not easting and northing or local meters."""
    system = next((line for line in lines.all[:5] if "CoordinateSystem" in line), "")
    return "GEOGCS" in system and "PROJCS" not in system


# ``transforms.json`` of Blender's scripts, Instant-NGP and Nerfstudio: camera-to-world matrices
# in the axes of OpenGL.

OPENGL_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
"""The camera's x right, y down, z forward to x right, y up, z backward."""


def is_nerf(lines: Lines) -> bool:
    """An object of JSON with a ``transform_matrix``."""
    return lines.first.startswith("{") and any('"transform_matrix"' in line for line in lines.all)


def read_nerf(lines: Lines, mount: MountConfig) -> Trajectory:
    """Matched to the frames by the names of their images; up and the scale are unknown. The images
    are taken to be the raw ones.
    """
    try:
        frames = load_json("\n".join(lines.all))["frames"]
        names = tuple(str(frame["file_path"]) for frame in frames)
        T = np.array([frame["transform_matrix"] for frame in frames], dtype=np.float64)[:, :3]
    except (ValueError, KeyError, TypeError, IndexError, OverflowError) as error:
        raise InputError(
            f"{lines.path}: no frames with a file_path and a 4x4 transform_matrix each "
            f"({error!r:.80})"
        ) from error
    if T.shape[1:] != (3, 4) or (np.abs(T) > LARGEST).any():
        raise InputError(
            f"{lines.path}: transform_matrix: expected 4x4 numbers of meters a frame, got shape "
            f"{T.shape}"
        )
    return Trajectory(
        names, np.full(len(T), np.nan), _rigid(T) @ OPENGL_OPENCV, up="unknown", camera="raw"
    )


def _rigid(T: np.ndarray) -> np.ndarray:
    """(N, 4, 4) of (N, 3, 4), the axes of length one: Blender leaves an object's scale in them; NaN
    where one has none.
    """
    whole = np.tile(np.eye(4), (len(T), 1, 1))
    whole[:, :3] = T
    lengths = np.linalg.norm(T[:, :, :3], axis=1, keepdims=True)
    whole[:, :3, :3] /= np.where(lengths > 0, lengths, np.nan)
    return whole


# ``reconstruction.json`` of OpenSfM and OpenDroneMap: world-to-camera rotation vectors and
# translations of shots, meters.


def is_opensfm(lines: Lines) -> bool:
    """A list of JSON with ``shots``."""
    return lines.first.startswith("[") and any('"shots"' in line for line in lines.all)


def read_opensfm(lines: Lines, mount: MountConfig) -> Trajectory:
    """The largest reconstruction: east, north, up about its reference; z counts from the sea where
    that has an altitude.
    """
    try:
        whole = max(load_json("\n".join(lines.all)), key=lambda one: len(one["shots"]))
        shots = whole["shots"]
        vectors, shifts = (
            np.array([shot[key] for shot in shots.values()], dtype=np.float64)
            for key in ("rotation", "translation")
        )
        times = np.array(
            [shot.get("capture_time") or np.nan for shot in shots.values()], dtype=np.float64
        )
        place = whole.get("reference_lla")
        origin = GeoOrigin(float(place["latitude"]), float(place["longitude"])) if place else None
        height_m = float(place.get("altitude", 0.0)) if place else 0.0
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(
            f"{lines.path}: no shots with a rotation and a translation each ({error!r:.80})"
        ) from error
    if (
        vectors.shape != shifts.shape
        or vectors.shape[1:] != (3,)
        or (np.abs(shifts) > LARGEST).any()
    ):
        raise InputError(
            f"{lines.path}: rotation and translation: expected three numbers a shot, got shape "
            f"{shifts.shape}"
        )
    R_world_camera = np.array([rotation_from_vector(vector).T for vector in vectors]).reshape(
        -1, 3, 3
    )
    centers = -np.einsum("nij,nj->ni", R_world_camera, shifts) + [0, 0, height_m]
    up: Literal["z", "unknown"] = "z" if place else "unknown"
    return Trajectory(
        tuple(map(str, shots)),
        times,
        pose(R_world_camera, centers),
        up=up,
        origin=origin,
        camera="raw",
    )
