"""OpenCV's matrices by the names that tools give them, in one file or in several; VIAME's JSON;
settling an open convention.
"""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from calibration_binaries import SIZE, small_rig, stereo_objects, write_mat5
from calibration_boards import rendered
from drawn_rigs import affine, drawn_dive, turned
from scipy.spatial.transform import Rotation
from test_calibration_formats import seen

from calibration import CalibrationError, Rectification, StereoRig
from calibration.checks import rows_off_px
from calibration.formats import load_rig, write_rig
from calibration.formats.ros import rectified_rig, transform_of_projections
from calibration.rectification import raw_points
from calibration.verification.conventions import resolve_convention, settle_matches
from calibration.verification.matches import Matches, rectified_matches

RIG = small_rig()


def storage(path: Path, **values: object) -> None:
    """An OpenCV FileStorage."""
    writer = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in values.items():
        writer.write(key, np.asarray(value) if not isinstance(value, (int, float, str)) else value)
    writer.release()


def assert_same(found: StereoRig) -> None:
    np.testing.assert_allclose(seen(found), seen(RIG), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.T_right_left, RIG.T_right_left, atol=1e-9)


@pytest.mark.parametrize(
    ("K", "D"),
    [
        (("K1", "K2"), ("D1", "D2")),
        (("M1", "M2"), ("D1", "D2")),
        (("cameraMatrixL", "cameraMatrixR"), ("distCoeffsL", "distCoeffsR")),
        (("camera_matrix_left", "camera_matrix_right"), ("dist_coeffs_left", "dist_coeffs_right")),
        (
            ("left_camera_matrix", "right_camera_matrix"),
            ("left_distortion_coefficients", "right_distortion_coefficients"),
        ),
        (("K_l", "K_r"), ("D_l", "D_r")),
    ],
)
@pytest.mark.parametrize("vector", [False, True])
def test_spellings(K: tuple[str, str], D: tuple[str, str], vector: bool, tmp_path: Path) -> None:
    R = cv2.Rodrigues(RIG.R)[0] if vector else RIG.R
    matrices = {
        K[0]: RIG.left.K,
        K[1]: RIG.right.K,
        D[0]: RIG.left.distortion[None],
        D[1]: RIG.right.distortion[None],
    }
    storage(tmp_path / "stereo.yml", **matrices, R=R, T=RIG.T_right_left[:3, 3:])
    assert_same(load_rig(tmp_path / "stereo.yml", SIZE))


@pytest.mark.parametrize("key", ["T", "transform", "extrinsics"])
def test_rotation_and_translation_in_one_matrix(key: str, tmp_path: Path) -> None:
    cameras = {
        "K1": RIG.left.K,
        "K2": RIG.right.K,
        "D1": RIG.left.distortion,
        "D2": RIG.right.distortion,
    }
    np.savez(tmp_path / "stereo.npz", **cameras, **{key: RIG.T_right_left})
    (tmp_path / "stereo.json").write_text(
        json.dumps({name: M.tolist() for name, M in (cameras | {key: RIG.T_right_left}).items()})
    )
    for name in ("stereo.npz", "stereo.json"):
        assert_same(load_rig(tmp_path / name, SIZE))


@pytest.mark.parametrize("fisheye", [False, True])
def test_zed_custom_calibration(fisheye: bool, tmp_path: Path) -> None:
    words = ("D_LEFT_FE", "D_RIGHT_FE") if fisheye else ("D_LEFT", "D_RIGHT")
    distortion = {
        word: camera.distortion[: 4 if fisheye else 5]
        for word, camera in zip(words, (RIG.left, RIG.right), strict=True)
    }
    pose = {"R": cv2.Rodrigues(RIG.R)[0], "T": RIG.T_right_left[:3, 3:] * 1000}
    storage(
        tmp_path / "zed_calibration_1.yml",
        K_LEFT=RIG.left.K,
        K_RIGHT=RIG.right.K,
        **distortion,
        **pose,
    )
    text = (
        (tmp_path / "zed_calibration_1.yml")
        .read_text()
        .replace("---\n", "---\nSize: [ 640, 480 ]\n")
    )
    (tmp_path / "zed_calibration_1.yml").write_text(text)
    found = load_rig(tmp_path / "zed_calibration_1.yml")
    assert found.left.model == ("fisheye" if fisheye else "pinhole")
    assert found.doubts == ()
    np.testing.assert_allclose(found.T_right_left, RIG.T_right_left, atol=1e-9)


