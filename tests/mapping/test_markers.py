"""Markers on the bottom: the scale of a rig, and the place of a map, by what is known of them."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from json_shapes import SHAPES, mismatch
from mapping_scene import CONFIG, write_run
from numpy.typing import NDArray

from calibration import RectifiedPair
from calibration.transforms import inverse, rigid_transform, rotation_from_vector, transform_points
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.config import MountConfig, RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.reef.markers import Known, markers
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.mapping.control_points import control_fit
from stereo_seecolor.mapping.marker_detection import MarkerDetector
from stereo_seecolor.mapping.marker_placing import PlacedSighting
from stereo_seecolor.mapping.placed_markers import PlacedMarker, ScaleCheck, doubled, size_check
from stereo_seecolor.records import SurveyFrame, Trajectory

RIG = RectifiedPair(531.0, 320.0, 318.0, 256.0, 0.12, (640, 512))
EDGE_M = 0.2
PLACES = {3: (0.2, 0.1), 7: (0.9, -0.2), 11: (0.5, 0.4)}
"""Middles of the tags on a level bottom; upright as seen by the camera."""
TEXEL_M = 0.001


def bottom() -> NDArray[np.uint8]:
    """The bottom from x, y = -1 to 2 m, a texel a millimeter, row 0 at y = 2; grain, and tags on
    white boards.
    """
    rng = np.random.default_rng(0)
    image = cv2.GaussianBlur(rng.uniform(60, 160, (3000, 3000)).astype(np.float32), (0, 0), 2)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    for number, (x, y) in PLACES.items():
        column, row, half = (
            round((x + 1) / TEXEL_M),
            round((2 - y) / TEXEL_M),
            round(EDGE_M / TEXEL_M / 2),
        )
        image[row - half - 30 : row + half + 30, column - half - 30 : column + half + 30] = 220
        image[row - half : row + half, column - half : column + half] = (
            cv2.aruco.generateImageMarker(dictionary, number, 2 * half)
        )
    return np.clip(image, 25, 220).astype(np.uint8)


def cameras() -> NDArray[np.float64]:
    """Five poses 1.4 m above the bottom, leaning a little."""
    down = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    turns = [
        rotation_from_vector(np.array(v))
        for v in ((0, 0, 0), (0.05, 0, 0.1), (0, -0.06, -0.1), (0.04, 0.05, 0.2), (-0.05, 0, 0))
    ]
    return np.array(
        [rigid_transform(down @ turn, [0.3 + 0.1 * i, 0.1, 1.4]) for i, turn in enumerate(turns)]
    )


def frame(index: int, T: NDArray[np.float64], texture: NDArray[np.uint8]) -> SurveyFrame:
    """A frame of the level bottom with noise of a tenth of a pixel in its disparity, correlated
    over a few pixels.
    """
    rng = np.random.default_rng(index)
    rays = RIG.rays @ T[:3, :3].T.astype(np.float32)
    range_m = (-T[2, 3] / rays[..., 2]).astype(np.float32)
    ground = rays * range_m[..., None] + T[:3, 3]
    column, row = ((ground[..., 0] + 1) / TEXEL_M - 0.5, (2 - ground[..., 1]) / TEXEL_M - 0.5)
    light = decode_srgb(texture.astype(np.float32) / 255)
    seen_light = cv2.remap(
        cv2.GaussianBlur(light, (0, 0), 1.2),
        column.astype(np.float32),
        row.astype(np.float32),
        cv2.INTER_LINEAR,
    )
    gray = 255 * encode_srgb(seen_light)
    noise = cv2.GaussianBlur(rng.standard_normal(gray.shape).astype(np.float32), (0, 0), 2)
    depth_m = RIG.depth_from_range(range_m)
    std = depth_m * range_m / (RIG.focal_px * RIG.baseline_m) * np.float32(0.1)
    seen = np.clip(gray + rng.normal(0, 2, gray.shape), 1, 254).astype(np.uint8)
    noisy = range_m + std * noise / noise.std()
    color, certain = np.repeat(seen[..., None], 3, axis=2), np.full(std.shape, 255, np.uint8)
    return SurveyFrame(f"f{index}", float(index), color, noisy, std, certain)


@pytest.fixture(scope="module")
def fused(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, texture, T = tmp_path_factory.mktemp("tags"), bottom(), cameras()
    write_run(folder / "out", [frame(i, each, texture) for i, each in enumerate(T)], RIG)
    write_tum(folder / "nav.tum", Trajectory(tuple(f"f{i}" for i in range(5)), np.arange(5.0), T))
    fuse(
        folder / "out",
        folder / "nav.tum",
        RunConfig(mapping=CONFIG.model_copy(update={"poses": "given"})),
    )
    return folder / "out"


@pytest.mark.slow
def test_one_tag_in_five_frames_gives_the_scale_to_a_thousandth(fused: Path) -> None:
    found = markers(fused, Known(EDGE_M))
    assert {marker.number for marker in found.markers} == set(PLACES)
    (tag,) = (marker for marker in found.markers if marker.number == 3)
    assert tag.views == 5
    assert tag.edge_m == pytest.approx(EDGE_M, rel=1e-3)
    assert (
        found.size is not None
        and found.size.ratio == pytest.approx(1, abs=1e-3)
        and not found.size.wrong
    )
    for marker in found.markers:
        assert marker.place_m == pytest.approx([*PLACES[marker.number], 0], abs=2e-3)
        assert marker.residual_m < 3e-3


@pytest.mark.slow
def test_a_wrong_size_is_noticed_and_bars_and_surveyed_places_are_used(
    fused: Path, tmp_path: Path, cli: Callable[..., tuple[int, str, str]]
) -> None:
    length_m = np.hypot(0.7, 0.3)
    (tmp_path / "bars.csv").write_text(f"first,second,length_m\n3,7,{length_m}\n3,99,1\n")
    T = rigid_transform(rotation_from_vector(np.array([0.0, 0.0, 1.0])), [100.0, 200.0, -8.0])
    surveyed = {
        number: transform_points(T, np.array([*place, 0.0])) for number, place in PLACES.items()
    }
    rows = [f"{number},{x},{y},{z}" for number, (x, y, z) in surveyed.items()]
    (tmp_path / "gcp.csv").write_text("marker,x_m,y_m,z_m\n" + "\n".join(rows))
    words = (
        "--bars",
        tmp_path / "bars.csv",
        "--points",
        tmp_path / "gcp.csv",
        "--out",
        tmp_path / "to",
    )
    code, said, _ = cli("markers", fused, "--size", "0.15", *words, "--json")
    content = json.loads(said)
    assert (code, mismatch(content, SHAPES["markers"])) == (3, None)
    assert content["size"]["ratio"] == pytest.approx(4 / 3, rel=2e-3)
    assert (
        content["bars"]["3-7"]["ratio"] == pytest.approx(1, abs=2e-3) and len(content["bars"]) == 1
    )
    assert content["control"]["rms_m"] < 2e-3
    moved = read_trajectory(tmp_path / "to/trajectory.tum", MountConfig())
    np.testing.assert_allclose(moved.T_world_camera[:, :3, 3], (T @ cameras())[:, :3, 3], atol=5e-3)
    code, said, _ = cli("markers", fused, "--size", "0.15", "--points", tmp_path / "gcp.csv")
    assert (
        code == 3
        and "as if given without the black border" in said
        and "surveyed positions: 3 found" in said
    )
    with pytest.raises(InputError, match=r"shows no marker of aruco-6x6.*the frames show 36h11"):
        markers(fused, Known(EDGE_M, "aruco-6x6"))
    with pytest.raises(InputError, match="--family 5: is unknown: one of 36h11"):
        markers(fused, Known(EDGE_M, "5"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("marker,x_m,y_m\n1,2,3\n", "has no column 'z_m'"),
        ("marker,x_m,y_m,z_m\n1,2,here,4\n", "line 2: 'here' is not a number"),
        ("marker,x_m,y_m,z_m\n1,2,3,4\n1,5,3,4\n", "line 2: marker 1 has two positions"),
        ("marker,lat,lon,depth_m\n1,146,-17,4\n", "a latitude of 146 degrees: are lat and lon"),
    ],
)
def test_tables_that_cannot_be_used_say_so(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "points.csv").write_text(content)
    with pytest.raises(InputError, match=message):
        markers(tmp_path, Known(points=tmp_path / "points.csv"))


def test_control_points_must_fix_the_map() -> None:
    places = {
        1: np.array([0.0, 0, 0]),
        2: np.array([1.0, 0, 0]),
        3: np.array([2.0, 0, 0]),
        4: np.array([1.0, 1, 0]),
    }
    found = [
        PlacedMarker(number, 3, *map(float, place), 0.001, 0.2, 0.001)
        for number, place in places.items()
    ]
    with pytest.raises(InputError, match="2 of 4 markers were found"):
        control_fit(found[:2], places)
    with pytest.raises(InputError, match="lie on a line"):
        control_fit(found[:3], places)
    T = rigid_transform(rotation_from_vector(np.array([0.0, 0, 2])), [3, 4, 5])
    fit = control_fit(
        found, {number: transform_points(T, place) for number, place in places.items()}
    )
    assert fit.rms_m < 1e-9
    np.testing.assert_allclose(fit.T, T, atol=1e-9)
    assert inverse(fit.T) @ T == pytest.approx(np.eye(4))


def test_only_what_no_rig_could_be_is_called_wrong() -> None:
    assert ScaleCheck(0.75, 0.002, 3).wrong
    assert not ScaleCheck(1.01, 0.001, 3).wrong  # a rig that drifted
    assert not ScaleCheck(1.05, 0.02, 3).wrong  # not sure enough
    assert not replace(ScaleCheck(0.75, 0.002, 3), ratio=1.0).wrong


def test_an_edge_is_more_than_nothing(tmp_path: Path) -> None:
    for edge_m in (0.0, -0.2, math.nan):
        with pytest.raises(InputError, match=r"--size .*: give the edge of the black square"):
            markers(tmp_path, Known(edge_m))


def test_a_bar_has_two_ends(tmp_path: Path) -> None:
    (tmp_path / "bars.csv").write_text("first,second,length_m\n1,2,0.5\n3,3,0.6\n")
    with pytest.raises(InputError, match=r"line 3: a bar from marker 3 to itself"):
        markers(tmp_path, Known(bars=tmp_path / "bars.csv"))


def test_markers_of_another_size_are_named_and_left_out() -> None:
    edges = {1: 0.2005, 2: 0.1502, 3: 0.1995, 4: 0.202}
    found = [PlacedMarker(n, 3, n, 0, 0, 0.001, edge, 0.0005) for n, edge in edges.items()]
    check = size_check(found, 0.2, 8)
    assert check
    assert (check.odd, check.lengths, check.wrong) == ((2,), 3, True)
    assert check.ratio == pytest.approx(1.003, abs=1e-3)
    assert "of another size than most: 2, left out" in check.cause([check])
    assert not size_check([found[0], found[2]], 0.2, 8).wrong


def test_a_bar_of_two_lengths_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bars.csv").write_text("first,second,length_m\n1,2,0.5\n2,1,0.6\n")
    with pytest.raises(InputError, match=r"line 3: bar 2-1 has two lengths, 0.5 and 0.6 m"):
        markers(tmp_path, Known(bars=tmp_path / "bars.csv"))


@pytest.mark.parametrize(
    ("ratio", "cells", "others", "said"),
    [
        (0.001, 8, (), "as if given in millimeters"),
        (0.3048, 0, (), "as if given in feet"),
        (0.801, 8, (), "as if given with the white margin"),
        (0.75, 6, (), "as if given with the white margin"),
        (0.95, 8, (0.951,), "the images do not show which"),
        (0.95, 0, (1.001,), "this length is wrong, since others differ by another factor"),
    ],
)
def test_the_cause_of_a_wrong_length_is_tested(
    ratio: float, cells: int, others: tuple[float, ...], said: str
) -> None:
    checks = [ScaleCheck(other, 0.001, 1) for other in others]
    assert said in ScaleCheck(ratio, 0.001, 3, cells).cause(checks)


def test_two_markers_of_a_number_are_found_in_a_frame() -> None:
    square = np.array([[0.0, 0, 1], [0.2, 0, 1], [0.2, 0.2, 1], [0, 0.2, 1]])
    one, same, other = (
        PlacedSighting(3, "f0", square + np.array([x, 0, 0]), (0.0, 0.0)) for x in (0.0, 0.01, 0.5)
    )
    assert doubled([one, same, replace(other, frame="f1")]) == set()
    assert doubled([one, same, other]) == {3}


def test_surveyed_positions_in_another_unit_are_named() -> None:
    places = {1: (0.0, 0.0, 0.0), 2: (1.0, 0.1, 0.0), 3: (0.2, 0.8, 0.1), 4: (0.9, 0.9, 0.0)}
    found = [PlacedMarker(number, 3, *place, 0.001, 0.2, 0.001) for number, place in places.items()]
    feet = {number: np.array(place) / 0.3048 for number, place in places.items()}
    assert control_fit(found, feet).doubt.endswith("as if given in feet")


def test_surveyed_positions_of_two_markers_exchanged_are_named() -> None:
    places = {1: (0.0, 0.0, 0.0), 2: (1.0, 0.1, 0.0), 3: (0.2, 0.8, 0.1), 4: (0.9, 0.9, 0.0)}
    found = [PlacedMarker(number, 3, *place, 0.001, 0.2, 0.001) for number, place in places.items()]
    points = {number: np.array(place) for number, place in places.items()}
    points[2], points[3] = points[3], points[2]
    assert control_fit(found, points).doubt.startswith("markers 2 and 3 fit if their positions are")


@pytest.mark.parametrize("side_px", [28, 40, 70])
def test_a_side_is_measured_where_light_has_its_middle(side_px: int) -> None:
    """A tag drawn in linear light at 16 times the resolution, blurred, then encoded."""
    texture = cv2.aruco.generateImageMarker(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), 5, 80
    )
    light = np.pad(texture, 10, constant_values=255).astype(np.float32) / 255
    fine, size = 16, 96
    middle = np.array([47.7, 48.2])
    at = (np.mgrid[: size * fine, : size * fine][::-1] + 0.5) / fine - 0.5 - middle[:, None, None]
    turned = np.tensordot(rotation_from_vector(np.array([0, 0, 0.3]))[:2, :2], at, axes=1)
    u, v = (turned * 80 / side_px + 49.5).astype(np.float32)
    drawn = 0.02 + 0.5 * cv2.remap(light, u, v, cv2.INTER_NEAREST, borderValue=0.5)
    seen = cv2.GaussianBlur(drawn, (0, 0), 0.7 * fine)
    seen = seen.reshape(size, fine, size, fine).mean(axis=(1, 3))
    gray = np.rint(255 * encode_srgb(seen)).astype(np.uint8)
    (found,) = MarkerDetector("36h11").find(np.repeat(gray[..., None], 3, axis=2))
    sides = np.linalg.norm(np.roll(found.corners_px, 1, axis=0) - found.corners_px, axis=1)
    assert sides.mean() == pytest.approx(side_px, abs=0.05)
    assert found.corners_px.mean(axis=0) == pytest.approx(middle, abs=0.05)
