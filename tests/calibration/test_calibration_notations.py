"""One rig in every notation, encoding and spelling that people bring: it is read, or refused in a
line that says what is wrong.
"""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from calibration_binaries import SIZE, small_rig
from scipy.spatial.transform import Rotation
from test_calibration_formats import seen
from test_calibration_spellings import ros_infos

from calibration import CalibrationError, StereoRig
from calibration.formats import load_rig
from calibration.rig import Camera

RIG = small_rig()
T = RIG.T_right_left
INVERSE = np.linalg.inv(T)
PARTS = {
    "K1": RIG.left.K, "D1": RIG.left.distortion, "K2": RIG.right.K, "D2": RIG.right.distortion,
    "R": RIG.R, "T": T[:3, 3],
}  # fmt: skip
PLAIN = {name: part.tolist() for name, part in PARTS.items()}
POSE = {"R": PLAIN["R"], "T": PLAIN["T"]}


def of(camera: Camera, K: str = "K", D: str = "D") -> dict[str, Any]:
    return {K: camera.K.tolist(), D: camera.distortion.tolist()}


BOTH = {"left": of(RIG.left), "right": of(RIG.right)}


def same(rig: StereoRig) -> bool:
    return np.allclose(seen(rig), seen(RIG), atol=1e-6) and np.allclose(rig.T_right_left, T)


def read(content: str | bytes | Mapping[str, Any], folder: Path) -> StereoRig:
    raw = content if isinstance(content, str | bytes) else json.dumps(content)
    (folder / "rig.txt").write_bytes(raw.encode() if isinstance(raw, str) else raw)
    return load_rig(folder / "rig.txt", SIZE)


def rows(part: np.ndarray, between: str = "; ") -> str:
    return between.join(" ".join(map(repr, row)) for row in np.atleast_2d(part).tolist())


def text(value: Any) -> Any:
    """Each number of a list as text with a decimal comma."""
    return [text(one) for one in value] if isinstance(value, list) else str(value).replace(".", ",")


YAML, JSON = yaml.safe_dump(PLAIN), json.dumps(PLAIN, indent=1)
NOTATIONS: dict[str, str | bytes] = {
    **{f"YAML in {name}": YAML.encode(name) for name in ("utf-16", "utf-16-be", "utf-32")},
    "JSON in UTF-16 without a mark": JSON.encode("utf-16-le"),
    "a comment of Windows": f"# Gehäuse für 10 °C\n{YAML}".encode("cp1252"),
    "zeros at the end": YAML.encode() + bytes(20),
    "JSON with comments": JSON.replace("{\n", "{ // of the pool\n/* May */\n", 1),
    "numbers in one text": json.dumps({key: str(value) for key, value in PLAIN.items()}),
    "decimal commas": json.dumps({key: text(value) for key, value in PLAIN.items()}),
    "YAML with texts": "".join(f"{key}: {rows(part, ' ')}\n" for key, part in PARTS.items()),
    "names and numbers": "".join(f"{key}\n{rows(part, chr(10))}\n" for key, part in PARTS.items()),
    "rows of a table": "".join(f"{k},{rows(p, ' ')}\n".replace(" ", ",") for k, p in PARTS.items()),
    "MATLAB": "".join(f"{key} = [{rows(part)}];  % px\n" for key, part in PARTS.items()),
    "what MATLAB's window displays": "".join(
        f"{key} =\n\n   1.0e+02 *\n\n{rows(part / 100, chr(10))}\n\n"
        for key, part in PARTS.items()),
    "standard errors": "".join(
        f"{key} = [ {rows(part)} ] ± [ 0.3 0.2 ]\n" for key, part in PARTS.items()),
    "Python": "import numpy as np\n"
    + "".join(f"{key} = np.array({part.tolist()})\n" for key, part in PARTS.items()),
    "TOML without a section": "".join(f"{key} = {value}\n" for key, value in PLAIN.items()),
    "INI": "[stereo]\n" + "".join(f"{key} = {rows(part, ' ')}\n" for key, part in PARTS.items()),
    "XML with rows": "<rig>" + "".join(
        f"<{key}>" + "".join(f"<row>{rows(row)}</row>" for row in np.atleast_2d(part)) + f"</{key}>"
        for key, part in PARTS.items()) + "</rig>",
    "YAML of several documents": "---\n".join(
        yaml.safe_dump(part) for part in (of(RIG.left), of(RIG.right), POSE)),
    "a number right behind its colon": f"Viewer.PointSize:2\n{YAML}T2.rate:-5\n",
    "a tuple of Python": f"size: !!python/tuple [640, 480]\n{YAML}",
}  # fmt: skip


