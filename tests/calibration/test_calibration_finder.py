"""Calibrations whose matrices are found by form and words, at any nesting and in every notation;
what is not a rig is named.
"""

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from calibration_binaries import SIZE, small_rig
from scipy.spatial.transform import Rotation
from test_calibration_formats import seen

from calibration import CalibrationError, StereoRig
from calibration.formats import load_rig
from calibration.transforms import inverse, rigid_transform

RIG = small_rig()
R, T = RIG.R, RIG.T_right_left[:3, 3]
LEFT = {"camera_matrix": RIG.left.K, "distortion": RIG.left.distortion}
RIGHT = {"camera_matrix": RIG.right.K, "distortion": RIG.right.distortion}
QUATERNION = Rotation.from_matrix(R).as_quat().tolist()
ROTATION_VECTOR = cv2.Rodrigues(R)[0].ravel()


def rectified(unit: float) -> dict[str, Any]:
    """R1 R2 P1 P2 of stereoRectify."""
    names = ("R1", "R2", "P1", "P2", "Q")
    matrices = cv2.stereoRectify(
        RIG.left.K,
        RIG.left.distortion,
        RIG.right.K,
        RIG.right.distortion,
        SIZE,
        R,
        T[:, None] * unit,
        alpha=0,
    )
    return dict(zip(names, matrices, strict=False))


def skew(v: Any) -> Any:
    return np.cross(np.eye(3), v)


def four(camera: Any) -> list[float]:
    return [float(camera.K[i]) for i in ((0, 0), (1, 1), (0, 2), (1, 2))]


def lens(camera: Any, **more: Any) -> dict[str, Any]:
    """An OKVIS-like lens: pairs of numbers instead of a matrix."""
    (fx, fy, cx, cy), size = four(camera), {"image_dimension": list(SIZE)}
    return (
        {
            "focal_length": [fx, fy],
            "principal_point": [cx, cy],
            "distortion_coeffs": camera.distortion,
        }
        | size
        | more
    )


BODY_LEFT = rigid_transform(
    Rotation.from_euler("xz", [90, 90], degrees=True).as_matrix(), [0.6, 0.1, 0.2]
)
"""A camera that looks ahead, in axes of a vehicle: x forward, y to starboard."""
BODY_RIGHT = BODY_LEFT @ inverse(RIG.T_right_left)
LENSES = {
    "width": 640, "height": 480, "K1": RIG.left.K, "D1": RIG.left.distortion, "K2": RIG.right.K,
    "D2": RIG.right.distortion,
}  # fmt: skip


def apart(pose: Any, names: tuple[str, str] = ("rotation", "translation")) -> dict[str, Any]:
    return dict(zip(names, (pose[:3, :3], pose[:3, 3]), strict=True))


def placed(pose: Any) -> dict[str, Any]:
    return {"xyz": pose[:3, 3], "xyzw": Rotation.from_matrix(pose[:3, :3]).as_quat()}


