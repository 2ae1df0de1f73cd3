"""Binary formats: the rays that went in come out, conventions and units are decided by evidence,
nothing is run.
"""

import pickle
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from calibration_binaries import (
    SIZE,
    Mat5,
    cam_bytes,
    camera_fields,
    npz_bytes,
    small_rig,
    stereo_fields,
    stereo_objects,
    write_mat5,
    write_mat73,
)
from scipy.io import savemat
from scipy.spatial.transform import Rotation
from test_calibration_formats import seen

from calibration import CalibrationError, StereoRig
from calibration.formats import load_rig, write_rig
from calibration.suspicions import suspicions

RIG = small_rig()


def assert_same(found: StereoRig, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(seen(found), seen(RIG), rtol=0, atol=tolerance)
    np.testing.assert_allclose(found.T_right_left, RIG.T_right_left, atol=tolerance)
    assert found.left.image_size == SIZE


@pytest.mark.parametrize("write", [write_mat5, write_mat73])
@pytest.mark.parametrize("modern", [False, True], ids=["R2016b", "R2022b"])
def test_matlab_objects(write: object, modern: bool, tmp_path: Path) -> None:
    found = load_rig(write(tmp_path / "calib.mat", stereo_objects(RIG, modern=modern)))  # type: ignore[operator]
    assert_same(found)
    assert found.doubts == ()
    assert len(found.alternatives) == (0 if modern else 1)


def test_matlab_objects_uncompressed(tmp_path: Path) -> None:
    assert_same(load_rig(write_mat5(tmp_path / "calib.mat", stereo_objects(RIG), compress=False)))


def test_a_convention_left_open_is_carried_as_an_alternative(tmp_path: Path) -> None:
    """RotationOfCamera2 stored without transposing: nothing in the file says so."""
    found = load_rig(write_mat5(tmp_path / "calib.mat", stereo_objects(RIG, transposed=False)))
    np.testing.assert_allclose(found.R, RIG.R.T, atol=1e-12)
    np.testing.assert_allclose(found.alternatives[0].R, RIG.R, atol=1e-12)
    assert "images of the dive must decide" in "; ".join(suspicions(found))


@pytest.mark.parametrize("transposed", [True, False])
def test_the_views_in_the_file_decide_the_convention(transposed: bool, tmp_path: Path) -> None:
    objects = stereo_objects(RIG, transposed=transposed)
    boards = Rotation.from_rotvec([[0.2, 0.1, 0.0], [-0.3, 0.2, 0.1]])
    objects[0][1]["RotationVectors"] = boards.as_rotvec()
    objects[1][1]["RotationVectors"] = (Rotation.from_matrix(RIG.R) * boards).as_rotvec()
    found = load_rig(write_mat5(tmp_path / "calib.mat", objects))
    assert_same(found)
    assert found.alternatives == ()


@pytest.mark.parametrize(
    ("unit", "scale", "doubt"),
    [
        ("mm", 1000, ""),
        ("meters", 1, ""),
        ("mm", 1, "is read as meters"),
        ("cm", 100, ""),
        ("feet", 1 / 0.3048, ""),
    ],
)
def test_matlab_units(unit: str, scale: float, doubt: str, tmp_path: Path) -> None:
    found = load_rig(write_mat5(tmp_path / "calib.mat", stereo_objects(RIG, unit, scale)))
    assert found.baseline_m == pytest.approx(RIG.baseline_m)
    assert doubt in "; ".join(found.doubts) and bool(doubt) == bool(found.doubts)


def test_matlab_struct_and_its_size_from_the_images(tmp_path: Path) -> None:
    cameras = [camera_fields(camera, "mm", False) for camera in (RIG.left, RIG.right)]
    for camera in cameras:
        del camera["ImageSize"]
    content = {
        "CameraParameters1": cameras[0],
        "CameraParameters2": cameras[1],
        **stereo_fields(RIG),
    }
    savemat(tmp_path / "struct.mat", {"calibration": content})
    assert_same(load_rig(tmp_path / "struct.mat", SIZE))
    with pytest.raises(CalibrationError, match=r"struct\.mat"):
        load_rig(tmp_path / "struct.mat")


@pytest.mark.parametrize("name", ["{}{}", "{}_{}", "Camera{1}_{0}", "cameraParameters{1}{0}"])
def test_matlab_properties_saved_one_by_one(name: str, tmp_path: Path) -> None:
    cameras = [camera_fields(camera, "millimeters", False) for camera in (RIG.left, RIG.right)]
    content = {
        name.format(key, i): value
        for i, camera in enumerate(cameras, 1)
        for key, value in camera.items()
    }
    savemat(tmp_path / "flat.mat", content | stereo_fields(RIG))
    assert_same(load_rig(tmp_path / "flat.mat"))


@pytest.mark.parametrize("between_rows", ["; ", ";\n    "])
def test_matlab_properties_as_text(between_rows: str, tmp_path: Path) -> None:
    cameras = [camera_fields(camera, "centimeters", False) for camera in (RIG.left, RIG.right)]
    content = {
        f"{key}{i}": value for i, camera in enumerate(cameras, 1) for key, value in camera.items()
    } | stereo_fields(RIG)
    content["TranslationOfCamera2"] = np.asarray(content["TranslationOfCamera2"]) / 10
    lines = []
    for key, value in content.items():
        rows = (
            []
            if isinstance(value, str)
            else [" ".join(map(repr, row)) for row in np.atleast_2d(value).tolist()]
        )
        lines.append(f"{key} = [{between_rows.join(rows)}];" if rows else f"{key} = '{value}';")
    (tmp_path / "flat.txt").write_text("\n".join(lines))
    assert_same(load_rig(tmp_path / "flat.txt"))


COLUMN_MM = RIG.T_right_left[:3, 3:] * 1000
HOMOGENEOUS = np.block([[RIG.R, COLUMN_MM], [np.zeros((1, 3)), np.ones((1, 1))]])
POSES = {
    "rigidtform3d": {"Dimensionality": 3.0, "R": RIG.R, "Translation": COLUMN_MM.T},
    "its matrix": {"A": HOMOGENEOUS},
    "rigid3d, for row vectors": {"T": HOMOGENEOUS.T, "Dimensionality": 3.0},
    "other names": {
        "Dimensionality": 3.0,
        "RotationMatrix_": RIG.R,
        "Translation_": COLUMN_MM.T,
        "Version": 1.0,
    },
}


@pytest.mark.parametrize("pose", POSES)
def test_poses_of_newer_matlab(pose: str, tmp_path: Path) -> None:
    cameras = [camera_fields(camera, "millimeters", True) for camera in (RIG.left, RIG.right)]
    stereo = {
        "CameraParameters1": cameras[0],
        "CameraParameters2": cameras[1],
        "PoseCamera2": POSES[pose],
        "Version": 2.0,
    }
    savemat(
        tmp_path / "struct.mat",
        {"x": np.arange(5.0), "files": "left", "session": {"params": stereo}},
    )
    assert_same(load_rig(tmp_path / "struct.mat"))


def test_a_pose_of_matlab_without_a_rotation_is_refused(tmp_path: Path) -> None:
    cameras = [camera_fields(camera, "millimeters", True) for camera in (RIG.left, RIG.right)]
    stereo = {
        "CameraParameters1": cameras[0],
        "CameraParameters2": cameras[1],
        "PoseCamera2": {"Dimensionality": 3.0},
    }
    savemat(tmp_path / "struct.mat", {"stereoParams": stereo})
    with pytest.raises(CalibrationError, match=r"PoseCamera2: holds no rotation and translation"):
        load_rig(tmp_path / "struct.mat")


def test_camera_intrinsics_of_matlab(tmp_path: Path) -> None:
    cameras = [
        {"FocalLength": camera.K[[0, 1], [0, 1]], "PrincipalPoint": camera.K[:2, 2] + 1,
        "ImageSize": np.array([[480.0, 640.0]]),
         "RadialDistortion": camera.distortion[[0, 1, 4]],
         "TangentialDistortion": camera.distortion[[2, 3]], "Skew": 0.0}
        for camera in (RIG.left, RIG.right)
    ]  # fmt: skip
    savemat(
        tmp_path / "i.mat",
        {
            "s": {
                "CameraParameters1": cameras[0],
                "CameraParameters2": cameras[1],
                **stereo_fields(RIG),
            }
        },
    )
    assert_same(load_rig(tmp_path / "i.mat"))


@pytest.mark.parametrize("wrapped", [False, True])
@pytest.mark.parametrize(
    "size",
    [{"nx": 640, "ny": 480}, {"image_size_left": [480, 640], "image_size_right": [480, 640]}],
)
def test_bouguet(wrapped: bool, size: dict[str, object], tmp_path: Path) -> None:
    content: dict[str, object] = {
        "om": Rotation.from_matrix(RIG.R).as_rotvec(),
        "T": RIG.T_right_left[:3, 3] * 1000,
    }
    for side, camera in (("left", RIG.left), ("right", RIG.right)):
        content |= {
            f"fc_{side}": camera.K[[0, 1], [0, 1]],
            f"cc_{side}": camera.K[:2, 2],
            f"kc_{side}": camera.distortion,
        }
    content |= size
    savemat(tmp_path / "Calib_Results_stereo.mat", {"Cal": content} if wrapped else content)
    assert_same(load_rig(tmp_path / "Calib_Results_stereo.mat"))


def test_bouguets_errors_are_three_standard_errors(tmp_path: Path) -> None:
    content: dict[str, object] = {
        "om": np.zeros(3),
        "T": [-100.0, 0.0, 0.0],
        "nx": 640,
        "ny": 480,
        "T_error": [0.6, 5.0, 5.0],
    }
    for side in ("left", "right"):
        content |= {
            f"fc_{side}": [500.0, 500.0],
            f"cc_{side}": [320.0, 240.0],
            f"fc_{side}_error": [3.0, 3.0],
        }
    savemat(tmp_path / "Calib_Results_stereo.mat", content)
    errors = load_rig(tmp_path / "Calib_Results_stereo.mat").errors
    assert errors is not None
    assert (errors.focal, errors.baseline) == pytest.approx((0.002, 0.002))


def test_one_camera_of_bouguets_toolbox_is_refused(tmp_path: Path) -> None:
    savemat(
        tmp_path / "Calib_Results_left.mat", {"fc": [1.0, 1.0], "cc": [1.0, 1.0], "kc": np.zeros(5)}
    )
    with pytest.raises(CalibrationError, match="contains only one camera"):
        load_rig(tmp_path / "Calib_Results_left.mat")


@pytest.mark.parametrize("scale", [1.0, 100.0, 1000.0])
def test_viame_npz(scale: float, tmp_path: Path) -> None:
    (tmp_path / "calibration.npz").write_bytes(npz_bytes(RIG, scale))
    found = load_rig(tmp_path / "calibration.npz", SIZE)
    assert_same(found)
    assert "names no unit" in found.doubts[0]


def test_pickled_objects_are_never_loaded(tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return (Path.touch, (Path(tmp_path / "touched"),))  # type: ignore[return-value]

    (tmp_path / "calibration.npz").write_bytes(
        npz_bytes(RIG, extra=np.array([Bomb()], dtype=object))
    )
    with pytest.raises(CalibrationError, match="Python objects instead of numbers"):
        load_rig(tmp_path / "calibration.npz", SIZE)
    (tmp_path / "calibration.pkl").write_bytes(pickle.dumps(Bomb()))
    with pytest.raises(CalibrationError):
        load_rig(tmp_path / "calibration.pkl", SIZE)
    assert not (tmp_path / "touched").exists()


@pytest.mark.parametrize(("format", "name"), [("matlab", "stereo.mat"), ("viame", "rig.json")])
def test_written_files_come_back(format: str, name: str, tmp_path: Path) -> None:
    write_rig(RIG, tmp_path / name, format)  # type: ignore[arg-type]
    found = load_rig(tmp_path / name)
    assert_same(found)
    assert found.alternatives == ()


@pytest.mark.parametrize("format", ["matlab", "viame"])
def test_writers_refuse_other_lenses(format: str, tmp_path: Path) -> None:
    from dataclasses import replace

    fisheye = replace(RIG.left, distortion=np.zeros(4), model="fisheye")
    with pytest.raises(CalibrationError, match="fisheye camera has more"):
        write_rig(replace(RIG, left=fisheye, right=fisheye), tmp_path / "rig", format)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def seagis_numbers(x_mm: float, phi_deg: float, k3: float = 0.0) -> list[float]:
    """Principal point, distance 2.5 mm (500 px), k3 alone, the camera's place and angles."""
    return [0.01, -0.02, 2.5, k3, 0, 0, 0, 0, 0, 0, x_mm, 0, 0, 0, phi_deg, 0]


def test_seagis_pair(tmp_path: Path) -> None:
    """Cameras 120 mm apart, each turned inward by 3 degrees: a turn about photogrammetry's y (up)
    is against ours (down).
    """
    (tmp_path / "left.cam").write_bytes(cam_bytes(seagis_numbers(-60, -3)))
    (tmp_path / "right.cam").write_bytes(cam_bytes(seagis_numbers(60, 3)))
    found = load_rig(tmp_path)
    assert found.baseline_m == pytest.approx(0.12)
    assert found.left.image_size == SIZE
    np.testing.assert_allclose(
        found.left.K, [[500, 0, 319.5 + 2], [0, 500, 239.5 + 4], [0, 0, 1]], atol=1e-9
    )
    assert np.degrees(Rotation.from_matrix(found.R).magnitude()) == pytest.approx(6)
    assert found.T_right_left[0, 3] < 0
    assert len(found.alternatives) == 3


def test_seagis_distortion_is_added_to_measured_points(tmp_path: Path) -> None:
    k3 = -0.002  # mm^-2: measured points are drawn inward to the ideal ones
    for side in ("left", "right"):
        (tmp_path / f"{side}.cam").write_bytes(
            cam_bytes(seagis_numbers({"left": -60, "right": 60}[side], 0, k3))
        )
    camera = load_rig(f"{tmp_path}/left.cam,{tmp_path}/right.cam").left
    measured = np.array([[600.0, 400.0], [100.0, 30.0]])
    mm = (measured - camera.K[:2, 2]) * 0.005
    ideal = mm * (1 + k3 * (mm**2).sum(axis=1, keepdims=True)) / 2.5
    np.testing.assert_allclose(camera.rays(measured)[:, :2], ideal, atol=2e-4)


def test_seagis_interior_orientation_alone_is_refused(tmp_path: Path) -> None:
    (tmp_path / "left.cam").write_bytes(b"CBL\0" + bytes(300))
    with pytest.raises(CalibrationError, match="only the interior orientation"):
        load_rig(tmp_path / "left.cam")


FILES = {
    "v5": lambda path: write_mat5(path, stereo_objects(RIG)),
    "v5 uncompressed": lambda path: write_mat5(
        path, stereo_objects(RIG, modern=True), compress=False
    ),
    "v7.3": lambda path: write_mat73(path, stereo_objects(RIG)),
    "npz": lambda path: path.write_bytes(npz_bytes(RIG)),
    "matlab struct": lambda path: write_rig(RIG, path, "matlab"),
}


@pytest.mark.slow
@pytest.mark.posix
@pytest.mark.parametrize("name", FILES)
def test_damaged_files_give_one_line_soon(name: str, tmp_path: Path) -> None:
    """Cut off anywhere, bytes changed, filled with noise: a rig or one line, in time, memory and
    without code.
    """
    import resource

    file = tmp_path / "calib.bin"
    FILES[name](file)  # type: ignore[no-untyped-call]
    good = file.read_bytes()
    rng = np.random.default_rng(1)
    refused = 0
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for number in range(100):
        bad = bytearray(good)
        if number % 3 == 0:
            bad = bad[: int(rng.integers(4, len(good)))]
        elif number % 3 == 1:
            for at in rng.integers(128, len(good), 1 + number // 10):
                bad[at] = rng.integers(256)
        else:
            start = int(rng.integers(0, len(good) - 8))
            bad[start : start + 8] = struct.pack("<Q", int(rng.integers(2**63)))
        file.write_bytes(bad)
        begin = time.process_time()
        try:
            load_rig(file, SIZE)
        except CalibrationError as error:
            refused += 1
            assert (
                "\n" not in str(error)
                and len(str(error)) < 600
                and str(error).startswith(str(file))
            )
        assert time.process_time() - begin < 1.0
    assert refused > 40
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak_kb < 200_000


def test_what_a_damaged_file_claims_to_hold_is_not_allocated(tmp_path: Path) -> None:
    mat = Mat5()
    huge = mat.head(1, (2**30, 2**30), "a")
    file = tmp_path / "calib.mat"
    file.write_bytes(
        b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + b"\0\1IM" + mat.element(14, huge)
    )
    with pytest.raises(CalibrationError, match="is damaged: an array of shape"):
        load_rig(file)


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("name", "size", "baseline_mm"),
    [
        ("calibrations/caltech1.mat", (2048, 1536), 152.739),
        ("calibrations/viame_mm.npz", (1640, 1232), 209.786),
        ("calibrations/mcos_150.mat", (1920, 1080), 129.356),
        ("acfr/stereo_calib.mat", (1360, 1024), 80.351),
    ],
)
def test_real_files(name: str, size: tuple[int, int], baseline_mm: float, real_data: Path) -> None:
    rig = load_rig(real_data / name, size)
    assert rig.baseline_m * 1000 == pytest.approx(baseline_mm, abs=0.001)
    assert rig.left.image_size == size


def test_a_mat_file_of_version_4_is_named(tmp_path: Path) -> None:
    savemat(tmp_path / "old.mat", {"R": np.eye(3), "T": np.array([-80.35, 0.1, 0.7])}, format="4")
    with pytest.raises(
        CalibrationError, match="not a MAT-file of MATLAB 5 or later: save it again, with -v7"
    ):
        load_rig(tmp_path / "old.mat")
