"""Finding color charts: small, tilted, turned, cut, covered, several at once, under water; and
nothing where there is none.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_seecolor.extras.evaluation.charts.chart_finder import find_charts
from stereo_seecolor.extras.evaluation.charts.chart_types import (
    CHART_TYPES,
    CLASSIC,
    DKK,
    ChartType,
)
from stereo_seecolor.extras.evaluation.charts.targets import targets_of
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb

SIZE = (240, 320)


def rubble(seed: int) -> np.ndarray:
    """(H, W, 3) encoded, textured at all scales."""
    rng = np.random.default_rng(seed)
    layers = [
        cv2.resize(
            rng.standard_normal((3 * 2**k, 4 * 2**k, 3)), SIZE[::-1], interpolation=cv2.INTER_CUBIC
        )
        for k in range(6)
    ]
    return np.clip(0.4 + 0.06 * sum(layers), 0, 1)


def placed(image: np.ndarray, type: ChartType, corners: np.ndarray) -> np.ndarray:
    """The chart in its black frame, drawn by an exact homography at four times the resolution."""
    frame = type.frame
    whole = np.array([[-frame, -frame], [type.size[0] + frame, type.size[1] + frame]])
    onto = cv2.getPerspectiveTransform(type.corners, np.float32(4 * corners))
    large = cv2.resize(image, None, fx=4, fy=4)
    cells = [
        (np.array([whole[0, 0], whole[0, 1], *(whole[1] - whole[0])]), np.full(3, 0.1)),
        *zip(type.cells, type.srgb, strict=True),
    ]
    for number, ((x, y, w, h), color) in enumerate(cells):
        gap = 0.06 if number else 0
        outline = np.float32(
            [
                [x + gap, y + gap],
                [x + w - gap, y + gap],
                [x + w - gap, y + h - gap],
                [x + gap, y + h - gap],
            ]
        )
        cv2.fillPoly(
            large,
            [np.round(cv2.perspectiveTransform(outline[None], onto)[0]).astype(np.int32)],
            color.tolist(),
        )
    return cv2.resize(large, SIZE[::-1], interpolation=cv2.INTER_AREA)


def under_water(image: np.ndarray, meters: float) -> np.ndarray:
    """Through so much of a blue-green water, with noise, 8 bits."""
    light = decode_srgb(image) * np.exp(-meters * np.array([0.35, 0.08, 0.06])) + np.array(
        [0.03, 0.12, 0.2]
    ) * (1 - np.exp(-0.2 * meters))
    noise = 0.004 * np.random.default_rng(1).standard_normal(light.shape)
    return np.round(255 * np.clip(encode_srgb(np.clip(light + noise, 0, 1)), 0, 1)).astype(np.uint8)


def outline(
    center: tuple[float, float], width: float, angle_deg: float, squeeze: float = 1.0
) -> np.ndarray:
    angle = np.radians(angle_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    half = np.array([[-3, -2], [3, -2], [3, 2], [-3, 2]]) * [1, squeeze] * width / 6
    return half @ turn.T + center


SMALL, TURNED = (36, 5, 0.9, 3), (110, -97, 0.8, 4)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("type", "width", "angle_deg", "squeeze", "meters"),
    [(type, *SMALL) for type in CHART_TYPES] + [(CLASSIC, *TURNED)],
)
def test_a_chart_is_found_where_it_is(
    type: ChartType, width: float, angle_deg: float, squeeze: float, meters: float
) -> None:
    corners = outline((170, 115), width, angle_deg, squeeze)
    (found,) = find_charts(under_water(placed(rubble(0), type, corners), meters))
    assert found.type is type
    assert np.abs(found.corners - corners).max() < 0.25 * width / 6 + 0.5


@pytest.mark.slow
def test_several_charts_of_two_kinds(tmp_path: Path) -> None:
    truth = [
        (CLASSIC, outline((80, 60), 60, 3)),
        (DKK, outline((240, 80), 45, -6)),
        (CLASSIC, outline((160, 180), 30, 0)),
    ]
    image = rubble(3)
    for type, corners in truth:
        image = placed(image, type, corners)
    found = find_charts(under_water(image, 2))
    assert len(found) == 3
    for type, corners in truth:
        distances = [
            float(np.hypot(*(chart.corners.mean(axis=0) - corners.mean(axis=0)))) for chart in found
        ]
        nearest = found[int(np.argmin(distances))]
        assert nearest.type is type
        assert np.abs(nearest.corners - corners).max() < 3


def middles(type: ChartType, corners: np.ndarray) -> np.ndarray:
    """(N, 2) of the patches of a chart with these corners, pixels."""
    onto = cv2.getPerspectiveTransform(type.corners, np.float32(corners))
    return cv2.perspectiveTransform(
        np.float32(type.cells[:, :2] + type.cells[:, 2:] / 2)[None], onto
    )[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("type", "center", "width", "angle_deg"),
    [(CLASSIC, (160, 0), 130, 185), (CLASSIC, (20, 20), 190, 40), (DKK, (20, 120), 150, 8)],
)
def test_a_chart_cut_by_the_border(
    type: ChartType, center: tuple[float, float], width: float, angle_deg: float
) -> None:
    corners = outline(center, width, angle_deg)
    inside = (
        (middles(type, corners) >= 0) & (middles(type, corners) <= [SIZE[1] - 1, SIZE[0] - 1])
    ).all(axis=1)
    (found,) = find_charts(under_water(placed(rubble(0), type, corners), 2))
    assert found.type is type
    assert found.seen.sum() >= 8 and not (found.seen & ~inside).any()
    off = np.hypot(*(middles(type, found.corners) - middles(type, corners))[found.seen].T)
    assert off.max() < 0.07 * width / 6


@pytest.mark.slow
@pytest.mark.parametrize("contrast", [0.3, 0.06])
def test_a_chart_in_haze(contrast: float) -> None:
    corners = outline((160, 120), 170, 25)
    light = contrast * decode_srgb(placed(rubble(0), CLASSIC, corners)) + (1 - contrast) * np.array(
        [0.05, 0.22, 0.25]
    )
    noisy = encode_srgb(light) + 0.004 * np.random.default_rng(1).standard_normal(light.shape)
    (found,) = find_charts(np.round(255 * noisy).astype(np.uint8))
    assert found.type is CLASSIC
    assert np.abs(found.corners - corners).max() < 0.2 * 170 / 6


@pytest.mark.slow
def test_what_covers_a_chart_is_not_read() -> None:
    corners = outline((160, 120), 150, 20)
    image = placed(rubble(0), CLASSIC, corners)
    cv2.circle(
        image, np.rint(middles(CLASSIC, corners)[10]).astype(int).tolist(), 38, (0.5, 0.45, 0.4), -1
    )
    (found,) = find_charts(under_water(image, 2))
    away = np.hypot(*(middles(CLASSIC, corners) - middles(CLASSIC, corners)[10]).T)
    assert not found.seen[away < 38].any() and found.seen[away > 60].all()
    (target,) = targets_of([], under_water(image, 2), np.ones(SIZE, np.float32))
    assert [bool(patch.any()) for patch in target.patches] == found.seen.tolist()


@pytest.mark.slow
@pytest.mark.parametrize("order", ["mirrored", "permuted", "gray"])
def test_other_boards_are_no_charts(order: str) -> None:
    colors = {
        "mirrored": CLASSIC.srgb.reshape(4, 6, 3)[:, ::-1].reshape(-1, 3),
        "permuted": np.random.default_rng(2).permutation(CLASSIC.srgb),
        "gray": np.repeat(CLASSIC.srgb.mean(axis=1, keepdims=True), 3, axis=1),
    }
    board = replace(CLASSIC, srgb=colors[order])
    assert find_charts(under_water(placed(rubble(1), board, outline((160, 120), 150, 10)), 2)) == ()


@pytest.mark.slow
def test_rubble_is_no_chart() -> None:
    assert find_charts(under_water(rubble(0), 2)) == ()


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((40, 60, 3), np.uint8),
        np.full((300, 400, 3), 255, np.uint8),
        np.zeros((2, 2, 3), np.uint16),
    ],
)
def test_pictures_of_nothing(image: np.ndarray) -> None:
    assert find_charts(image) == ()


@pytest.mark.real_data
@pytest.mark.slow
def test_four_charts_at_five_to_ten_meters(real_data: Path) -> None:
    image = cv2.imread(str(real_data / "seathru" / "3374.png"))[..., ::-1]
    found = find_charts(np.ascontiguousarray(image))
    assert [chart.type for chart in found] == [DKK] * 4
    middles = np.array(sorted(chart.corners.mean(axis=0).tolist() for chart in found))
    np.testing.assert_allclose(middles, [[367, 271], [405, 310], [426, 262], [484, 300]], atol=3)


@pytest.mark.real_data
@pytest.mark.slow
def test_a_real_picture_without_a_chart(real_data: Path) -> None:
    assert (
        find_charts(
            np.ascontiguousarray(cv2.imread(str(real_data / "aloe" / "left.png"))[..., ::-1])
        )
        == ()
    )