@pytest.mark.parametrize("notation", NOTATIONS)
def test_notations(notation: str, tmp_path: Path) -> None:
    assert same(read(NOTATIONS[notation], tmp_path))


def test_attributes_of_xml(tmp_path: Path) -> None:
    def camera(name: str, one: Camera) -> str:
        numbers = zip(("fx", "fy", "cx", "cy"), one.K[[0, 1, 0, 1], [0, 1, 2, 2]], strict=True)
        lens = zip(("k1", "k2", "p1", "p2", "k3"), one.distortion, strict=True)
        said = " ".join(f'{key}="{value}"' for key, value in (*numbers, *lens))
        return f'<camera id="{name}" width="640" height="480" {said}/>'

    pose = f"<R>{rows(RIG.R, ' ')}</R><T>{rows(T[:3, 3])}</T>"
    cameras = camera("right", RIG.right) + camera("left", RIG.left)
    (tmp_path / "rig.xml").write_text(f"<rig>{cameras}{pose}</rig>")
    assert same(load_rig(tmp_path / "rig.xml"))


def quaternion(order: list[int]) -> list[float]:
    return list(np.asarray(Rotation.from_matrix(RIG.R).as_quat())[order])


def each(key: str, left: np.ndarray, right: np.ndarray) -> dict[str, Any]:
    return {
        side: {**BOTH[side], key: pose.tolist()}
        for side, pose in (("left", left), ("right", right))
    }


def padded(K: np.ndarray, rows_: int) -> list[list[float]]:
    square = np.eye(4)
    square[:3, :3] = K
    return list(square[:rows_].tolist())


def rectified(*names: str) -> dict[str, Any]:
    """The rotations and projections of the rectified images, under R1 R2 P1 P2 of other names."""
    infos = ros_infos()
    keys = ("rectification_matrix", "rectification_matrix", *["projection_matrix"] * 2)
    return {
        name: np.reshape(infos[i % 2][key]["data"], (3, -1)).tolist()  # type: ignore[index]
        for i, (name, key) in enumerate(zip(names, keys, strict=True))
    }


WORLD = np.eye(4)
WORLD[:3, :3] = Rotation.from_rotvec([0.1, 0.5, -0.3]).as_matrix()
WORLD[:3, 3] = 1, 2, 3
CENTERS = {
    "left": {**BOTH["left"], "position": [0, 0, 0], "rotation": np.eye(3).tolist()},
    "right": {**BOTH["right"], "position": INVERSE[:3, 3].tolist(), "rotation": RIG.R.T.tolist()},
}


def fours(camera: Camera) -> list[float]:
    return list(camera.K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist())


def chain(camera: Camera, **pose: Any) -> dict[str, Any]:
    """Of Kalibr, with the names of lenses that ROS has."""
    return {
        "intrinsics": fours(camera), "distortion_coeffs": camera.distortion.tolist(),
        "distortion_model": "plumb_bob", "resolution": list(SIZE),
    } | pose  # fmt: skip


def svo(number: int, camera: Camera, pose: np.ndarray) -> dict[str, Any]:
    """Of aslam, maplab and SVO; its T_B_C leads from the camera."""
    lens = {
        "distortion": {
            "parameters": {"data": camera.distortion.tolist()}, "type": "radial-tangential",
        },
        "intrinsics": {"data": fours(camera)}, "label": f"cam{number}", "type": "pinhole",
        "image_width": SIZE[0], "image_height": SIZE[1],
    }  # fmt: skip
    return {"camera": lens, "T_B_C": {"data": np.linalg.inv(pose).ravel().tolist()}, "serial_no": 0}


def both_ways(pose: np.ndarray) -> dict[str, Any]:
    ways = {"cam_to_world": np.linalg.inv(pose), "world_to_cam": pose}
    return {"detected_id": 0} | {
        f"{name}_{way}": part.tolist()
        for way, one in ways.items()
        for name, part in (("R", one[:3, :3]), ("t", one[:3, 3]))
    }


