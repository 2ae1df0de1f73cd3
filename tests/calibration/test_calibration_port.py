"""A flat port in water, by exact rays: what the model gives, and what ignoring it costs."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.strategies import floats

from calibration import CalibrationError, Camera, Rectification, StereoRig
from calibration.formats import load_rig, write_rig
from calibration.port import FLAT_PORT, DomePort, FlatPort, FlatWindow, flat_port, seawater_index
from calibration.port_errors import port_error
from calibration.rectification import plan_rectification
from calibration.refraction import CameraInWater

SIZE = (640, 480)
AHEAD = np.array([0.0, 0.0, 1.0])


def port_rig(
    distance_m: float = 0.03,
    working_range_m: float = 1.5,
    toe_in: float = 0.0,
    normal: np.ndarray = AHEAD,
) -> StereoRig:
    K = np.array([[520.0, 0, 322.4], [0, 519.0, 238.1], [0, 0, 1]])
    camera = Camera(K, np.array([-0.2, 0.05, 0.0004, -0.0003, 0.0]), SIZE)
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.004, toe_in, -0.003]))[0]
    T[:3, 3] = [-0.12, 0.001, 0.002]
    window = FlatWindow(distance_m, 0.01, normal)
    port = FlatPort(window, window, working_range_m, seawater_index(15, 35, 20))
    return StereoRig(camera, camera, T, "air", None, port)


@pytest.mark.parametrize(
    ("temperature_c", "salinity_psu", "wavelength_nm", "index"),
    # Austin and Halikas 1976, The index of refraction of seawater, tables as in Mobley 1994, Light
    # and Water, table 3.8
    [
        (0, 0, 400, 1.344186),
        (20, 0, 589.3, 1.33299),
        (30, 35, 700, 1.335316),
        (0, 35, 400, 1.351415),
        (0, 35, 700, 1.337906),
    ],
)
def test_index_of_water_against_tables(
    temperature_c: float, salinity_psu: float, wavelength_nm: float, index: float
) -> None:
    assert seawater_index(temperature_c, salinity_psu, 0, wavelength_nm) == pytest.approx(
        index, abs=4e-4
    )


def test_index_outside_its_range_is_refused() -> None:
    with pytest.raises(CalibrationError, match="temperature_c of 60"):
        seawater_index(60, 35)


def test_paraxial_crossing_is_the_apparent_depth() -> None:
    """Seen from the water on the axis, the camera stands n_w (d / n_a + t / n_g) behind the outside
    of the glass.
    """
    camera = Camera(np.array([[520.0, 0, 320], [0, 520, 240], [0, 0, 1]]), np.zeros(5), SIZE)
    window = FlatWindow(0.05, 0.01, AHEAD)
    water = CameraInWater(camera, window, FlatPort(window, window, 1.0, 1.34, 1.5))
    point, direction = (part[0] for part in water.trace(np.array([[320.5, 240.0]])))
    crossing_m = point[2] - point[0] / direction[0] * direction[2]
    assert crossing_m == pytest.approx(0.06 - 1.34 * (0.05 + 0.01 / 1.5), abs=1e-6)


@settings(max_examples=30)
@given(tilt=floats(-0.2, 0.2), distance=floats(0, 0.2), depth=floats(0.4, 10))
def test_tracing_and_projecting_are_inverse(tilt: float, distance: float, depth: float) -> None:
    rig = port_rig(distance, normal=np.array([np.sin(tilt), 0.05, np.cos(tilt)]))
    assert isinstance(rig.port, FlatPort)
    camera = CameraInWater(rig.left, rig.port.left, rig.port)
    x, y = np.meshgrid(np.linspace(20, 620, 7), np.linspace(20, 460, 5))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    points, directions = camera.trace(pixels)
    np.testing.assert_allclose(
        camera.project_points(points + directions * depth), pixels, atol=1e-5
    )
    np.testing.assert_allclose(camera.project(camera.rays(pixels)), pixels, atol=1e-5)


def test_snell_holds_at_both_surfaces() -> None:
    rig = port_rig()
    assert isinstance(rig.port, FlatPort)
    camera = CameraInWater(rig.left, rig.port.left, rig.port)
    pixels = np.array([[100.0, 60], [600, 400], [322.4, 238.1]])
    in_air = rig.left.rays(pixels)
    sine_air = np.linalg.norm(in_air[:, :2], axis=1) / np.linalg.norm(in_air, axis=1)
    _, in_water = camera.trace(pixels)
    np.testing.assert_allclose(
        np.linalg.norm(in_water[:, :2], axis=1) * rig.port.water_index, sine_air, atol=1e-12
    )


@pytest.mark.parametrize("toe_in", [0.0, 0.05])
@pytest.mark.parametrize("distance_m", [0.005, 0.03, 0.1])
def test_range_is_right_at_the_working_range(distance_m: float, toe_in: float) -> None:
    error = port_error(port_rig(distance_m, toe_in=toe_in), np.array([1.5]))
    assert error.range_error[0] < 0.001
    assert error.row_error_px[0] < 0.1


@pytest.mark.slow
def test_range_stays_usable_away_from_the_working_range() -> None:
    error = port_error(port_rig(0.03), np.array([0.5, 0.75, 1.0, 2.0, 3.0, 5.0]))
    assert error.range_error.max() < 0.005


def test_ignoring_the_port_costs_a_quarter() -> None:
    rig = port_rig()
    error = port_error(rig, np.array([0.5, 1.5, 5.0]), seen_as=replace(rig, port=None))
    assert error.range_error == pytest.approx([0.26] * 3, abs=0.06)


@pytest.mark.slow
def test_a_picture_seen_through_the_port_is_rectified_exactly() -> None:
    """Rectification.apply on images of a dotted plane at the working range puts each dot where the
    geometry says.
    """
    rig = port_rig(0.05, working_range_m=1.0, toe_in=0.02)
    assert isinstance(rig.port, FlatPort)
    rectification = Rectification.from_rig(rig)
    plan = plan_rectification(rig)
    pair, R_left = plan.pair, plan.R_left
    left = CameraInWater(rig.left, rig.port.left, rig.port)
    x, y = np.meshgrid(np.linspace(60, 580, 9), np.linspace(60, 420, 7))
    wanted = np.column_stack([x.ravel(), y.ravel()])
    slopes = (wanted - [pair.cx_left_px, pair.cy_px]) / pair.focal_px
    raw = left.project(np.column_stack([slopes, np.ones(len(slopes))]) @ R_left)
    image = np.zeros(SIZE[::-1], np.float64)
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    for px, py in raw:
        image += np.exp(-((columns - px) ** 2 + (rows - py) ** 2) / (2 * 2.0**2))
    rectified = rectification.apply_left((image * 255).clip(0, 255).astype(np.uint8)).astype(float)
    for px, py in wanted:
        c, r = round(px), round(py)
        patch = rectified[r - 8 : r + 9, c - 8 : c + 9]
        dy, dx = np.mgrid[-8:9, -8:9]
        assert c + (patch * dx).sum() / patch.sum() == pytest.approx(px, abs=0.15)
        assert r + (patch * dy).sum() / patch.sum() == pytest.approx(py, abs=0.15)


def test_dome_changes_nothing() -> None:
    flat = port_rig()
    bare, dome = replace(flat, port=None), replace(flat, port=DomePort())
    a, b = plan_rectification(bare), plan_rectification(dome)
    np.testing.assert_array_equal(a.pair.P_left, b.pair.P_left)
    np.testing.assert_array_equal(a.R_left, b.R_left)


def test_native_file_keeps_the_port(tmp_path: Path) -> None:
    rig = port_rig(normal=np.array([0.1, 0.0, 1.0]))
    write_rig(rig, tmp_path / "cam.yaml")
    port = load_rig(tmp_path / "cam.yaml").port
    assert isinstance(port, FlatPort) and isinstance(rig.port, FlatPort)
    np.testing.assert_allclose(port.left.normal, rig.port.left.normal, atol=1e-15)
    assert port.right.distance_m == pytest.approx(rig.port.right.distance_m, rel=1e-15)
    assert port.water_index == rig.port.water_index
    write_rig(replace(rig, port=DomePort()), tmp_path / "dome.yaml")
    assert isinstance(load_rig(tmp_path / "dome.yaml").port, DomePort)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("medium: air", "medium: water"), "a flat port is for cameras calibrated in air"),
        (("working_range_m: 1.5", "working_range_m: 0"), "working_range_m of 0 m is impossible"),
        (("glass_index: 1.49", "glass_index: 0.5"), "glass_index of 0.5 is impossible"),
        (("distance_mm: 30.0", "distance_mm: 3000"), "distance of 3 m"),
        (("thickness_mm: 10.0", "thickness_mm: -1"), "glass of -0.001 m"),
        (("normal: [0.0, 0.0, 1.0]", "normal: [1.0, 0.0, 0.0]"), "must point out of the camera"),
        (("type: flat", "type: round"), "port"),
        (("glass_index: 1.49", "water: {temperature_c: 10, salinity_psu: 35}"), "either water"),
    ],
)
def test_port_that_cannot_be(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    file = tmp_path / "cam.yaml"
    write_rig(port_rig(), file)
    text = file.read_text()
    assert change[0] in text
    file.write_text(text.replace(*change))
    with pytest.raises(CalibrationError, match=message):
        load_rig(file)


def test_water_by_temperature_and_salinity(tmp_path: Path) -> None:
    file = tmp_path / "cam.yaml"
    write_rig(port_rig(), file)
    text = file.read_text()
    line = next(line for line in text.splitlines() if "water_index" in line)
    file.write_text(
        text.replace(line, "  water: {temperature_c: 15, salinity_psu: 35, depth_m: 20}")
    )
    port = load_rig(file).port
    assert isinstance(port, FlatPort)
    assert port.water_index == seawater_index(15, 35, 20)


def test_rig_without_port_has_no_port_error() -> None:
    with pytest.raises(CalibrationError, match="no flat port"):
        port_error(replace(port_rig(), port=None), np.array([1.0]))


@pytest.mark.slow
def test_one_setting_describes_a_port(tmp_path: Path) -> None:
    """As the block of cam.yaml, for every reading of a file that can be read in several ways."""
    from stereo_seecolor.commands.rig_loading import behind_port
    from stereo_seecolor.config import InputConfig

    bare = replace(port_rig(), port=None, medium="water")
    rig = behind_port(bare.with_alternatives([bare]), InputConfig(flat_port="3cm:10mm:2m"))
    described = replace(
        port_rig(),
        port=replace(port_rig().port, working_range_m=2.0, water_index=seawater_index(15, 35)),
    )
    seen, expected = (
        port_error(port_rig(), np.array([1.0, 3.0]), seen_as=one) for one in (rig, described)
    )
    np.testing.assert_allclose(seen.range_error, expected.range_error)
    assert rig.medium == rig.alternatives[0].medium == "air"
    assert isinstance(rig.alternatives[0].port, FlatPort)
    assert behind_port(bare, InputConfig()) is bare
    with pytest.raises(CalibrationError, match="describes a port already"):
        behind_port(port_rig(), InputConfig(flat_port="30mm:10mm"))


def test_a_pipeline_in_memory_takes_the_port_of_its_settings() -> None:
    from stereo_seecolor import Pipeline, load_config

    bare = replace(port_rig(), port=None)
    found = Pipeline(bare, load_config(None, ["input.flat_port=30mm:10mm"])).rig
    assert isinstance(found.port, FlatPort) and found.port.left.distance_m == 0.03
    assert found.medium == "air"
    assert Pipeline(bare).rig.port is None


@pytest.mark.parametrize("distance_m", [0.0, 0.01, 0.06, 0.1])
def test_the_proposed_port_is_near_enough_to_others(distance_m: float) -> None:
    proposed = replace(port_rig(distance_m), port=flat_port(FLAT_PORT))
    error = port_error(port_rig(distance_m), np.array([0.75, 1.5, 3.0]), seen_as=proposed)
    assert error.range_error.max() < 0.03


@pytest.mark.parametrize(
    "text", ["30mm", "30:10", "30mm:10mm:1.5m:2", "900mm:10mm", "30mm:10mm:1mm"]
)
def test_ports_that_cannot_be_are_refused(text: str) -> None:
    with pytest.raises(CalibrationError, match="port"):
        flat_port(text)
