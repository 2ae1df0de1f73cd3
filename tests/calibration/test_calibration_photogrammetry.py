"""Rigs of Metashape, COLMAP, OKVIS, VINS-Fusion and Cityscapes, and lenses that OpenCV has not,
against their own formulas.
"""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from calibration import CalibrationError, Camera, StereoRig
from calibration.formats import format_name, load_rig
from calibration.transforms import inverse, rigid_transform

SIZE = (1360, 1024)
T_RIGHT_LEFT = rigid_transform(
    Rotation.from_rotvec([0.01, -0.03, 0.02]).as_matrix(), np.array([-0.12, 0.004, 0.002])
)
POINTS = np.array([[x, y, z] for x in (-0.5, 0.0, 0.4) for y in (-0.3, 0.25) for z in (0.9, 2.5)])


def assert_sees(
    rig: StereoRig, left: Callable[[np.ndarray], np.ndarray], tolerance_px: float = 1e-6
) -> None:
    """The left camera projects as ``left`` says, the right one as ``left`` does from its own
    place.
    """
    in_right = POINTS @ T_RIGHT_LEFT[:3, :3].T + T_RIGHT_LEFT[:3, 3]
    np.testing.assert_allclose(rig.left.project(POINTS), left(POINTS), atol=tolerance_px)
    moved = POINTS @ rig.R.T + rig.T_right_left[:3, 3]
    np.testing.assert_allclose(rig.right.project(moved), left(in_right), atol=tolerance_px)
    np.testing.assert_allclose(rig.T_right_left, T_RIGHT_LEFT, atol=1e-9)


def metashape_pixels(points: np.ndarray, k4: float = 0.0) -> np.ndarray:
    """The appendix of its manual, minus half a pixel, since its pixels begin at the corner."""
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    r2 = x**2 + y**2
    radial = 1 - 0.1 * r2 + 0.02 * r2**2 + 0.001 * r2**3 + k4 * r2**4
    xd = x * radial + 0.0004 * (r2 + 2 * x**2) + 2 * -0.0003 * x * y
    yd = y * radial + -0.0003 * (r2 + 2 * y**2) + 2 * 0.0004 * x * y
    return (
        np.column_stack([1360 / 2 + 3 + xd * 1000 + 2 * xd + 0.5 * yd, 1024 / 2 - 4 + yd * 1000])
        - 0.5
    )


def metashape(
    k4: float = 0.0, kind: str = "frame", scale: float | None = None, place: bool = True
) -> str:
    T_master_slave = inverse(T_RIGHT_LEFT)
    rotation, location = (
        " ".join(map(repr, part.ravel().tolist()))
        for part in (T_master_slave[:3, :3], T_master_slave[:3, 3] / (scale or 1))
    )
    lens = f"""<resolution width="1360" height="1024"/><property name="layer_index" value="0"/>
      <calibration type="{kind}" class="initial"><resolution width="1360" height="1024"/><f>900</f></calibration>
      <calibration type="{kind}" class="adjusted"><resolution width="1360" height="1024"/><f>1000</f><cx>3</cx><cy>-4</cy><b1>2</b1>
      <b2>0.5</b2><k1>-0.1</k1><k2>0.02</k2><k3>0.001</k3><k4>{k4}</k4><p1>0.0004</p1><p2>-0.0003</p2></calibration>"""  # noqa: E501
    second = f"<rotation>{rotation}</rotation><location>{location}</location>" if place else ""
    transform = (
        f"<transform><rotation>1 0 0 0 1 0 0 0 1</rotation><scale>{scale}</scale></transform>"
        if scale
        else ""
    )
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<document version="2.0.0"><chunk label="Chunk 1" enabled="true"><sensors next_id="2">
<sensor id="0" label="left" type="{kind}">{lens}</sensor>
<sensor id="1" label="right" type="{kind}" master_id="0">{lens}{second}</sensor></sensors>{transform}</chunk></document>"""  # noqa: E501


@pytest.mark.parametrize("scale", [None, 0.25])
def test_metashape(scale: float | None, tmp_path: Path) -> None:
    (tmp_path / "cameras.xml").write_text(metashape(scale=scale))
    rig = load_rig(tmp_path / "cameras.xml")
    assert format_name(tmp_path / "cameras.xml") == "metashape"
    assert rig.left.image_size == SIZE
    assert_sees(rig, metashape_pixels)
    assert (
        "baseline is 120.1 mm with the chunk's scale of 0.25" in rig.doubts[0]
        if scale
        else "names no unit" in rig.doubts[0]
    )


def test_a_fourth_radial_coefficient_of_metashape(tmp_path: Path) -> None:
    (tmp_path / "cameras.xml").write_text(metashape(0.0005))
    assert_sees(
        load_rig(tmp_path / "cameras.xml"), lambda points: metashape_pixels(points, 0.0005), 0.1
    )


def test_a_fisheye_of_metashape(tmp_path: Path) -> None:
    """Its angles are OpenCV's; with a tangential part it has no equal."""
    (tmp_path / "cameras.xml").write_text(metashape(kind="fisheye"))
    with pytest.raises(
        CalibrationError,
        match=r"cameras.xml: sensor 0: no supported lens model agrees with this fisheye of "
        r"Metashape",
    ):
        load_rig(tmp_path / "cameras.xml")
    (tmp_path / "cameras.xml").write_text(
        metashape(kind="fisheye").replace("0.0004<", "0<").replace("-0.0003<", "0<")
    )
    angle = 0.4
    theta_d = angle * (1 - 0.1 * angle**2 + 0.02 * angle**4 + 0.001 * angle**6)
    rig = load_rig(tmp_path / "cameras.xml")
    seen = rig.left.project(np.array([[np.tan(angle), 0.0, 1.0]]))
    np.testing.assert_allclose(
        seen, [[1360 / 2 + 3 - 0.5 + 1002 * theta_d, 1024 / 2 - 4 - 0.5]], atol=1e-6
    )