SPELLINGS: dict[str, Mapping[str, Any]] = {
    "Kl Dl": {"Kl": PLAIN["K1"], "Dl": PLAIN["D1"], "Kr": PLAIN["K2"], "Dr": PLAIN["D2"], **POSE},
    "ml dl": {"ml": PLAIN["K1"], "dl": PLAIN["D1"], "mr": PLAIN["K2"], "dr": PLAIN["D2"], **POSE},
    "Rl Pl": {"Kl": PLAIN["K1"], "Dl": PLAIN["D1"], "Kr": PLAIN["K2"], "Dr": PLAIN["D2"],
              **rectified("Rl", "Rr", "Pl", "Pr")},
    "K0 D0 beside P0": {"K0": PLAIN["K1"], "D0": PLAIN["D1"], "K1": PLAIN["K2"],
                        "D1": PLAIN["D2"], **POSE, **rectified("R0", "R1", "P0", "P1")},
    "K_top beside K_bottom": {"K_top": PLAIN["K1"], "dist_top": PLAIN["D1"], **POSE,
                              "K_bottom": PLAIN["K2"], "dist_bottom": PLAIN["D2"]},
    "K D R P of each camera, and no size": {
        f"{side}_camera": {**BOTH[side], **rectified(*names)}
        for side, names in (("left", ("R", "-", "P", "-")), ("right", ("-", "R", "-", "P")))
    },
    "R_world_to_cam and R_cam_to_world": {
        side: BOTH[side] | both_ways(pose) for side, pose in (("left", WORLD), ("right", T @ WORLD))
    },
    "a list of aslam": {"cameras": [svo(0, RIG.left, WORLD), svo(1, RIG.right, T @ WORLD)]},
    "a chain with lenses of ROS": {
        "cam0": chain(RIG.left), "cam1": chain(RIG.right, T_cn_cnm1=T.tolist())
    },
    "lenses beside a model_type": {
        "model_type": "PINHOLE", "intrinsics_l": fours(RIG.left), "intrinsics_r": fours(RIG.right),
        "distortion_l": PLAIN["D1"], "distortion_r": PLAIN["D2"], **POSE,
    },
    "principle_point_x_pixels": {
        side: dict(zip(("focal_length_x_px", "focal_length_y_px", "principle_point_x_pixels",
                        "principle_point_y_pixels"), fours(camera), strict=True))
        | {"dist": camera.distortion.tolist()}
        for side, camera in (("left", RIG.left), ("right", RIG.right))} | POSE,
    "MATLAB's name of R": {"K1": PLAIN["K1"], "D1": PLAIN["D1"], "K2": PLAIN["K2"],
                           "D2": PLAIN["D2"], "RotationOfCamera2": PLAIN["R"], "T": PLAIN["T"]},
    "coef_left": {"matrix_left": PLAIN["K1"], "coef_left": PLAIN["D1"], **POSE,
                  "matrix_right": PLAIN["K2"], "coef_right": PLAIN["D2"]},
    "sides below parts": {"camera_matrix": {"left": PLAIN["K1"], "right": PLAIN["K2"]},
                          "dist_coeffs": {"left": PLAIN["D1"], "right": PLAIN["D2"]}, **POSE},
    "master and slave": {"slave": of(RIG.right), "master": of(RIG.left), **POSE},
    "a list that says its sides": {"cameras": [{"side": "R", **of(RIG.right)},
                                               {"side": "L", **of(RIG.left)}], **POSE},
    "French": {"droite": of(RIG.right), "gauche": of(RIG.left), **POSE},
    "radial1": {"K1": PLAIN["K1"], "K2": PLAIN["K2"], **POSE,
                **{f"{kind}{i + 1}": camera.distortion[which].tolist()
                   for i, camera in enumerate((RIG.left, RIG.right))
                   for kind, which in (("radial", [0, 1, 4]), ("tangential", [2, 3]))}},
    "f and pp": {side: {"f": [camera.K[0, 0], camera.K[1, 1]], "pp": camera.K[:2, 2].tolist(),
                        "dist": camera.distortion.tolist()}
                 for side, camera in (("left", RIG.left), ("right", RIG.right))} | POSE,
    "K of 3x4": PLAIN | {"K1": padded(RIG.left.K, 3), "K2": padded(RIG.right.K, 3)},
    "K of 4x4": PLAIN | {"K1": padded(RIG.left.K, 4), "K2": padded(RIG.right.K, 4)},
    "Rt of 3x4": BOTH | {"Rt": T[:3].tolist()},
    "4x4 column by column": BOTH | {"T_right_left": T.T.ravel().tolist()},
    "4x3 of row vectors": BOTH | {"T_right_left": T[:3].T.tolist()},
    "a quaternion, w last": BOTH | {"quaternion": quaternion([0, 1, 2, 3]), "T": PLAIN["T"]},
    "a quaternion, w first": BOTH | {"rotation": quaternion([3, 0, 1, 2]), "T": PLAIN["T"]},
    "R_lr": BOTH | {"R_lr": INVERSE[:3, :3].tolist(), "t_lr": INVERSE[:3, 3].tolist()},
    "T_cam_world": each("T_cam_world", WORLD, T @ WORLD),
    "T_world_cam": each("T_world_cam", np.linalg.inv(WORLD), np.linalg.inv(T @ WORLD)),
    "cam2world": each("cam2world", np.linalg.inv(WORLD), np.linalg.inv(T @ WORLD)),
    "T_imu_cam": each("T_imu_cam", np.linalg.inv(WORLD), np.linalg.inv(T @ WORLD)),
    "places, and rotations from the cameras": CENTERS,
}  # fmt: skip


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_spellings_of_parts(spelling: str, tmp_path: Path) -> None:
    found = read(SPELLINGS[spelling], tmp_path)
    assert same(found)
    if "MATLAB" in spelling:
        np.testing.assert_allclose(found.alternatives[0].R, RIG.R.T, atol=1e-9)