NESTED: dict[str, dict[str, Any]] = {
    "numbered poses beside lenses that are counted otherwise": LENSES | {
        "body_T_imu": np.eye(4), "body_T_cam0": BODY_LEFT, "body_T_cam1": BODY_RIGHT,
    },
    "the same poses into the cameras": LENSES | {
        "cam0_T_body": inverse(BODY_LEFT), "cam1_T_body": inverse(BODY_RIGHT),
        "dvl_T_body": np.eye(4),
    },
    "a list of sensors": {"sensors": [
        {"name": "dvl", "T_body_sensor": BODY_LEFT},
        {"name": "imu", "T_body_sensor": np.eye(4)},
        {"name": "cam_left", "T_body_sensor": BODY_LEFT, "size": [640, 480]} | LEFT,
        {"name": "cam_right", "T_body_sensor": BODY_RIGHT, "size": [640, 480]} | RIGHT,
    ]},
    "R and T of each camera to a body": {
        "size": [640, 480], "left": LEFT | {"to_body": apart(BODY_LEFT)},
        "right": RIGHT | {"to_body": apart(BODY_RIGHT)}, "imu": {"to_body": apart(BODY_LEFT)},
    },
    "R and T of each camera that only a rig side by side decides": {
        "size": [640, 480], "left": LEFT | {"extrinsics": apart(BODY_LEFT)},
        "right": RIGHT | {"extrinsics": apart(BODY_RIGHT)}, "imu": {"extrinsics": apart(BODY_LEFT)},
    },
    "places and quaternions": {
        "size": [640, 480], "left": LEFT | placed(BODY_LEFT), "right": RIGHT | placed(BODY_RIGHT),
        "dvl": placed(np.eye(4)),
    },
    "a rectified rig beside the raw one": {
        "rectified": {"left": LEFT, "right": LEFT, "size": [640, 480], "R": np.eye(3),
        "T": [-0.12, 0, 0]},
        "raw": {"left": LEFT, "right": RIGHT, "size": [640, 480], "R": R, "T": T},
    },
    "a rectification in a mapping of its own": {
        "image": {"width_px": 640, "height_px": 480}, "left_camera": LEFT, "right_camera": RIGHT,
        "stereo": {"rms_px": 0.4, "rectification": rectified(1000)},
    },
    "a rectification at the top": {"image_width": 640, "image_height": 480, "left": LEFT,
    "right": RIGHT} | rectified(1),
    "the unit in the translation's key": {
        "size": [640, 480], "left_camera": LEFT, "right_camera": RIGHT,
        "stereo": {"rotation_matrix": R, "translation_vector_mm": T * 1000},
    },
    "a transform whose key names both sides": {
        "imageSizeL": [640, 480], "imageSizeR": [640, 480], "cam_l": LEFT, "cam_r": RIGHT,
        "T_left_to_right": RIG.T_right_left,
    },
    "a transform the other way": {
        "imgSize_left": [640, 480], "left": LEFT, "right": RIGHT,
        "T_right_to_left": inverse(RIG.T_right_left),
    },
    "poses of cameras on a body": {
        "left_params": lens(RIG.left, T_SC=np.eye(4)), "right_params": lens(RIG.right,
        T_SC=inverse(RIG.T_right_left)),
    },
    "a pose for each camera": {
        "cam_1": {"matrix": RIG.left.K, "distortions": RIG.left.distortion, "size": [640, 480],
                  "rotation": [0.0, 0, 0], "translation": [0.0, 0, 0]},
        "cam_2": {"matrix": RIG.right.K, "distortions": RIG.right.distortion, "size": [640, 480],
                  "rotation": ROTATION_VECTOR, "translation": T * 1000},
    },
    "a board and its views, which are no part of the rig": {
        "board": {"size": [9, 6], "square": 0.03, "R": np.eye(3), "T": [0, 0, 1.0]},
        "resolution": [640, 480],
        "calibration": {"result": {"K1": RIG.left.K, "D1": RIG.left.distortion, "K2": RIG.right.K,
        "D2": RIG.right.distortion,
                                   "R": R, "T": T}},
        "views": [{"R": np.eye(3), "T": [0, 0, 1.0]}, {"R": np.eye(3), "T": [0, 0, 2.0]}],
    },
    "fx fy cx cy in four": {
        "width": 640, "height": 480, "R": R, "T": T,
        "left": {"intrinsics": four(RIG.left), "dist": RIG.left.distortion},
        "right": {"intrinsics": four(RIG.right), "dist": RIG.right.distortion},
    },
    "a quaternion": {
        "size": [640, 480], "cam_left": LEFT, "cam_right": RIGHT,
        "transform": {"translation": dict(zip("xyz", T.tolist(), strict=True)),
                      "rotation": dict(zip("xyzw", QUATERNION, strict=True))},
    },
    "both cameras' matrices in one array": {
        "K": np.stack([RIG.left.K, RIG.right.K]), "D": np.stack([RIG.left.distortion,
        RIG.right.distortion]), "R": R, "T": T,
        "shape": [480, 640, 3],
    },
    "radial and tangential apart": {
        "im_w": 640, "im_h": 480, "R": R, "T": T,
        **{side: {"K": camera.K, "radial": camera.distortion[[0, 1, 4]],
        "tangential": camera.distortion[2:4]}
           for side, camera in (("left", RIG.left), ("right", RIG.right))},
    },
    "names in a list, the right camera first": {
        "cameras": [{"name": "right", "K": RIG.right.K, "dist": RIG.right.distortion, "R": R,
        "t": T, "size": "640x480"},
                    {"name": "left", "K": RIG.left.K, "dist": RIG.left.distortion, "R": np.eye(3),
                    "t": [0] * 3,
                     "size": [640, 480]}],
    },
    "rectification beside it, as the tutorials save all": {
        "mtxL": RIG.left.K, "distL": RIG.left.distortion, "mtxR": RIG.right.K,
        "distR": RIG.right.distortion, "rot": R, "trans": T,
        "newCameraMatrixL": 1.1 * RIG.left.K, "newCameraMatrixR": 1.1 * RIG.right.K, "roi_L": [1, 2,
        630, 470],
        "imgSizeL": [640, 480],
        **{key.replace("1", "L").replace("2", "R"): value for key, value in rectified(1).items()},
        "E": skew(T) @ R, "F": RIG.left.K.T,
    },
    "rows before columns, as arrays have them": {
        "image_shape": [480, 640], "K1": RIG.left.K, "D1": RIG.left.distortion, "K2": RIG.right.K,
        "D2": RIG.right.distortion,
        "R": R, "T": T,
    },
}  # fmt: skip


