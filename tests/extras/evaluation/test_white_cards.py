"""White cards are found by their shape; boards, discs and reefs show none. A card of an unlikely
color is not believed.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from test_chart_white import some_water
from test_evaluation_chart_finder import placed, rubble, under_water

from stereo_seecolor.extras.evaluation.charts.chart_types import CLASSIC
from stereo_seecolor.extras.evaluation.charts.chart_white import SeenWhite, believed
from stereo_seecolor.extras.evaluation.charts.targets import targets_of
from stereo_seecolor.extras.evaluation.charts.white_cards import white_cards

CORNERS = np.array([[110, 90], [171, 102], [160, 158], [99, 146]], float)


def with_card(image: np.ndarray, corners: np.ndarray, brightness: float = 0.97) -> np.ndarray:
    large = cv2.resize(image, None, fx=4, fy=4)
    cv2.fillConvexPoly(large, np.round(4 * corners).astype(np.int32), [brightness] * 3)
    return cv2.resize(large, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("turn_deg", [0, 33])
@pytest.mark.parametrize("size", [0.6, 1.0, 1.8])
def test_a_card_is_outlined(seed: int, turn_deg: float, size: float) -> None:
    turn = cv2.getRotationMatrix2D((0, 0), turn_deg, size)[:, :2]
    corners = (CORNERS - CORNERS.mean(axis=0)) @ turn.T + CORNERS.mean(axis=0)
    (found,) = white_cards(under_water(with_card(rubble(seed), corners), 2.0))
    apart = np.hypot(*np.moveaxis(found[:, None] - corners, -1, 0))
    assert apart.min(axis=0).max() < 1.5


@pytest.mark.parametrize("seed", range(3))
def test_nothing_else_is_a_card(seed: int) -> None:
    board = rubble(seed)
    for row in range(4):
        for column in range(row % 2, 6, 2):
            board[60 + 24 * row : 84 + 24 * row, 80 + 24 * column : 104 + 24 * column] = 0.97
    dark = with_card(rubble(seed), CORNERS, 0.05)
    disc = cv2.circle(rubble(seed), (140, 120), 30, (0.97, 0.97, 0.97), -1, cv2.LINE_AA)
    for image in (rubble(seed), board, dark, disc):
        assert white_cards(under_water(image, 2.0)) == ()


@pytest.mark.slow
def test_a_chart_comes_before_cards() -> None:
    chart = placed(
        rubble(1), CLASSIC, np.array([[20, 20], [140, 20], [140, 100], [20, 100]], float)
    )
    image = under_water(with_card(chart, CORNERS + np.array([90, 30])), 2.0)
    assert [
        target.name for target in targets_of([], image, np.ones(image.shape[:2], np.float32))
    ] == ["chart"]


@pytest.mark.slow
def test_a_card_takes_the_range_of_its_border() -> None:
    image, range_m = (
        under_water(with_card(rubble(1), CORNERS), 2.0),
        np.full((240, 320), 2.0, np.float32),
    )
    inside = np.zeros(range_m.shape, np.uint8)
    cv2.fillConvexPoly(
        inside,
        np.round(CORNERS.mean(axis=0) + 0.9 * (CORNERS - CORNERS.mean(axis=0))).astype(np.int32),
        1,
    )
    range_m[inside > 0] = np.nan
    (card,) = targets_of([], image, range_m)
    assert card.name == "white card at pixel 135, 124"
    assert card.mask.sum() > 200


def seen(color: list[float], chart: bool = False) -> SeenWhite:
    white = np.log(some_water().white * color)
    return SeenWhite("a", "card", 2.0, white - white.mean(), 0.02, type=CLASSIC if chart else None)


def test_a_card_is_believed_where_its_color_can_be_that_of_white() -> None:
    water = replace(some_water(), standard_errors={"white": 0.2 * some_water().white})
    near, far, chart = (
        seen([1.3, 1.0, 0.9]),
        seen([4.0, 1.0, 0.9]),
        seen([4.0, 1.0, 0.9], chart=True),
    )
    assert believed([near, far], water) == [near]
    assert believed([near, far, chart], water) == [chart]
    assert believed([near, far], some_water()) == [near, far]


@pytest.mark.slow
@pytest.mark.real_data
def test_real_frames_without_a_card_show_none(real_data: Path) -> None:
    paths = [
        *sorted((real_data / "acfr/left").iterdir())[::5],
        *sorted((real_data / "flsea/rgb").iterdir())[::2],
    ]
    for path in paths:
        assert white_cards(cv2.imread(str(path))[..., ::-1].copy()) == (), path.name