def test_what_the_window_of_bouguets_toolbox_prints(tmp_path: Path) -> None:
    numbers = {"om": cv2.Rodrigues(RIG.R)[0].ravel(), "T": 1000 * T[:3, 3]}
    for side, camera in (("left", RIG.left), ("right", RIG.right)):
        fx, fy, *center = fours(camera)
        numbers |= {f"fc_{side}": [fx, fy], f"cc_{side}": center, f"kc_{side}": camera.distortion}

    def printed(scale: float) -> str:
        return (
            "Stereo calibration parameters:\n\nIntrinsic parameters of left camera:\n\n"
            + "".join(
                f"Focal Length:   {name} = [ {rows(scale * np.array(part))} ] ± [ 0.1  0.2 ]\n"
                for name, part in numbers.items()
            )
        )

    for encoding in ("utf-8", "latin-1"):
        found = read((printed(1.01) + printed(1.0)).encode(encoding), tmp_path)
        assert same(found)
        assert not found.doubts


def test_counts_and_groups_of_cameras_are_no_names(tmp_path: Path) -> None:
    cameras = {
        f"camera_{i}": {**BOTH[side], "camera_group": 0, "camera_pose_matrix": pose.tolist()}
        for i, (side, pose) in enumerate((("left", np.eye(4)), ("right", INVERSE)))
    }
    found = read({"nb_camera": 2} | cameras, tmp_path)
    assert same(found)
    assert not [doubt for doubt in found.doubts if "no unit" not in doubt]


def test_of_two_lenses_for_one_camera_that_of_the_whole_rig_is_taken_and_said(
    tmp_path: Path,
) -> None:
    def method(name: str, **parts: Any) -> str:
        lines = [f"        self.{key} = np.array({value})\n" for key, value in parts.items()]
        return f"    def {name}(self):\n{''.join(lines)}"

    other = {key: (1.5 * PARTS[key]).tolist() for key in ("K1", "K2")} | {"T": [-0.2, 0, 0]}
    methods = method("__init__", **PLAIN) + method("set_other", **other)
    found = read(f"import numpy as np\n\n\nclass Rig:\n{methods}", tmp_path)
    assert same(found)
    assert sum("contains two camera matrices" in doubt for doubt in found.doubts) == 2
    rotations = method("__init__", om=[0.1, 0, 0], **PLAIN)
    assert same(read(f"import numpy as np\n\n\nclass Rig:\n{rotations}", tmp_path))