def plain(value: Any) -> Any:
    """Lists instead of arrays."""
    if isinstance(value, dict):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [plain(inner) for inner in value]
    return value.tolist() if isinstance(value, np.ndarray) else value


def write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(plain(content)))


def write_yaml(path: Path, content: dict[str, Any]) -> None:
    path.write_text(yaml.safe_dump(plain(content)))


def write_mat(path: Path, content: dict[str, Any]) -> None:
    from scipy.io import savemat

    savemat(path, content)


def write_npz(path: Path, content: dict[str, Any]) -> None:
    """Keys of inner mappings with a dot between."""
    flat: dict[str, Any] = {}
    pending: list[tuple[str, Any]] = [("", content)]
    while pending:
        name, value = pending.pop()
        if isinstance(value, dict):
            pending += [(f"{name}.{key}" if name else key, inner) for key, inner in value.items()]
        elif not isinstance(value, list) or not any(isinstance(one, dict) for one in value):
            flat[name] = np.asarray(value)
    with path.open("wb") as file:
        np.savez(file, **flat)


WRITERS = {".json": write_json, ".yaml": write_yaml, ".mat": write_mat, ".npz": write_npz}


IN_A_LIST = ("names in a list, the right camera first", "a list of sensors")
"""What an .npz cannot hold."""
CASES = [
    (name, suffix)
    for name in NESTED
    for suffix in WRITERS
    if name not in IN_A_LIST or suffix != ".npz"
]


def assert_same(found: StereoRig, atol: float = 1e-9) -> None:
    np.testing.assert_allclose(seen(found), seen(RIG), rtol=0, atol=max(atol, 1e-9))
    np.testing.assert_allclose(found.T_right_left, RIG.T_right_left, atol=max(atol, 1e-9))
    assert found.left.image_size == found.right.image_size == SIZE


@pytest.mark.parametrize(("name", "suffix"), CASES)
def test_any_nesting_in_any_notation(name: str, suffix: str, tmp_path: Path) -> None:
    WRITERS[suffix](tmp_path / f"rig{suffix}", NESTED[name])
    assert_same(load_rig(tmp_path / f"rig{suffix}"))


@pytest.mark.parametrize("deep", [1, 4])
@pytest.mark.parametrize("write", [write_json, write_yaml])
def test_more_mappings_around_change_nothing(
    write: Callable[[Path, dict[str, Any]], None], deep: int, tmp_path: Path
) -> None:
    for name, content in NESTED.items():
        for i in range(deep):
            content = {f"layer {'abcd'[i]}": content, "made": "2026-05-01"}
        write(tmp_path / f"{name}.txt", content)
        assert_same(load_rig(tmp_path / f"{name}.txt"))