def test_four_coefficients_are_opencvs_unless_images_say_fisheye(tmp_path: Path) -> None:
    distortion = RIG.left.distortion[:4]
    pose = {"R": RIG.R, "T": RIG.T_right_left[:3, 3:]}
    storage(
        tmp_path / "stereo.yml",
        K1=RIG.left.K,
        K2=RIG.right.K,
        D1=distortion[:, None],
        D2=distortion[:, None],
        **pose,
    )
    found = load_rig(tmp_path / "stereo.yml", SIZE)
    assert (found.left.model, found.alternatives[0].left.model) == ("pinhole", "fisheye")
    np.testing.assert_array_equal(found.left.distortion, distortion)
    storage(
        tmp_path / "none.yml",
        K1=RIG.left.K,
        K2=RIG.right.K,
        D1=np.zeros((1, 4)),
        D2=np.zeros((1, 4)),
        **pose,
    )
    assert load_rig(tmp_path / "none.yml", SIZE).alternatives == ()


@pytest.mark.parametrize(
    "words", [("rotation_matrix", "translation_vector"), ("rotation", "translation"), ("R", "T")]
)
def test_plain_lists_and_a_mapping_a_camera(words: tuple[str, str], tmp_path: Path) -> None:
    cameras = {
        side: {"K": camera.K.tolist(), "dist": camera.distortion.tolist()}
        for side, camera in (("left", RIG.left), ("right", RIG.right))
    }
    pose = dict(zip(words, (RIG.R.tolist(), RIG.T_right_left[:3, 3].tolist()), strict=True))
    (tmp_path / "rig.json").write_text(json.dumps(cameras | pose))
    assert_same(load_rig(tmp_path / "rig.json", SIZE))


def test_rectified_images_need_no_distortion(tmp_path: Path) -> None:
    K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
    P1, P2 = np.c_[K, np.zeros(3)], np.c_[K, [-60.0, 0, 0]]
    storage(tmp_path / "projections.yml", P1=P1, P2=P2, Q=np.eye(4))
    storage(tmp_path / "cameras.yml", K1=K, K2=K, R=np.eye(3), T=np.array([[-0.1], [0], [0]]))
    for name in ("projections.yml", "cameras.yml"):
        found = load_rig(tmp_path / name, SIZE)
        assert found.is_rectified
        assert found.baseline_m == pytest.approx(0.1)
    storage(tmp_path / "turned.yml", K1=K, K2=K, R=RIG.R, T=np.array([[-0.1], [0], [0]]))
    with pytest.raises(CalibrationError, match="no 'D1' and 'D2'"):
        load_rig(tmp_path / "turned.yml", SIZE)


def test_millimeters_are_taken_as_such_and_named(tmp_path: Path) -> None:
    matrices = {
        "M1": RIG.left.K,
        "M2": RIG.right.K,
        "D1": RIG.left.distortion[None],
        "D2": RIG.right.distortion[None],
    }
    storage(tmp_path / "stereo.yml", **matrices, R=RIG.R, T=RIG.T_right_left[:3, 3:] * 1000)
    found = load_rig(tmp_path / "stereo.yml", SIZE)
    np.testing.assert_allclose(found.T_right_left, RIG.T_right_left, atol=1e-9)
    assert "read as millimeters" in found.doubts[0]


def test_a_matrix_a_file(tmp_path: Path) -> None:
    parts = {
        "M1": RIG.left.K,
        "D1": RIG.left.distortion[None],
        "M2": RIG.right.K,
        "D2": RIG.right.distortion[None],
    }
    for name, matrix in (parts | {"R": RIG.R, "T": RIG.T_right_left[:3, 3:]}).items():
        storage(tmp_path / f"{name}.xml", **{"matrix" if name == "R" else name: matrix})
    assert_same(load_rig(tmp_path, SIZE))


