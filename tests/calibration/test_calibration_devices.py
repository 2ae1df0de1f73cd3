"""Calibrations that come with stereo cameras, and Basalt's: written here as the devices write them,
read back to the same rig.
"""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from calibration_boards import fisheye_rig, pinhole_rig

from calibration import CalibrationError, StereoRig
from calibration.formats import format_name, load_rig
from calibration.transforms import inverse, rigid_transform


def same(read: StereoRig, rig: StereoRig) -> None:
    assert read.T_right_left == pytest.approx(rig.T_right_left, abs=1e-9)
    for ours, theirs in ((read.left, rig.left), (read.right, rig.right)):
        assert ours.image_size == theirs.image_size
        assert ours.model == theirs.model
        assert pytest.approx(theirs.K) == ours.K
        pixels = np.array([[10.0, 20], [200, 100]])
        assert ours.rays(pixels) == pytest.approx(theirs.rays(pixels), abs=1e-9)


def zed(rig: StereoRig) -> str:
    lines = []
    for name, factor in (("HD", 1.0), ("FHD", 1.5)):
        for side, camera in (("LEFT", rig.left), ("RIGHT", rig.right)):
            numbers = zip(
                ("fx", "fy", "cx", "cy"), factor * camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], strict=True
            )
            distortion = zip(
                ("k1", "k2", "p1", "p2", "k3"), np.pad(camera.distortion, (0, 5))[:5], strict=True
            )
            lines += [
                f"[{side}_CAM_{name}]",
                *(f"{key}={float(value)!r}" for key, value in (*numbers, *distortion)),
            ]
    rx, ry, rz = map(float, cv2.Rodrigues(rig.R)[0].ravel())
    x, y, z = (-1000 * rig.T_right_left[:3, 3]).tolist()
    lines += [
        "[STEREO]",
        f"Baseline={x}",
        f"TY={y}",
        f"TZ={z}",
        f"CV_HD={ry}",
        f"RX_HD={rx}",
        f"RZ_HD={rz}",
        "[MISC]",
        "Sensor_ID=0",
    ]
    return "\n".join(lines) + "\n"


def test_zed(tmp_path: Path) -> None:
    rig = pinhole_rig()
    file = tmp_path / "SN1234.conf"
    file.write_text(zed(rig))
    assert format_name(file) == "zed"
    with pytest.raises(
        CalibrationError,
        match=r"holds calibrations for images of 1920x1080, 1280x720: give the size",
    ):
        load_rig(file)
    read = load_rig(file, (1280, 720))
    assert read.medium == "air"
    assert read.T_right_left == pytest.approx(rig.T_right_left, abs=1e-9)
    assert pytest.approx(rig.left.K) == read.left.K
    assert read.left.distortion == pytest.approx(rig.left.distortion)
    assert [other.R for other in read.alternatives] == [pytest.approx(rig.R.T)]


def oak(rig: StereoRig, right_to_left: bool = False) -> dict[str, Any]:
    T = inverse(rig.T_right_left) if right_to_left else rig.T_right_left
    there = {
        "rotationMatrix": T[:3, :3].tolist(),
        "translation": dict(zip("xyz", (100 * T[:3, 3]).tolist(), strict=True)),
    }
    nowhere = {
        "rotationMatrix": np.zeros((3, 3)).tolist(),
        "translation": dict.fromkeys("xyz", 0.0),
        "toCameraSocket": -1,
    }
    extrinsics = [there | {"toCameraSocket": 1 if right_to_left else 2}, nowhere]
    cameras = []
    for socket, camera, its in zip(
        (1, 2),
        (rig.left, rig.right),
        extrinsics[::-1] if right_to_left else extrinsics,
        strict=True,
    ):
        width, height = camera.image_size
        length = 4 if camera.model == "fisheye" else 14
        lens = {
            "cameraType": int(camera.model == "fisheye"),
            "width": width,
            "height": height,
            "intrinsicMatrix": camera.K.tolist(),
            "distortionCoeff": np.pad(camera.distortion, (0, 14))[:length].tolist(),
        }
        cameras.append([socket, lens | {"extrinsics": its}])
    return {
        "batchName": "",
        "cameraData": cameras,
        "stereoRectificationData": {"leftCameraSocket": 1, "rightCameraSocket": 2},
    }


