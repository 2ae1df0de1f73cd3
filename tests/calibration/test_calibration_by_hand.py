"""Calibrations number by number, of ACFR and calib.io, and files that are none."""

import json
import pickle
from pathlib import Path

import cv2
import numpy as np
import pytest
from calibration_binaries import SIZE, small_rig
from test_calibration_formats import seen

from calibration import CalibrationError, StereoRig
from calibration.formats import load_rig
from calibration.rig import Camera

RIG = small_rig()


def assert_same(found: StereoRig) -> None:
    np.testing.assert_allclose(seen(found), seen(RIG), rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.T_right_left, RIG.T_right_left, atol=1e-9)


def lens(camera: Camera) -> dict[str, float]:
    return {"fx": camera.K[0, 0], "fy": camera.K[1, 1], "cx": camera.K[0, 2], "cy": camera.K[1, 2]}


def coefficients(camera: Camera) -> dict[str, float]:
    return dict(zip(("k1", "k2", "p1", "p2", "k3"), camera.distortion.tolist(), strict=False))


@pytest.mark.parametrize("nested", [True, False])
def test_lenses_number_by_number(nested: bool, tmp_path: Path) -> None:
    def side(camera: Camera) -> dict[str, object]:
        return (
            {"intrinsics": lens(camera), "distortion": coefficients(camera)}
            if nested
            else {**lens(camera), **coefficients(camera)}
        )

    pose = {"R": RIG.R.tolist(), "T": RIG.T_right_left[:3, 3].tolist()}
    content = {
        "left": side(RIG.left),
        "right": side(RIG.right),
        "image_size": list(SIZE),
        **({"extrinsics": pose} if nested else pose),
    }
    (tmp_path / "rig.json").write_text(json.dumps(content))
    assert_same(load_rig(tmp_path / "rig.json"))


def test_one_lens_and_a_baseline_are_of_rectified_images(tmp_path: Path) -> None:
    (tmp_path / "rig.yaml").write_text(
        "fx: 500\ncx: 310.5\ncy: 240\nbaseline_mm: 63\nwidth: 640\nheight: 480\n"
    )
    found = load_rig(tmp_path / "rig.yaml")
    assert found.baseline_m == pytest.approx(0.063)
    assert found.is_rectified
    np.testing.assert_array_equal(found.right.K, [[500, 0, 310.5], [0, 500, 240], [0, 0, 1]])
    assert "the images to be rectified" in found.doubts[0]
    (tmp_path / "rig.yaml").write_text(
        "fx: 500\ncx: 310.5\ncy: 240\nbaseline_mm: 63\nk1: -0.2\nk2: 0.1\n"
    )
    with pytest.raises(CalibrationError, match=r"rig\.yaml"):
        load_rig(tmp_path / "rig.yaml", SIZE)


def test_plain_numbers_of_acfr(tmp_path: Path) -> None:
    sides = ((RIG.left, np.eye(3), np.zeros(3)), (RIG.right, RIG.R, RIG.T_right_left[:3, 3]))
    rows = [
        np.concatenate([SIZE, camera.K.ravel(), camera.distortion[:4], R.ravel(), t])
        for camera, R, t in sides
    ]
    text = "\n".join(" ".join(repr(float(one)) for one in row) for row in rows)
    (tmp_path / "rig.calib").write_text(f"2\n{text}\n")
    found = load_rig(tmp_path / "rig.calib")
    np.testing.assert_allclose(found.T_right_left, RIG.T_right_left, atol=1e-9)
    np.testing.assert_allclose(
        found.alternatives[0].T_right_left, np.linalg.inv(RIG.T_right_left), atol=1e-9
    )
    (tmp_path / "rig.calib").write_text(f"3\n{text}\n{text}\n")
    with pytest.raises(CalibrationError, match=r"rig\.calib: holds 3 cameras, and a rig has two"):
        load_rig(tmp_path / "rig.calib")


def test_calib_io(tmp_path: Path) -> None:
    def camera(one: Camera, T: np.ndarray) -> dict[str, object]:
        numbers = {
            "f": one.K[0, 0],
            "ar": one.K[1, 1] / one.K[0, 0],
            "cx": one.K[0, 2],
            "cy": one.K[1, 2],
            **coefficients(one),
        }
        data = {
            "CameraModelCRT": {
                "CameraModelBase": {"imageSize": dict(zip(("width", "height"), SIZE, strict=True))}
            },
            "parameters": {
                key: {"state": 1, "val": float(value)} for key, value in numbers.items()
            },
        }
        turn = dict(
            zip(("rx", "ry", "rz"), cv2.Rodrigues(T[:3, :3])[0].ravel().tolist(), strict=True)
        )
        place = dict(zip("xyz", T[:3, 3].tolist(), strict=True))
        model = {"polymorphic_name": "libCalib::CameraModelOpenCV", "ptr_wrapper": {"data": data}}
        return {"model": model, "transform": {"rotation": turn, "translation": place}}

    cameras = [camera(RIG.left, np.eye(4)), camera(RIG.right, np.linalg.inv(RIG.T_right_left))]
    (tmp_path / "rig.json").write_text(json.dumps({"Calibration": {"cameras": cameras}}))
    found = load_rig(tmp_path / "rig.json")
    assert_same(found)
    assert "transforms into the cameras" in found.alternatives[0].reading
    (tmp_path / "rig.json").write_text(json.dumps({"Calibration": {"cameras": cameras[:1]}}))
    with pytest.raises(CalibrationError, match="holds 1 cameras: export only the stereo pair"):
        load_rig(tmp_path / "rig.json")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.npy", b"\x93NUMPY\x01\x00", "is damaged"),
        ("a.pkl", pickle.dumps({"K1": 1}), "holds Python objects"),
        ("dlt.csv", b"1.5,2e-3\n" * 11, "direct linear transformation"),
        ("decimal_commas.csv", b"1,5;2e-3\n" * 11, "direct linear transformation"),
        ("names.txt", b"cam1\tcam2\r\n" + b"1.5\t2\r\n" * 11, "direct linear transformation"),
        ("one.txt", b"-1.5e-3\n" * 11, "direct linear transformation"),
        ("rows.txt", (b"1.5 " * 11 + b"\n") * 2, "direct linear transformation"),
        (
            "left.cameramodel",
            b"# made by mrcal\n{\n    'lensmodel': 'LENSMODEL_OPENCV5',\n}\n",
            "a camera of mrcal",
        ),
        (
            "maps.xml",
            b"<?xml version='1.0'?>\n<opencv_storage>\n<stereoMapL_x>" + b"1 " * 200_000,
            "rectification maps without their cameras",
        ),
    ],
)
def test_files_that_hold_no_rig_are_named(
    name: str, content: bytes, message: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CalibrationError, match=f"{name}: .*{message}"):
        load_rig(tmp_path / name, SIZE)