def test_a_unit_that_is_taken_for_centimeters_may_be_squares(tmp_path: Path) -> None:
    found = read(BOTH | {"R": PLAIN["R"], "T": (100 * T[:3, 3]).tolist()}, tmp_path)
    assert same(found)
    assert any("centimeters, and not as squares of a board" in doubt for doubt in found.doubts)


TWICE: dict[str, tuple[dict[str, Any], str]] = {
    "two distortions": ({"left_distortion": [0.2, 0, 0, 0, 0]}, "two distortions of the left"),
    "two rotations": ({"stereo": {"om": [0.1, 0, 0]}}, "two rotations, R and stereo.om: R is used"),
    "a coefficient less": ({"D2": PLAIN["D2"][:4]}, "5 coefficients .* and 4 for the right one"),
}


@pytest.mark.parametrize("case", TWICE)
def test_parts_that_disagree_are_named(case: str, tmp_path: Path) -> None:
    more, message = TWICE[case]
    assert [doubt for doubt in read(PLAIN | more, tmp_path).doubts if re.search(message, doubt)]


def test_settings_of_orb_slam_beside_the_lenses_before_rectification(tmp_path: Path) -> None:
    infos = rectified("R1", "R2", "P1", "P2")
    (fx, _, cx, _), (_, fy, cy, _), _ = infos["P2"]
    rectified_lens = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "bf": -infos["P2"][0][3]}
    settings = {f"Camera.{key}": value for key, value in rectified_lens.items()}
    assert same(read(settings | {"Camera.width": 640, "Camera.height": 480} | PLAIN, tmp_path))


@pytest.mark.parametrize("order", [("left", "right"), ("right", "left")])
def test_cameras_whose_names_tell_no_side_are_taken_in_order_and_said(
    order: tuple[str, str], tmp_path: Path
) -> None:
    cameras = {f"unit_{side[0]}x": BOTH[side] for side in order}
    found = read(cameras | POSE, tmp_path)
    assert any(
        f"the first, unit_{order[0][0]}x, is used as the left one" in doubt
        for doubt in found.doubts
    )


def test_places_with_rotations_either_way_are_left_to_the_images(tmp_path: Path) -> None:
    turned = CENTERS | {"right": CENTERS["right"] | {"rotation": RIG.R.tolist()}}
    assert any(map(same, read(turned, tmp_path).alternatives))


@pytest.mark.parametrize("names", [("K", "D", "R", "P"), ("k", "d", "r", "p")])
@pytest.mark.parametrize("form", ["list", "documents", "files"])
def test_ros_messages_of_two_cameras(form: str, names: tuple[str, ...], tmp_path: Path) -> None:
    keys = ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix")
    infos = [
        {"header": {"stamp": i}, "width": 640, "height": 480, "distortion_model": "plumb_bob"}
        | {name: info[key]["data"] for name, key in zip(names, keys, strict=True)}  # type: ignore[index]
        for i, info in enumerate(ros_infos())
    ]
    if form == "list":
        assert same(read(json.dumps(infos[::-1]), tmp_path))
    elif form == "documents":
        later = [info | {"header": {"stamp": 7}} for info in infos]
        assert same(read("---\n".join(map(yaml.safe_dump, (*infos, *later))), tmp_path))
    else:
        for i, info in enumerate(infos):
            (tmp_path / f"cam{i}.yaml").write_text(yaml.safe_dump(info))
        assert same(load_rig(tmp_path))


def test_tables_of_a_folder_with_decimal_commas_and_headers(tmp_path: Path) -> None:
    for name, part in PARTS.items():
        table = rows(part, "\n").replace(" ", ";").replace(".", ",")
        names = ";".join(f"c{i}" for i in range(table.split("\n")[0].count(";") + 1))
        (tmp_path / f"{name}.csv").write_text(f"{names}\n{table}\n" if ";" in names else table)
    assert same(load_rig(tmp_path, SIZE))