def test_a_camera_a_file_and_extrinsics(tmp_path: Path) -> None:
    for side, camera in (("left", RIG.left), ("right", RIG.right)):
        storage(
            tmp_path / f"intrinsics_{side}.xml",
            camera_matrix=camera.K,
            distortion_coefficients=camera.distortion[None],
        )
    storage(tmp_path / "extrinsics.xml", R=RIG.R, T=RIG.T_right_left[:3, 3:])
    assert_same(load_rig(tmp_path, SIZE))


def test_parts_that_make_no_rig_are_named(tmp_path: Path) -> None:
    storage(tmp_path / "M1.xml", M1=RIG.left.K)
    with pytest.raises(CalibrationError, match=r"found M1.xml \(one lens\)"):
        load_rig(tmp_path, SIZE)


@pytest.mark.parametrize(("scale", "more"), [(1000, {"square_size_mm": 80}), (1000, {}), (1, {})])
def test_viame_json(scale: float, more: dict[str, float], tmp_path: Path) -> None:
    write_rig(replace(RIG, rms_px=0.4), tmp_path / "rig.json", "viame")
    content = json.loads((tmp_path / "rig.json").read_text()) | more
    content["T"] = (RIG.T_right_left[:3, 3] * scale).tolist()
    (tmp_path / "rig.json").write_text(json.dumps(content))
    found = load_rig(tmp_path / "rig.json")
    assert_same(found)
    assert found.rms_px == 0.4
    assert bool(found.doubts) == (not more)


@pytest.mark.slow
@pytest.mark.parametrize("transposed", [True, False])
def test_images_settle_the_convention_of_matlab(transposed: bool, tmp_path: Path) -> None:
    rig = load_rig(write_mat5(tmp_path / "calib.mat", stereo_objects(RIG, transposed=transposed)))
    sand = cv2.GaussianBlur(
        np.random.default_rng(0).integers(0, 256, (500, 700), dtype=np.uint8), (0, 0), 1.5
    )
    sand = cv2.normalize(sand, None, 0, 255, cv2.NORM_MINMAX)
    pose = np.eye(4)
    pose[2, 3] = 0.9
    corner = np.array([-0.5, -0.36])
    images = [
        rendered(camera, extrinsic @ pose, sand, 700, corner)
        for camera, extrinsic in ((RIG.left, np.eye(4)), (RIG.right, RIG.T_right_left))
    ]
    settled = resolve_convention(rig, [(images[0], images[1])])
    np.testing.assert_allclose(settled.R, RIG.R, atol=1e-9)
    assert settled.alternatives == ()
    assert "this reading fits the images" in settled.doubts[-1]
    assert Rectification.from_rig(settled).pair.baseline_m == pytest.approx(RIG.baseline_m)


def test_readings_that_fit_alike_are_not_called_settled() -> None:
    drawn = drawn_dive(pairs=3)
    raw = [Matches(*raw_points(drawn.rig, one.left, one.right)) for one in drawn.matches]
    doubts = {
        name: settle_matches(replace(drawn.rig, alternatives=(other,)), raw).doubts[-1]
        for name, other in {"alike": drawn.rig, "worse": turned(roll=0.05)}.items()
    }
    assert "the images do not decide" in doubts["alike"]
    assert "this reading fits the images" in doubts["worse"]


def test_a_reading_is_right_if_it_leaves_the_fewest_faults() -> None:
    """Right images 15 px lower than calibrated: their rows agree better with the wrong reading."""
    true = turned(pitch=0.008)
    T = true.T_right_left.copy()
    T[:3, :3] = T[:3, :3].T
    wrong = replace(true, T_right_left=T)
    drawn = drawn_dive(affine(y_px=15.0), pairs=3, given=true)
    raw = [Matches(*raw_points(true, one.left, one.right)) for one in drawn.matches]
    rows_px = [rows_off_px(one, rectified_matches(one, raw)) for one in (true, wrong)]
    assert rows_px[1] < rows_px[0] - 5
    settled = settle_matches(replace(wrong, alternatives=(true,)), raw)
    np.testing.assert_array_equal(settled.R, true.R)
    assert "leaves the fewest other faults" in settled.doubts[-1]