@pytest.mark.parametrize("unit", [1, 1000])
def test_projections_in_block_yaml_are_not_kittis(unit: float, tmp_path: Path) -> None:
    content = {
        "K1": RIG.left.K,
        "D1": RIG.left.distortion,
        "K2": RIG.right.K,
        "D2": RIG.right.distortion,
    } | rectified(unit)
    write_yaml(tmp_path / "rig.yaml", content)
    found = load_rig(tmp_path / "rig.yaml", SIZE)
    assert_same(found)
    assert any("millimeters" in doubt for doubt in found.doubts) == (unit == 1000)


@pytest.mark.parametrize("inverted", [False, True])
def test_a_transform_of_open_sense_carries_both_readings(inverted: bool, tmp_path: Path) -> None:
    transform = inverse(RIG.T_right_left) if inverted else RIG.T_right_left
    matrices = {
        "LEFT.K": RIG.left.K,
        "LEFT.D": RIG.left.distortion,
        "RIGHT.K": RIG.right.K,
        "RIGHT.D": RIG.right.distortion,
    }
    writer = cv2.FileStorage(
        str(tmp_path / "settings.yaml"), cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_FORMAT_YAML
    )
    for key, matrix in (matrices | {"LEFT.RIGHT": transform}).items():
        writer.write(key.replace(".", "_"), matrix)
    writer.release()
    text = (tmp_path / "settings.yaml").read_text()
    for key in ("LEFT_K", "LEFT_D", "RIGHT_K", "RIGHT_D", "LEFT_RIGHT"):
        text = text.replace(f"{key}:", f"{key.replace('_', '.')}:")
    (tmp_path / "settings.yaml").write_text(text)
    found = load_rig(tmp_path / "settings.yaml", SIZE)
    assert_same(found)
    assert len(found.alternatives) == int(inverted)


def test_two_baselines_in_a_file_are_named(tmp_path: Path) -> None:
    content = NESTED["poses of cameras on a body"] | {"stereo": {"R": R, "T": T * 1.05}}
    write_json(tmp_path / "rig.json", content)
    found = load_rig(tmp_path / "rig.json")
    np.testing.assert_allclose(found.T_right_left[:3, 3], T * 1.05)
    assert any("two baselines" in doubt and "stereo.T is used" in doubt for doubt in found.doubts)


def pose_at(x: float) -> list[list[float]]:
    """In meters along x, turned by 90 degrees where it is not zero."""
    turned = Rotation.from_euler("z", 90 if x else 0, degrees=True).as_matrix()
    return [*np.column_stack([turned, [x, 0, 0]]).tolist(), [0, 0, 0, 1]]


SENSORS: dict[str, dict[str, Any]] = {
    "an IMU": {"imu0": {"body_T_imu": pose_at(0.35)}},
    "an IMU in the body's axes": {"imu0": {"T_imu_body": pose_at(0.3), "rate_hz": 200}},
    "an IMU at the origin": {"imu0": {"body_T_imu": pose_at(0.0)}},
    "a compass": {"mag0": {"body_T_sensor": pose_at(0.05)}},
    "a DVL": {"dvl0": {"T": pose_at(0.3)}},
    "a DVL of R and T": {"dvl": {"R": [row[:3] for row in pose_at(0.3)[:3]], "T": [0.3, 0, 0]}},
    "a USBL receiver": {"usbl": {"extrinsics": pose_at(0.4)}},
    "an acoustic receiver": {"aps0": {"body_T_receiver": pose_at(0.4)}},
    "a depth sensor": {"depth0": {"T_body_sensor": pose_at(0.2)}},
    "a lidar": {"lidar": {"body_T_lidar": pose_at(0.11)}},
    "a lidar at one camera": {"T_cam_lidar": pose_at(0.11)},
    "a sensor of another name": {"xyz7": {"pose": pose_at(0.25)}},
    "a sensor of another name at the origin": {"xyz": {"pose": pose_at(0.0)}},
    "all of them": {},
}
SENSORS["all of them"] = {key: value for case in SENSORS.values() for key, value in case.items()}


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("cameras", ["poses of cameras on a body", "stereo"])
@pytest.mark.parametrize("sensor", SENSORS)
def test_the_place_of_another_sensor_is_no_baseline(
    sensor: str, cameras: str, first: bool, tmp_path: Path
) -> None:
    rig = NESTED["poses of cameras on a body"]
    if cameras == "stereo":
        rig = {"left": LEFT, "right": RIGHT, "stereo": {"R": R, "T": T}}
    write_json(tmp_path / "rig.json", SENSORS[sensor] | rig if first else rig | SENSORS[sensor])
    found = load_rig(tmp_path / "rig.json", SIZE)
    assert_same(found)
    named = [doubt for doubt in found.doubts if "baselines" in doubt]
    assert not named or "another name" in sensor or "all" in sensor