def test_metashape_without_a_multi_camera_system(tmp_path: Path) -> None:
    (tmp_path / "cameras.xml").write_text(metashape(place=False))
    with pytest.raises(CalibrationError, match="import the images as a multi-camera system"):
        load_rig(tmp_path / "cameras.xml")


COLMAP_CAMERAS = (
    "# Camera list with one line of data per camera:\n{}1 OPENCV 1360 1024 1000 1010 "
    "680.5 500.5 -0.1 0.02 0.001 0.002\n"
)
COLMAP_CAMERAS = (
    COLMAP_CAMERAS.format("") + "2 OPENCV 1360 1024 1000 1010 680.5 500.5 -0.1 0.02 0.001 0.002\n"
)
LENS = Camera(
    np.array([[1000.0, 0, 680], [0, 1010, 500], [0, 0, 1]]),
    np.array([-0.1, 0.02, 0.001, 0.002]),
    SIZE,
)


def quaternion() -> list[float]:
    x, y, z, w = Rotation.from_matrix(T_RIGHT_LEFT[:3, :3]).as_quat().tolist()
    return [w, x, y, z]


def rig_config(lens: bool) -> str:
    own = (
        {
            "camera_model_name": "OPENCV",
            "camera_params": [1000, 1010, 680.5, 500.5, -0.1, 0.02, 0.001, 0.002],
        }
        if lens
        else {}
    )
    place = {
        "cam_from_rig_rotation": quaternion(),
        "cam_from_rig_translation": T_RIGHT_LEFT[:3, 3].tolist(),
    }
    left, right = (
        {"image_prefix": "rig1/left/", "ref_sensor": True, **own},
        {"image_prefix": "rig1/right/", **own, **place},
    )
    return json.dumps([{"cameras": [left, right]}], indent=2)


@pytest.mark.parametrize("lens", [True, False])
def test_colmap_rig_config(lens: bool, tmp_path: Path) -> None:
    (tmp_path / "rig_config.json").write_text(rig_config(lens))
    if lens:
        assert_sees(load_rig(tmp_path / "rig_config.json", SIZE), LENS.project)
    else:
        with pytest.raises(CalibrationError, match=r"also give cameras.txt"):
            load_rig(tmp_path / "rig_config.json", SIZE)
    (tmp_path / "cameras.txt").write_text(COLMAP_CAMERAS)
    for given in (tmp_path, f"{tmp_path}/rig_config.json,{tmp_path}/cameras.txt"):
        assert_sees(load_rig(given), LENS.project)


