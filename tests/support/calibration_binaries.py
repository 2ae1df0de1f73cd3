"""Binary calibration files of each format, made here: MATLAB objects (v5 and v7.3) byte by byte,
.npz, SeaGIS's .cam.
"""

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration import Camera, StereoRig
from calibration.transforms import rigid_transform

SIZE = (640, 480)
# class of array, type of element
STORED = {"f8": (6, 9), "u1": (9, 2), "u2": (11, 4), "u4": (13, 6)}
REFERENCE = 0xDD000000


def small_rig() -> StereoRig:
    """A rig with five coefficients and a rotation that differs from its transpose by 0.04."""
    from scipy.spatial.transform import Rotation

    K = np.array([[500.0, 0, 322.0], [0, 502.0, 238.0], [0, 0, 1]])
    left = Camera(K, np.array([-0.1, 0.02, 0.001, -0.0005, 0.003]), SIZE)
    right = Camera(
        K + np.diag([3.0, 2.0, 0.0]), np.array([-0.11, 0.03, -0.0007, 0.0002, 0.001]), SIZE
    )
    R = Rotation.from_rotvec([0.004, -0.02, 0.01]).as_matrix()
    return StereoRig(left, right, rigid_transform(R, np.array([-0.1, 0.002, 0.003])))


def camera_fields(camera: Camera, unit: str, modern: bool) -> dict[str, Any]:
    """What a cameraParameters object holds; modern: as from R2022b on."""
    k1, k2, p1, p2, k3 = camera.distortion.tolist()
    K = camera.K + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
    matrix = {"K": K} if modern else {"IntrinsicMatrix": K.T}
    size = {"ImageSize": np.array([[480.0, 640.0]])}
    distortion = {
        "RadialDistortion": np.array([[k1, k2, k3]]),
        "TangentialDistortion": np.array([[p1, p2]]),
    }
    return distortion | size | {"WorldUnits": unit} | matrix


def stereo_fields(
    rig: StereoRig, unit: str = "millimeters", scale: float = 1000.0, transposed: bool = True
) -> dict[str, Any]:
    """What a stereoParameters object holds, but for its cameras."""
    return {
        "RotationOfCamera2": rig.R.T if transposed else rig.R,
        "TranslationOfCamera2": rig.T_right_left[:3, 3][None] * scale,
    }


class Mat5:
    """Elements of a Level 5 file."""

    def element(self, kind: int, payload: bytes) -> bytes:
        if 0 < len(payload) <= 4:
            return struct.pack("<HH", kind, len(payload)) + payload.ljust(4, b"\0")
        return struct.pack("<II", kind, len(payload)) + payload + bytes(-len(payload) % 8)

    def head(self, kind: int, shape: tuple[int, ...], name: str) -> bytes:
        dims = struct.pack(f"<{len(shape)}i", *shape)
        return (
            self.element(6, struct.pack("<II", kind, 0))
            + self.element(5, dims)
            + self.element(1, name.encode())
        )

    def value(self, value: Any, name: str = "") -> bytes:
        if isinstance(value, str):
            body = self.head(4, (1, len(value)), name) + self.element(4, value.encode("utf-16-le"))
        elif isinstance(value, dict):
            names = b"".join(key.encode().ljust(32, b"\0") for key in value)
            body = (
                self.head(2, (1, 1), name)
                + self.element(5, struct.pack("<i", 32))
                + self.element(1, names)
            )
            body += b"".join(map(self.value, value.values()))
        elif isinstance(value, list):
            body = self.head(1, (len(value), 1), name) + b"".join(map(self.value, value))
        elif isinstance(value, bytes):
            body = value
        else:
            array = np.asarray(value)
            kind, stored = STORED[array.dtype.str[1:]]
            body = self.head(kind, array.shape, name) + self.element(
                stored, array.tobytes(order="F")
            )
        return self.element(14, body)

    def opaque(self, name: str, class_name: str, reference: Any) -> bytes:
        flags = self.element(6, struct.pack("<II", 17, 0))
        return (
            flags
            + b"".join(self.element(1, t.encode()) for t in (name, "MCOS", class_name))
            + self.value(reference)
        )


def reference_to(number: int, class_number: int) -> NDArray[np.uint32]:
    """The array that stands for an object."""
    return np.array([[REFERENCE], [2], [1], [1], [number], [class_number]], np.uint32)


def object_cells(objects: list[tuple[str, dict[str, Any]]]) -> list[Any]:
    """The subsystem's cells for objects (class, fields) whose classes save structs; object n is the
    n-th, from 1.
    """
    classes = sorted({name for name, _ in objects})
    names = ["any", *classes]
    text = b"".join(name.encode() + b"\0" for name in names)
    text += bytes(-len(text) % 8)
    class_table = [[0, 0, 0, 0]] + [[0, 2 + i, 0, 0] for i in range(len(classes))]
    blocks = [[0, 0]] + [[1, 1, 1, i] for i in range(len(objects))]
    table = [[0] * 6] + [
        [classes.index(name) + 1, 0, 0, i + 1, 0, i + 1] for i, (name, _) in enumerate(objects)
    ]
    parts = [
        np.concatenate(part).astype("<u4").tobytes()
        for part in (class_table, blocks, table, [[0, 0]], [[0, 0]])
    ]
    offsets = np.cumsum([40 + len(text), *map(len, parts)]).tolist()
    head = np.array([2, len(names), *offsets, 0, 0], "<u4").tobytes()[:40]
    meta = np.frombuffer(head + text + b"".join(parts), np.uint8).reshape(-1, 1)
    return [meta, np.zeros((0, 0)), *(fields for _, fields in objects), np.zeros((0, 0))]