LEFT = {"camera_matrix": RIG.left.K.tolist(), "dist_coeffs": RIG.left.distortion.tolist()}
RIGHT = {"camera_matrix": RIG.right.K.tolist(), "dist_coeffs": RIG.right.distortion.tolist()}
POSE = {"R": RIG.R.tolist(), "T": RIG.T_right_left[:3, 3:].tolist()}
SHAPES = {
    "a mapping around all": {"stereo": {"rig": {f"{key}_{side}": value for side, camera in (("l",
    LEFT), ("r", RIGHT))
                                                for key, value in camera.items()} | POSE}},
    "extrinsics apart": {"left": LEFT, "right": RIGHT, "extrinsics": POSE},
    "the pose in the right camera": {"camera_left": LEFT, "camera_right": RIGHT | POSE},
    "words in capitals": {
        "Left_Camera_Matrix": LEFT["camera_matrix"],
        "Left_Distortion_Coefficients": LEFT["dist_coeffs"],
        "Right_Camera_Matrix": RIGHT["camera_matrix"],
        "Right_Distortion_Coefficients": RIGHT["dist_coeffs"],
        "Rotation_Matrix": POSE["R"], "Translation_Vector": POSE["T"],
    },
    "counted from 0": {"K0": LEFT["camera_matrix"], "D0": LEFT["dist_coeffs"],
    "K1": RIGHT["camera_matrix"],
                       "D1": RIGHT["dist_coeffs"], **POSE},
    "centimeters that are named": {"cam1": LEFT, "cam2": RIGHT, "R": POSE["R"],
    "T": (RIG.T_right_left[:3, 3] * 100).tolist(),
                                   "units": "cm"},
    "coefficients k1 and k2 of another lens": {"k1": 0.1, "k2": 0.2, "left": LEFT, "right": RIGHT,
    **POSE},
}  # fmt: skip


@pytest.mark.parametrize("shape", SHAPES)
def test_shapes_of_json(shape: str, tmp_path: Path) -> None:
    (tmp_path / "rig.json").write_text(json.dumps(SHAPES[shape]))
    found = load_rig(tmp_path / "rig.json", SIZE)
    assert_same(found)
    assert not found.doubts or shape != "centimeters that are named"


def test_what_matlab_converts_to_opencv(tmp_path: Path) -> None:
    from scipy.io import savemat

    content = {f"intrinsicMatrix{n}": camera.K for n, camera in ((1, RIG.left), (2, RIG.right))}
    content |= {
        f"distortionCoefficients{n}": camera.distortion[None]
        for n, camera in ((1, RIG.left), (2, RIG.right))
    }
    content |= {
        "rotationOfCamera2": RIG.R,
        "translationOfCamera2": RIG.T_right_left[:3, 3][None] * 1000,
    }
    savemat(tmp_path / "cv.mat", content | {"imageSize": [[480.0, 640.0]]})
    found = load_rig(tmp_path / "cv.mat")
    assert_same(found)
    assert found.left.image_size == SIZE


def ros_infos() -> list[dict[str, object]]:
    """camera_info of the rig, as stereoRectify gives R and P."""
    T = RIG.T_right_left[:3, 3:]
    R1, R2, P1, P2, *_ = cv2.stereoRectify(
        RIG.left.K, RIG.left.distortion, RIG.right.K, RIG.right.distortion, SIZE, RIG.R, T, alpha=0
    )
    return [
        {
            "image_width": 640,
            "image_height": 480,
            "camera_name": f"narrow_stereo/{side}",
            "camera_matrix": {"rows": 3, "cols": 3, "data": camera.K.ravel().tolist()},
            "distortion_model": "plumb_bob",
            "distortion_coefficients": {"rows": 1, "cols": 5, "data": camera.distortion.tolist()},
            "rectification_matrix": {"rows": 3, "cols": 3, "data": R.ravel().tolist()},
            "projection_matrix": {"rows": 3, "cols": 4, "data": P.ravel().tolist()},
        }
        for side, camera, R, P in (("left", RIG.left, R1, P1), ("right", RIG.right, R2, P2))
    ]


def test_ros_in_one_file(tmp_path: Path) -> None:
    left, right = ros_infos()
    (tmp_path / "both.yaml").write_text(yaml.safe_dump({"right": right, "left": left}))
    assert_same(load_rig(tmp_path / "both.yaml"))