def test_colmap_model(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text(COLMAP_CAMERAS)
    (tmp_path / "images.txt").write_text("# Image list\n1 1 0 0 0 0 0 0 1 left/a.png\n\n")
    pose = " ".join(map(repr, [*quaternion(), *T_RIGHT_LEFT[:3, 3].tolist()]))
    (tmp_path / "rigs.txt").write_text(f"# Rig calib list\n1 2 CAMERA 1 CAMERA 2 1 {pose}\n")
    assert_sees(load_rig(tmp_path), LENS.project)
    (tmp_path / "rigs.txt").write_text("1 1 CAMERA 1\n2 1 CAMERA 2\n")
    with pytest.raises(CalibrationError, match="expected one rig of two cameras"):
        load_rig(tmp_path)
    with pytest.raises(CalibrationError, match="contains cameras but no rig"):
        load_rig(tmp_path / "cameras.txt")


@pytest.mark.parametrize(
    "line",
    ["1 OPENCV 1360 1024 1000 1010", "1 OPENCV 1360 1024 1 2 3 4 5 6 7 x", "1 SPHERE 10 10 1 2 3"],
)
def test_damaged_cameras_of_colmap(line: str, tmp_path: Path) -> None:
    (tmp_path / "rig_config.json").write_text(rig_config(False))
    (tmp_path / "cameras.txt").write_text(line + "\n" + COLMAP_CAMERAS.splitlines()[-1])
    with pytest.raises(
        CalibrationError, match=r"takes 8 parameters|is damaged|SPHERE is not supported"
    ):
        load_rig(tmp_path)


BODY_LEFT = rigid_transform(
    Rotation.from_rotvec([0.5, -1.2, 0.3]).as_matrix(), np.array([0.05, -0.1, 0.2])
)
BODY = (BODY_LEFT, BODY_LEFT @ inverse(T_RIGHT_LEFT))


def test_okvis(tmp_path: Path) -> None:
    cameras = [
        {
            "T_SC": T.ravel().tolist(),
            "image_dimension": list(SIZE),
            "distortion_coefficients": [-0.1, 0.02, 0.001, 0.002],
            "distortion_type": "radialtangential",
            "focal_length": [1000, 1010],
            "principal_point": [680, 500],
        }
        for T in BODY
    ]
    (tmp_path / "config.yaml").write_text(
        "%YAML:1.0\n" + yaml.safe_dump({"cameras": cameras, "camera_params": {"sigma_t": 0.0}})
    )
    assert_sees(load_rig(tmp_path / "config.yaml"), LENS.project)


def omni_pixels(points: np.ndarray) -> np.ndarray:
    """Mei's unified model, k1 k2 p1 p2 behind it."""
    m = points[:, :2] / (points[:, 2:] + 0.9 * np.linalg.norm(points, axis=1, keepdims=True))
    (x, y), r2 = m.T, (m**2).sum(axis=1)
    radial = 1 - 0.05 * r2 + 0.01 * r2**2
    xd, yd = x * radial + 2 * 2e-5 * x * y, y * radial + 2e-5 * (r2 + 2 * y**2)
    return np.column_stack([1900 * xd + 680, 1910 * yd + 500])


@pytest.mark.parametrize("mei", [True, False])
def test_vins_fusion(mei: bool, tmp_path: Path) -> None:
    shape = (
        {"k1": -0.05, "k2": 0.01, "p1": 2e-5, "p2": 0.0}
        if mei
        else {"k1": -0.1, "k2": 0.02, "p1": 0.001, "p2": 0.002}
    )
    lens = (
        {"gamma1": 1900, "gamma2": 1910, "u0": 680, "v0": 500}
        if mei
        else {"fx": 1000, "fy": 1010, "cx": 680, "cy": 500}
    )
    content = {"model_type": "MEI" if mei else "PINHOLE", "image_width": 1360, "image_height": 1024}
    content |= {
        "mirror_parameters": {"xi": 0.9},
        "distortion_parameters": shape,
        "projection_parameters": lens,
    }
    for side in ("left", "right"):
        (tmp_path / f"{side}.yaml").write_text("%YAML:1.0\n---\n" + yaml.safe_dump(content))
    poses = "".join(
        f"body_T_cam{i}: !!opencv-matrix\n   rows: 4\n   cols: 4\n   dt: d\n   data: "
        f"{T.ravel().tolist()}\n"
        for i, T in enumerate(BODY)
    )
    (tmp_path / "vins.yaml").write_text(
        '%YAML:1.0\n\ncam0_calib: "left.yaml"\ncam1_calib: "right.yaml"\n' + poses
    )
    for given in (tmp_path, tmp_path / "vins.yaml"):
        assert_sees(load_rig(given), omni_pixels if mei else LENS.project, 0.1 if mei else 1e-6)
    with pytest.raises(CalibrationError, match="one camera of a CamOdoCal pair"):
        load_rig(tmp_path / "left.yaml")
    with pytest.raises(CalibrationError, match="give the VINS configuration"):
        load_rig(f"{tmp_path}/left.yaml,{tmp_path}/right.yaml")


def ds_pixels(points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    d1 = np.sqrt(x**2 + y**2 + z**2)
    d2 = np.sqrt(x**2 + y**2 + (-0.2 * d1 + z) ** 2)
    return points[:, :2] / (0.55 * d2 + 0.45 * (-0.2 * d1 + z))[:, None] * [700, 702] + [680, 500]


def eucm_pixels(points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    return points[:, :2] / (0.6 * np.sqrt(1.1 * (x**2 + y**2) + z**2) + 0.4 * z)[:, None] * [
        1000,
        1002,
    ] + [680, 500]


def fov_pixels(points: np.ndarray) -> np.ndarray:
    m = points[:, :2] / points[:, 2:]
    r = np.hypot(*m.T)
    return m * (np.arctan(2 * r * np.tan(0.45)) / (0.9 * r))[:, None] * [1000, 1002] + [680, 500]


LENSES: dict[str, tuple[list[float], dict[str, object], Callable[[np.ndarray], np.ndarray]]] = {
    "omni": (
        [0.9, 1900, 1910, 680, 500],
        {"distortion_model": "radtan", "distortion_coeffs": [-0.05, 0.01, 2e-5, 0]},
        omni_pixels,
    ),
    "ds": (
        [-0.2, 0.55, 700, 702, 680, 500],
        {"distortion_model": "none", "distortion_coeffs": []},
        ds_pixels,
    ),
    "eucm": ([0.6, 1.1, 1000, 1002, 680, 500], {"distortion_model": "none"}, eucm_pixels),
    "pinhole": (
        [1000, 1002, 680, 500],
        {"distortion_model": "fov", "distortion_coeffs": [0.9]},
        fov_pixels,
    ),
}


@pytest.mark.parametrize("model", LENSES)
def test_kalibrs_other_lenses(model: str, tmp_path: Path) -> None:
    intrinsics, distortion, pixels = LENSES[model]
    camera = {
        "camera_model": model,
        "intrinsics": intrinsics,
        "resolution": list(SIZE),
        **distortion,
    }
    content = {"cam0": camera, "cam1": {**camera, "T_cn_cnm1": T_RIGHT_LEFT.tolist()}}
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump(content))
    assert_sees(load_rig(tmp_path / "camchain.yaml"), pixels, 0.1)


def test_a_lens_that_nothing_comes_near_is_refused(tmp_path: Path) -> None:
    camera = {
        "camera_model": "omni",
        "intrinsics": [1.5, 900, 900, 680, 500],
        "resolution": list(SIZE),
    }
    camera |= {"distortion_model": "radtan", "distortion_coeffs": [-0.2, 0.05, 0.01, 0.01]}
    (tmp_path / "camchain.yaml").write_text(
        yaml.safe_dump({"cam0": camera, "cam1": {**camera, "T_cn_cnm1": T_RIGHT_LEFT.tolist()}})
    )
    with pytest.raises(
        CalibrationError,
        match=r"no supported lens model agrees with this omni-radtan better than \d",
    ):
        load_rig(tmp_path / "camchain.yaml")


def test_cityscapes(tmp_path: Path) -> None:
    content = {
        "extrinsic": {
            "baseline": 0.209313,
            "pitch": 0.038,
            "roll": 0.0,
            "x": 1.7,
            "y": 0.1,
            "yaw": -0.0195,
            "z": 1.22,
        },
        "intrinsic": {"fx": 2262.52, "fy": 2265.3017905988554, "u0": 1096.98, "v0": 513.137},
    }
    (tmp_path / "aachen_000000_000019_camera.json").write_text(json.dumps(content))
    rig = load_rig(tmp_path / "aachen_000000_000019_camera.json")
    assert rig.left.image_size == (2048, 1024)
    point = np.array([[1.0, 0.5, 10.0]])
    disparity = (
        rig.left.project(point)[0, 0] - rig.right.project(point + rig.T_right_left[:3, 3])[0, 0]
    )
    assert disparity == pytest.approx(2262.52 * 0.209313 / 10)