def open_icc(camera: Any, size: tuple[int, int] = SIZE) -> dict[str, Any]:
    (fx, fy, cx, cy), D = four(camera), camera.distortion.tolist()
    return {
        "intrinsic_type": "PINHOLE_RADIAL_TANGENTIAL", "fps": 29.97, "nr_calib_images": 89,
        "image_width": size[0], "image_height": size[1], "final_reproj_error": 0.3,
        "intrinsics": {
            "aspect_ratio": fy / fx, "focal_length": fx, "principal_pt_x": cx, "principal_pt_y": cy,
            "radial_distortion_1": D[0], "radial_distortion_2": D[1],
            "radial_distortion_3": [*D, 0.0][4],
            "tangential_distortion_1": D[2], "tangential_distortion_2": D[3], "skew": 0.0,
        },
    }  # fmt: skip


def test_lenses_of_open_icc(tmp_path: Path) -> None:
    """One lens each, without the transform between them."""
    for side in ("left", "right"):
        write_json(tmp_path / f"{side}.json", open_icc(getattr(RIG, side)))
    files = ",".join(str(tmp_path / f"{side}.json") for side in ("left", "right"))
    with pytest.raises(CalibrationError, match=r"contains one lens, and so does .*write R and T"):
        load_rig(files)
    with pytest.raises(CalibrationError, match="contains only one lens: give"):
        load_rig(tmp_path / "left.json")
    write_json(tmp_path / "stereo.json", {"R": R, "T": T})
    assert_same(load_rig(tmp_path))


MATRICES = {
    "K1": RIG.left.K,
    "D1": RIG.left.distortion,
    "K2": RIG.right.K,
    "D2": RIG.right.distortion,
    "R": R,
    "T": T * 1000,
}


@pytest.mark.parametrize("suffix", [".npy", ".csv", ".txt"])
def test_a_matrix_a_file_as_numpy_saves_them(suffix: str, tmp_path: Path) -> None:
    beside = rectified(1000)  # of stereoRectify: its P1 is no second camera matrix
    for name, matrix in (MATRICES | beside).items():
        if suffix == ".npy":
            np.save(tmp_path / f"{name}.npy", matrix)
        else:
            np.savetxt(
                tmp_path / f"{name}{suffix}",
                np.atleast_2d(matrix),
                delimiter="," if suffix == ".csv" else " ",
            )
    assert_same(load_rig(tmp_path, SIZE))


def test_a_folder_a_camera(tmp_path: Path) -> None:
    for side, camera in (("camera1", RIG.left), ("camera2", RIG.right)):
        (tmp_path / side).mkdir()
        np.savetxt(tmp_path / side / "intrinsic_matrix.csv", camera.K, delimiter=",")
        np.savetxt(
            tmp_path / side / "distortion_coeffs.csv", camera.distortion[None], delimiter=","
        )
    beside = rectified(1)
    for name, numbers in {"R": R, "t": T, "im_size": np.array(SIZE), **beside}.items():
        np.savetxt(tmp_path / f"{name}.csv", numbers, delimiter=",", fmt="%.9g")
    assert_same(load_rig(tmp_path), 1e-8)