def test_ros_with_namespaces(tmp_path: Path) -> None:
    for side, info in zip(("left", "right"), ros_infos(), strict=True):
        (tmp_path / f"{side}.yaml").write_text(
            yaml.safe_dump({f"/stereo/{side}": {"ros__parameters": info}})
        )
    assert_same(load_rig(f"{tmp_path}/left.yaml,{tmp_path}/right.yaml"))


def test_ros_message_without_a_header_first(tmp_path: Path) -> None:
    short = {
        "camera_matrix": "k",
        "distortion_coefficients": "d",
        "rectification_matrix": "r",
        "projection_matrix": "p",
    }
    for side, info in zip(("left", "right"), ros_infos(), strict=True):
        message = {short[key]: value["data"] for key, value in info.items() if key in short}  # type: ignore[index]
        message |= {
            "height": 480,
            "width": 640,
            "distortion_model": "plumb_bob",
            "roi": {"x_offset": 0},
        }
        (tmp_path / f"{side}.yaml").write_text(2 * (yaml.safe_dump(message) + "---\n"))
    assert_same(load_rig(f"{tmp_path}/left.yaml,{tmp_path}/right.yaml"))


def test_ost_of_the_calibrator_of_ros(tmp_path: Path) -> None:
    def rows(matrix: dict[str, object], count: int) -> str:
        return "\n".join(
            " ".join(map(repr, row)) for row in np.reshape(matrix["data"], (count, -1)).tolist()
        )

    names = {"camera matrix": 3, "distortion": 1, "rectification": 3, "projection": 3}
    keys = ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix")
    text = "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n640\n\nheight\n480\n\n"
    for info in ros_infos():
        text += f"[{info['camera_name']}]\n\n"
        text += "".join(
            f"{name}\n{rows(info[key], count)}\n\n"
            for (name, count), key in zip(names.items(), keys, strict=True)
        )  # type: ignore[arg-type]
    (tmp_path / "ost.txt").write_text(text)
    assert_same(load_rig(tmp_path / "ost.txt"))


def test_an_archive_is_named(tmp_path: Path) -> None:
    (tmp_path / "calibrationdata.tar.gz").write_bytes(b"\x1f\x8b\x08\x00" + bytes(20))
    with pytest.raises(CalibrationError, match="is an archive: unpack it"):
        load_rig(tmp_path / "calibrationdata.tar.gz")


@pytest.mark.parametrize("turned", [(True, True), (True, False), (False, True)])
def test_negative_focal_lengths_in_axes_turned_by_180_degrees_are_the_same_rig(
    turned: tuple[bool, bool],
) -> None:
    """As stereoRectify writes them for some rigs: the same pixels of the same rays."""
    rotations = [
        Rotation.from_rotvec(v).as_matrix() for v in ([0.01, -0.02, 0.03], [-0.01, 0.02, 0.01])
    ]
    projections = [
        np.array([[500.0, 0, 320, t], [0, 500, 240, 0], [0, 0, 1, 0]]) for t in (0.0, -60.0)
    ]
    given = transform_of_projections(rotations, projections)
    flip = np.diag([-1.0, -1.0, 1.0])
    for i in np.flatnonzero(turned):
        rotations[i], projections[i] = (
            flip @ rotations[i],
            np.column_stack([projections[i][:, :3] @ flip, projections[i][:, 3]]),
        )
    np.testing.assert_allclose(transform_of_projections(rotations, projections), given, atol=1e-12)
    if all(turned):
        T = rectified_rig("file", projections, (640, 480)).T_right_left
        np.testing.assert_allclose(
            T[:3], [[1, 0, 0, -0.12], [0, 1, 0, 0], [0, 0, 1, 0]], atol=1e-12
        )


def test_a_focal_length_that_is_negative_across_alone_is_no_camera() -> None:
    P = np.array([[-500.0, 0, 320, 60], [0, 500, 240, 0], [0, 0, 1, 0]])
    with pytest.raises(CalibrationError, match="of another sign across than down"):
        transform_of_projections([np.eye(3)] * 2, [P * [1, 1, 1, 0], P])