def stereo_objects(
    rig: StereoRig,
    unit: str = "millimeters",
    scale: float = 1000.0,
    transposed: bool = True,
    modern: bool = False,
) -> list[tuple[str, dict[str, Any]]]:
    """The objects of one stereoParameters, itself the last."""
    cameras = [
        ("cameraParameters", camera_fields(camera, unit, modern))
        for camera in (rig.left, rig.right)
    ]
    fields = {"CameraParameters1": reference_to(1, 1), "CameraParameters2": reference_to(2, 1)}
    fields |= stereo_fields(rig, unit, scale, transposed)
    if not modern:
        return [*cameras, ("stereoParameters", fields)]
    pose = {"R": rig.R, "Translation": rig.T_right_left[:3, 3][None] * scale}
    fields["PoseCamera2"] = reference_to(3, 2)
    return [*cameras, ("rigidtform3d", pose), ("stereoParameters", fields)]


def write_mat5(
    path: Path, objects: list[tuple[str, dict[str, Any]]], compress: bool = True
) -> Path:
    """A Level 5 file with one variable, the last of the objects."""
    mat = Mat5()
    cells = mat.opaque("", "FileWrapper__", object_cells(objects))
    subsystem = b"\0\1IM\0\0\0\0" + mat.element(14, mat.head(2, (1, 1), "") + mat.element(5,
    struct.pack("<i", 5))
        + mat.element(1, b"MCOS\0") + mat.element(14, cells))  # fmt: skip
    variables = [
        mat.element(14, mat.opaque("stereoParams", objects[-1][0], reference_to(len(objects), 3))),
        mat.value(np.frombuffer(subsystem, np.uint8)[None]),
    ]
    if compress:
        packed = [zlib.compress(variable) for variable in variables]
        variables = [struct.pack("<II", 15, len(data)) + data for data in packed]
    header = b"MATLAB 5.0 MAT-file, made by a test".ljust(116) + bytes(8) + b"\0\1IM"
    path.write_bytes(header + b"".join(variables))
    return path


def write_mat73(path: Path, objects: list[tuple[str, dict[str, Any]]]) -> Path:
    """A version 7.3 file with the same, written with h5py."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        refs = file.create_group("#refs#")

        def put(group: Any, name: str, value: Any) -> Any:
            if isinstance(value, dict):
                node = group.create_group(name)
                for key, inner in value.items():
                    put(node, key, inner)
                node.attrs["MATLAB_class"] = np.bytes_("struct")
                return node
            if isinstance(value, str):
                node = group.create_dataset(
                    name, data=np.array([[ord(c)] for c in value], np.uint16)
                )
                node.attrs["MATLAB_class"] = np.bytes_("char")
                return node
            array = np.asarray(value)
            if array.size == 0:
                node = group.create_dataset(name, data=np.zeros(2, np.uint64))
                node.attrs["MATLAB_empty"] = np.int32(1)
            else:
                node = group.create_dataset(name, data=array.T)
            node.attrs["MATLAB_class"] = np.bytes_(
                {"f": "double", "u": f"uint{array.itemsize * 8}"}[array.dtype.kind]
            )
            return node

        nodes = [put(refs, f"c{i}", value) for i, value in enumerate(object_cells(objects))]
        table = file.create_dataset(
            "#subsystem#/MCOS", data=np.array([[node.ref for node in nodes]], h5py.ref_dtype)
        )
        table.attrs["MATLAB_class"] = np.bytes_("FileWrapper__")
        table.attrs["MATLAB_object_decode"] = np.int32(3)
        variable = file.create_dataset("stereoParams", data=reference_to(len(objects), 3).T)
        variable.attrs["MATLAB_class"] = np.bytes_(objects[-1][0])
        variable.attrs["MATLAB_object_decode"] = np.int32(3)
    raw = bytearray(path.read_bytes())
    raw[:128] = b"MATLAB 7.3 MAT-file, made by a test".ljust(124) + b"\0\2IM"
    path.write_bytes(raw)
    return path


def npz_bytes(rig: StereoRig, scale: float = 1000.0, **more: Any) -> bytes:
    """VIAME's .npz."""
    stream = io.BytesIO()
    sides = {"L": rig.left, "R": rig.right}
    content = {f"cameraMatrix{side}": camera.K for side, camera in sides.items()}
    content |= {f"distCoeffs{side}": camera.distortion[None] for side, camera in sides.items()}
    np.savez(stream, **content, R=rig.R, T=rig.T_right_left[:3, 3:] * scale, **more)
    return stream.getvalue()


def cam_bytes(numbers: list[float], pixel_mm: float = 0.005, size: tuple[int, int] = SIZE) -> bytes:
    """One SeaGIS .cam file of 16 parameters."""

    def text(words: str) -> bytes:
        return struct.pack("<i", -len(words)) + words.encode("utf-16-le")

    head = (
        b"CAM\1"
        + text("left")
        + text("")
        + struct.pack("<2d", pixel_mm, pixel_mm)
        + struct.pack("<2i", size[1], size[0])
    )
    return (
        head
        + b"MAT\0"
        + struct.pack("<2i", 16, 1)
        + struct.pack("<16d", *numbers)
        + b"MAT\0"
        + bytes(40)
    )