@pytest.mark.parametrize("right_to_left", [False, True])
@pytest.mark.parametrize("rig", [pinhole_rig(), fisheye_rig()])
def test_oak(rig: StereoRig, right_to_left: bool, tmp_path: Path) -> None:
    file = tmp_path / "oak.json"
    file.write_text(json.dumps(oak(rig, right_to_left)))
    assert format_name(file) == "depthai"
    same(load_rig(file), rig)


def basalt(rig: StereoRig) -> dict[str, Any]:
    from scipy.spatial.transform import Rotation

    T_imu_left = rigid_transform(
        Rotation.from_euler("xyz", [0.4, -1.1, 2.0]).as_matrix(), np.array([0.1, -0.02, 0.05])
    )
    T_imu_right = T_imu_left @ inverse(rig.T_right_left)
    poses, lenses = [], []
    for T, camera in ((T_imu_left, rig.left), (T_imu_right, rig.right)):
        quaternion = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
        poses.append(
            dict(
                zip(
                    ("px", "py", "pz", "qx", "qy", "qz", "qw"),
                    [*T[:3, 3].tolist(), *quaternion],
                    strict=True,
                )
            )
        )
        names = (
            ("k1", "k2", "k3", "k4")
            if camera.model == "fisheye"
            else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
        )
        numbers = np.concatenate(
            [camera.K[[0, 1, 0, 1], [0, 1, 2, 2]], np.pad(camera.distortion, (0, 8))[: len(names)]]
        ).tolist()
        kind = "kb4" if camera.model == "fisheye" else "pinhole-radtan8"
        lenses.append(
            {
                "camera_type": kind,
                "intrinsics": dict(zip(("fx", "fy", "cx", "cy", *names), numbers, strict=True)),
            }
        )
    sizes = [list(camera.image_size) for camera in (rig.left, rig.right)]
    return {
        "value0": {
            "T_imu_cam": poses,
            "intrinsics": lenses,
            "resolution": sizes,
            "imu_update_rate": 200.0,
        }
    }


@pytest.mark.parametrize("rig", [pinhole_rig(), fisheye_rig()])
def test_basalt(rig: StereoRig, tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps(basalt(rig)))
    assert format_name(file) == "basalt"
    same(load_rig(file), rig)


REFUSED = {
    "a lens model without an equal": (
        lambda c: c["value0"]["intrinsics"][0].update(camera_type="bal"),
        "camera_type: 'bal' is not",
    ),
    "three cameras": (lambda c: c["value0"]["T_imu_cam"].append({}), "expected two cameras"),
    "no rotation": (lambda c: c["value0"]["T_imu_cam"][0].update(qw=5.0), "is not a rotation"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_basalt_that_cannot_be_read(case: str, tmp_path: Path) -> None:
    spoil, message = REFUSED[case]
    content = basalt(fisheye_rig())
    spoil(content)
    (tmp_path / "c.json").write_text(json.dumps(content))
    with pytest.raises(CalibrationError, match=message):
        load_rig(tmp_path / "c.json")


def test_oak_without_a_pair(tmp_path: Path) -> None:
    content = oak(pinhole_rig())
    content["cameraData"][0][1]["extrinsics"]["toCameraSocket"] = 0
    (tmp_path / "c.json").write_text(json.dumps(content))
    with pytest.raises(CalibrationError, match="no extrinsics lead from socket 1 to 2"):
        load_rig(tmp_path / "c.json")
    del content["cameraData"][1]
    (tmp_path / "c.json").write_text(json.dumps(content))
    with pytest.raises(CalibrationError, match="holds no camera of socket 2"):
        load_rig(tmp_path / "c.json")


FOREIGN = {
    "one lens of Metashape": "<?xml version='1.0'?>\n<calibration>\n  "
    "<projection>frame</projection><f>1700</f></calibration>",
    "a lens of Pix4D": "Pix4D camera calibration file 1.0\nF 8.8\n",
    "a calibration as MATLAB's window displays it": "stereoParams =\n  stereoParameters with "
    "properties:\n",
    "the lenses of a RealSense camera": '{"left": {"width": 1280, "ppx": 640.1, "fx": 640.2}}',
    "settings of a RealSense camera": '{"device": {"name": "Intel RealSense D435"}}',
}


@pytest.mark.parametrize("name", FOREIGN)
def test_formats_that_are_not_read_are_named(name: str, tmp_path: Path) -> None:
    (tmp_path / "calib").write_text(FOREIGN[name])
    with pytest.raises(
        CalibrationError, match=rf"holds {name}, which is not supported: write both cameras"
    ):
        load_rig(tmp_path / "calib")