def test_a_rotation_of_three_decimals_is_taken_for_the_nearest_one(tmp_path: Path) -> None:
    rolled = cv2.Rodrigues(np.array([0.01, -0.02, 0.224]))[0]
    for name, matrix in (MATRICES | {"R": rolled}).items():
        np.savetxt(tmp_path / f"{name}.csv", np.atleast_2d(matrix), delimiter=",", fmt="%.3f")
    found = load_rig(tmp_path, SIZE)
    np.testing.assert_allclose(found.R @ found.R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(found.R, rolled, atol=1e-3)


def test_anipose_toml_and_krtd(tmp_path: Path) -> None:
    tables = ""
    for i, (camera, vector, shift) in enumerate(
        ((RIG.left, np.zeros(3), np.zeros(3)), (RIG.right, ROTATION_VECTOR, T * 1000))
    ):
        numbers = {
            "matrix": camera.K,
            "distortions": camera.distortion,
            "rotation": vector,
            "translation": shift,
        }
        tables += f'[cam_{i}]\nname = "{"AB"[i]}"\nsize = [ 640, 480,]\n' + "".join(
            f"{k} = {v.tolist()}\n" for k, v in numbers.items()
        )
        own = R if i else np.eye(3)
        blocks = [camera.K, own, shift[None] / 1000, camera.distortion[None]]
        rows = ["\n".join(" ".join(map(repr, row)) for row in block.tolist()) for block in blocks]
        (tmp_path / f"{'left' if i == 0 else 'right'}.krtd").write_text("\n\n".join(rows) + "\n")
    (tmp_path / "rig.toml").write_text(tables + "[metadata]\nadjusted = false\nerror = 0.2\n")
    assert_same(load_rig(tmp_path / "rig.toml"))
    assert_same(load_rig(f"{tmp_path}/left.krtd,{tmp_path}/right.krtd", SIZE))


def test_a_report_for_people(tmp_path: Path) -> None:
    matrices = {"ROTATION MATRIX (R)": R, "TRANSLATION VECTOR (T) [mm]": T * 1000}
    for side, camera in (("LEFT", RIG.left), ("RIGHT", RIG.right)):
        matrices |= {f"{side} CAMERA MATRIX": camera.K, f"{side} DISTORTION": camera.distortion}
    with np.printoptions(precision=12):
        text = "=== STEREO REPORT ===\n=====\nSquare size: 30 mm\n\n" + "".join(
            f"{name}:\n{M}\n\n" for name, M in matrices.items()
        )
    more = (
        "IMAGE SIZE (width x height):\n640 480\n\n=== MORE ===\nPitch, yaw [degrees]: -0.1, 0.2\n"
    )
    (tmp_path / "report.txt").write_text(text + more)
    found = load_rig(tmp_path / "report.txt")
    assert_same(found, 1e-9)
    assert not found.doubts


def one_lens(path: Path, camera: Any) -> None:
    write_json(
        path, {"camera_matrix": camera.K, "dist_coeff": camera.distortion, "image_size": list(SIZE)}
    )


def test_one_lens_each(tmp_path: Path) -> None:
    one_lens(tmp_path / "left.json", RIG.left)
    one_lens(tmp_path / "right.json", RIG.right)
    with pytest.raises(
        CalibrationError,
        match=r"left.json: contains one lens, and so does .*right.json: R and T between them are "
        r"missing",
    ):
        load_rig(f"{tmp_path}/left.json,{tmp_path}/right.json")
    with pytest.raises(CalibrationError, match=r"left\.json"):
        load_rig(tmp_path / "left.json")
    write_json(tmp_path / "stereo.json", {"R": R, "T": T})
    assert_same(load_rig(tmp_path))


def content_of(**other: Any) -> dict[str, Any]:
    return {
        "K1": RIG.left.K,
        "D1": RIG.left.distortion,
        "K2": RIG.right.K,
        "D2": RIG.right.distortion,
        "R": R,
        "T": T,
    } | other


WRONG = {
    "the size of the images": (content_of(), r"\(--size WIDTHxHEIGHT\)"),
    "one camera matrix": (
        {k: v for k, v in content_of().items() if k != "K2"},
        "only one camera matrix, K1",
    ),
    "one distortion": (
        {k: v for k, v in content_of().items() if k != "D1"},
        "only one distortion, D2",
    ),
    "R without T": ({k: v for k, v in content_of().items() if k != "T"}, "holds R and no T"),
    "a NaN": (content_of(T=[float("nan"), 0, 0]), "T: nan is not a finite number"),
    "a negative focal length": (
        content_of(K2=RIG.right.K * [[1], [-1], [1]], size=[640, 480]),
        "K2: focal lengths must be positive",
    ),
    "a lens that OpenCV has not": (
        content_of(distortion_model="omni", size=[640, 480]),
        "'omni' is not supported",
    ),
    "half pixels": (content_of(size=[640.5, 480]), "whole numbers"),
    "three cameras": (
        content_of(K3=1) | {f"cam_{i}": LEFT for i in range(3)} | {"K1": 0, "K2": 0},
        "holds 3 cameras",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_named(name: str, tmp_path: Path) -> None:
    content, message = WRONG[name]
    write_yaml(tmp_path / "rig.yaml", content)
    with pytest.raises(CalibrationError, match=message):
        load_rig(tmp_path / "rig.yaml")


FOREIGN = {
    "XMP": '<x:xmpmeta xmlns:x="adobe:ns:meta/"><a '
    'xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#"/></x:xmpmeta>',
    "Meshroom": '{"version": ["1"], "intrinsics": [{"intrinsicId": "1", "width": "640"}]}',
    "OpenSfM": '{"left": {"rotation": [0, 0, 0], "translation": [0, 0, 0]}, "right": '
    '{"rotation": [0, 0, 0]}}',
    "Gyroflow": '{"calibrated_by": "a", "calib_dimension": {"w": 640, "h": 480}}',
    "OCamCalib": "#polynomial coefficients (ocam_model.ss in MATLAB).\n\n5 -7.4e+02 0.0 8.8e-04 \n",
    "Ames Stereo Pipeline": "ref_sensor_name: lnav\n\nsensor_name: lnav\n\nsensor_name: rnav\n",
    "oplab": "version: 1\norigin:\n  latitude: 50.8\n  longitude: -1.4\n",
}


@pytest.mark.parametrize("name", FOREIGN)
def test_foreign_files_are_named(name: str, tmp_path: Path) -> None:
    (tmp_path / "rig.txt").write_text(FOREIGN[name])
    with pytest.raises(CalibrationError, match=rf"{name}.*is not supported: write"):
        load_rig(tmp_path / "rig.txt")


def test_an_archive_names_what_it_holds(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "c.zip", "w") as archive:
        archive.writestr("cam.yaml", "a: 1")
    with pytest.raises(CalibrationError, match=r"is an archive \(cam.yaml\): unpack it"):
        load_rig(tmp_path / "c.zip")


def test_the_rig_of_a_colmap_model_has_the_models_scale(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text(
        "1 PINHOLE 640 480 500 500 320 240\n2 PINHOLE 640 480 500 500 320 240\n"
    )
    (tmp_path / "rigs.txt").write_text("1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 -0.162 0 0\n")
    for path in (f"{tmp_path}/rigs.txt,{tmp_path}/cameras.txt", str(tmp_path)):
        assert any(
            "has the scale of the model" in doubt and "162.0 mm" in doubt
            for doubt in load_rig(path).doubts
        )
    (tmp_path / "rigs.txt").write_text("1 2 CAMERA 1 CAMERA 2 1 1 0 0 0 -0.0016 0 0\n")
    with pytest.raises(
        CalibrationError, match=r"has the scale of the model.*a baseline of 0.0016 m is impossible"
    ):
        load_rig(tmp_path)