@pytest.mark.parametrize("mark", [";", "\t", ","])
@pytest.mark.parametrize("decimal", [".", ","])
def test_a_table_with_a_column_a_camera(mark: str, decimal: str, tmp_path: Path) -> None:
    left, right = ((*c.K[[0, 1, 0, 1], [0, 1, 2, 2]], *c.distortion) for c in (RIG.left, RIG.right))
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    turn = cv2.Rodrigues(RIG.R)[0].ravel()
    pose = zip(("rx", "ry", "rz"), turn, strict=True)
    place = zip(("tx_mm", "ty_mm", "tz_mm"), T[:3, 3] * 1000, strict=True)
    if mark == decimal:
        return
    lines = [
        ("parameter", "left", "right"),
        *zip(names, left, right, strict=True),
        *((name, "", value) for name, value in (*pose, *place)),
    ]
    text = "\n".join(mark.join(map(str, line)).replace(".", decimal) for line in lines)
    assert same(read(text, tmp_path))


NORMALIZED = {
    name: (np.diag([1 / 640, 1 / 480, 1]) @ PARTS[name]).tolist() for name in ("K1", "K2")
}
ANGLES = np.degrees(Rotation.from_matrix(RIG.R).as_euler("xyz")).tolist()
REFUSED: dict[str, tuple[str | Mapping[str, Any], str]] = {
    "angles": (BOTH | {"rotation_deg": ANGLES, "T": PLAIN["T"]},
               "rotation_deg: rotation angles are ambiguous, because their order differs"),
    "roll, pitch, yaw": (BOTH | dict(zip(("roll", "pitch", "yaw"), ANGLES, strict=True)) | {
                         "T": PLAIN["T"]}, "rotation angles are ambiguous"),
    "a rotation vector in degrees": (PLAIN | {"R": [10.0, 3.0, 0.1]}, "longer than a full turn"),
    "parts of the width": (PLAIN | NORMALIZED, "cannot be in pixels"),
    "six coefficients": (PLAIN | {"D1": [0.1] * 6, "D2": [0.1] * 6}, "coefficients, got 6"),
    "nothing where a number is due": (PLAIN | {"T": [None, 0, 0]}, "T: nan is not a finite"),
    "arrays of NumPy in YAML": (yaml.dump({"K1": RIG.left.K}), r"write the arrays with .tolist"),
    "names of files": ({"K1": [True, "left/K.csv"], "K2": [True, "right/K.csv"]},
                       "only file names, such as left/K.csv: give the folder"),
    "two rigs": (
        {"down": BOTH | POSE, "forward": BOTH | {"R": PLAIN["R"], "T": [-0.3, 0, 0]}},
        "holds 2 rigs, down and forward",
    ),
    "two rigs in a list": ({"rigs": [BOTH | POSE, BOTH | POSE]}, r"holds 2 rigs, rigs.0 and"),
    "the mirror of a lens": (PLAIN | {"xi1": [[1.1]], "xi2": [[1.2]]}, "'omni' is"),
    "K [R t] for the projection of a rectified image": (
        {"P1": padded(RIG.left.K, 3), "P2": (RIG.right.K @ T[:3]).tolist()},
        "contains a rotation, as K .R t. does",
    ),
    "a baseline and a focal length alone": (
        {"baseline_mm": 100.0, "focal_length_px": 2800.0}, "no camera matrix: add the fx, fy, cx"),
    "eight numbers": (
        {"cam_matrix_left": [*range(8)], "cam_matrix_right": PLAIN["K2"], "D1": PLAIN["D1"],
         "D2": PLAIN["D2"], **POSE}, "cam_matrix_left holds 8 numbers, and a camera matrix has 9"),
    "transposed lenses": (
        {"cam_matrix_left": RIG.left.K.T.tolist(), "cam_matrix_right": RIG.right.K.T.tolist(),
         "D1": PLAIN["D1"], "D2": PLAIN["D2"], **POSE}, "cam_matrix_left: .* K is transposed"),
    "inches": (PLAIN | {"T": [-4.72, 0, 0]}, "in inches 0.119"),
    "a name twice": ("K1 1 2 3 4\nK1 5 6 7 8\n", "'K1' is given twice"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_read_is_named(case: str, tmp_path: Path) -> None:
    content, message = REFUSED[case]
    with pytest.raises(CalibrationError, match=message):
        read(content, tmp_path)


def test_a_rotation_vector_may_be_long(tmp_path: Path) -> None:
    turned = np.array([0.0, 0.0, np.pi - 0.01])
    found = read(PLAIN | {"R": turned.tolist()}, tmp_path)
    np.testing.assert_allclose(found.R, cv2.Rodrigues(turned)[0], atol=1e-9)
