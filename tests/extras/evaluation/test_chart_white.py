"""White point and color matrix from charts and cards: the true ones come back from any range, a
wrong water shows in what charts are off.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import SampleRun
from numpy.typing import NDArray

from stereo_seecolor.cli import main
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.evaluation.charts.camera_matrix import CameraMatrix, camera_matrix
from stereo_seecolor.extras.evaluation.charts.chart_types import CHART_TYPES, CLASSIC, ChartType
from stereo_seecolor.extras.evaluation.charts.chart_white import (
    ChartWhite,
    seen_whites,
    survey_white,
)
from stereo_seecolor.extras.evaluation.charts.targets import Target, chart
from stereo_seecolor.extras.evaluation.water import measure_white
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.records import Water
from stereo_seecolor.run_folder.finished_run import open_run

SIZE = (96, 128)
WHITE = np.array([0.25, 0.6, 0.5])


def some_water(red_per_m: float = 0.4) -> Water:
    zero, one = np.zeros(3), np.ones(3)
    y = np.array([red_per_m, 0.1, 0.08])
    return Water(
        np.array([0.01, 0.03, 0.04]),
        0.3 * one,
        zero,
        one,
        w=zero,
        v=zero,
        y=y,
        x=zero,
        white=WHITE,
        input_encoding="linear",
    )


CAMERA = np.array([[1.3, -0.25, -0.05], [-0.1, 1.3, -0.2], [0.02, -0.32, 1.3]])
"""To sRGB from a camera's colors."""


def pictured(
    range_m: float,
    brightness: float = 1.0,
    camera: NDArray[np.float64] | None = None,
    type: ChartType = CLASSIC,
) -> tuple[Target, NDArray[np.uint16], NDArray[np.float32]]:
    """A chart that fills a frame of 16 bits, at one range in ``some_water``; camera: (3, 3) of its
    colors to sRGB's.
    """
    water, corners = some_water(), np.array([[10, 10], [118, 10], [118, 86], [10, 86]], float)
    target, z = chart("chart", corners, SIZE, type), np.array(range_m)
    color = np.zeros((*SIZE, 3))
    for patch, srgb in zip(target.patches, type.srgb, strict=True):
        color[patch] = (
            decode_srgb(srgb) if camera is None else np.linalg.solve(camera, decode_srgb(srgb))
        )
    light = brightness * color * WHITE * water.attenuation(z) + water.backscatter(z)
    return target, np.round(light * 65535).astype(np.uint16), np.full(SIZE, range_m, np.float32)


def white_of(
    ranges_m: Sequence[float], water: Water, camera: NDArray[np.float64] | None = None
) -> ChartWhite:
    seen = []
    for number, range_m in enumerate(ranges_m):
        target, image, measured_m = pictured(range_m, 0.5 + 0.1 * number, camera)
        seen += list(seen_whites(f"{number}", [target], image, measured_m, water))
    return survey_white(seen)


def test_the_true_white_comes_back_from_any_range() -> None:
    wrong = replace(some_water(), white=np.array([0.5, 0.5, 0.5]))
    found = white_of([1.0, 2.0, 3.5], wrong)
    assert max(found.residuals_deg) < 0.5
    water = found.set_in(wrong)
    np.testing.assert_allclose(water.white / water.white[1], WHITE / WHITE[1], rtol=0.01)
    assert np.log(water.white).mean() == pytest.approx(np.log(0.5))
    assert (water.standard_errors["white"] > 0).all()
    np.testing.assert_array_equal(water.y, wrong.y)


@pytest.mark.parametrize("type", CHART_TYPES, ids=lambda type: type.name)
def test_grays_that_are_not_quite_neutral_give_the_true_white(type: ChartType) -> None:
    target, image, range_m = pictured(2.0, type=type)
    (seen,) = seen_whites("0", [target], image, range_m, some_water())
    np.testing.assert_allclose(seen.white, np.log(WHITE) - np.log(WHITE).mean(), atol=0.005)


def test_a_wrong_attenuation_shows_over_range() -> None:
    assert max(white_of([1.0, 2.0, 3.5], some_water(red_per_m=0.6)).residuals_deg) > 5
    wrong, right = (
        white_of([1.0, 3.5], some_water(red_per_m=rate)).error[0] for rate in (0.6, 0.4)
    )
    assert wrong > 5 * right


def matrix_of(
    ranges_m: Sequence[float],
    camera: NDArray[np.float64] | None,
    patches: slice = slice(None),
    water: Water | None = None,
) -> CameraMatrix | str:
    """The matrix of charts of which some patches can be seen."""
    white = white_of(ranges_m, water or some_water(), camera)
    charts = white.patches_in(white.set_in(some_water()))
    hidden = np.ones(24, bool)
    hidden[patches] = False
    return camera_matrix([replace(c, error=np.where(hidden, np.nan, c.error)) for c in charts if c])


def test_the_camera_comes_back_within_its_stated_errors() -> None:
    found = matrix_of([1.0, 2.0, 3.5], CAMERA)
    assert isinstance(found, CameraMatrix)
    np.testing.assert_allclose(found.matrix.sum(axis=1), 1)
    assert (np.abs(found.matrix - CAMERA) < 2 * found.errors).all()
    assert (found.errors < 0.12).all()
    assert found.after < 0.35 * found.before and found.left_out < 0.5 * found.before
    np.testing.assert_allclose(found.noise, np.linalg.norm(found.matrix, axis=1))


def test_a_camera_without_fault_is_left_alone() -> None:
    reason = matrix_of([1.0, 2.0], None)
    assert isinstance(reason, str) and "patches left out of its fit too little" in reason


def test_noise_is_never_more_than_tripled() -> None:
    strong = np.array([[3.2, -1.7, -0.5], [-0.6, 2.2, -0.6], [0.0, -1.1, 2.1]])
    found = matrix_of([1.0], strong)
    assert isinstance(found, CameraMatrix)
    assert (found.noise <= 3 + 1e-9).all() and found.noise[0] == pytest.approx(3)
    assert found.after < found.before


@pytest.mark.parametrize(
    ("patches", "message"),
    [
        (slice(0, 11), "11 colors of charts can be used, 11 of them not gray"),
        (slice(13, 24), "11 colors of charts can be used, 5 of them not gray"),
        (slice(0, 0), "0 colors of charts"),
    ],
)
def test_too_few_patches_give_no_matrix(patches: slice, message: str) -> None:
    reason = matrix_of([1.0, 2.0], CAMERA, patches)
    assert isinstance(reason, str) and reason.startswith(message)


def test_part_of_a_chart_is_enough() -> None:
    found = matrix_of([1.0, 2.0], CAMERA, slice(6, 22))
    assert isinstance(found, CameraMatrix) and found.patches == 16
    assert (np.abs(found.matrix - CAMERA) < 3 * found.errors).all()


def test_covered_patches_do_not_spoil_the_matrix() -> None:
    white = white_of([1.0, 2.0], some_water(), CAMERA)
    charts = [seen for seen in white.patches_in(white.set_in(some_water())) if seen]
    rubble = np.random.default_rng(3).uniform(0.1, 0.5, (7, 3))
    for seen in charts:
        seen.color[[4, 5, 10, 11, 16, 17, 22]] = rubble
    found = camera_matrix(charts)
    assert isinstance(found, CameraMatrix)
    assert (np.abs(found.matrix - CAMERA) < 0.25).all()


def test_charts_at_several_ranges_tell_how_the_water_is_off() -> None:
    right, wrong = (white_of([1.0, 2.0, 3.5], some_water(rate)).trend() for rate in (0.4, 0.5))
    assert right and wrong
    assert (np.abs(right.per_m) < 2 * right.error).all()
    assert wrong.per_m[0] == pytest.approx(0.1, abs=0.02) and wrong.per_m[0] > 5 * wrong.error[0]
    assert abs(wrong.per_m[1]) < 2 * wrong.error[1]
    assert white_of([2.0, 2.1], some_water()).trend() is None


def test_clipped_and_unmeasured_patches_do_not_count() -> None:
    target, image, range_m = pictured(1.0)
    assert not list(seen_whites("a", [target], np.full_like(image, 65535), range_m, some_water()))
    assert not list(seen_whites("a", [target], image, np.full_like(range_m, np.nan), some_water()))
    assert not list(
        seen_whites("a", [Target("card", (np.zeros(SIZE, bool),))], image, range_m, some_water())
    )


def test_a_white_card_needs_no_chart() -> None:
    _, _, range_m = pictured(2.0)
    water, card = some_water(), np.zeros(SIZE, bool)
    card[30:50, 40:60] = True
    light = 0.8 * WHITE * water.attenuation(np.array(2.0)) + water.backscatter(np.array(2.0))
    image = np.broadcast_to(np.round(light * 65535).astype(np.uint16), (*SIZE, 3)).copy()
    (seen,) = seen_whites(
        "a", [Target("card", (card,))], image, range_m, replace(water, white=np.ones(3))
    )
    np.testing.assert_allclose(seen.white, np.log(WHITE) - np.log(WHITE).mean(), atol=0.01)
    assert seen.range_m == pytest.approx(2.0)


@pytest.mark.parametrize("camera", [None, CAMERA])
def test_patches_in_another_order_are_no_chart(camera: NDArray[np.float64] | None) -> None:
    white = white_of([1.0, 3.5], some_water(), camera)
    for seen in white.patches_in(white.set_in(some_water())):
        assert seen and seen.is_in_order
        turned = replace(seen, color=seen.color[::-1], error=seen.error[::-1])
        order = np.arange(24).reshape(4, 6)[:, ::-1].ravel()
        mirrored = replace(seen, color=seen.color[order], error=seen.error[order])
        assert not turned.is_in_order and not mirrored.is_in_order
        assert replace(turned, error=np.full(24, np.nan)).is_in_order  # nothing is known


def test_targets_of_other_frames_or_outside_the_image_are_named(
    sample_run: SampleRun, tmp_path: Path
) -> None:
    name, targets = open_run(sample_run.out).frames[0].name, tmp_path / "targets.json"
    with pytest.raises(InputError, match="a target at 5000, 5 reaches outside the corrected image"):
        measure_white(sample_run.out, white=[f"{name}:5000,5"])
    for frame, said in (("GOPR1", "names no frame of the run"), (name, "reaches outside")):
        corners = [[10, 10], [9000, 10], [9000, 60]]
        targets.write_text(json.dumps({frame: [{"polygon": corners}]}))
        with pytest.raises(InputError, match=said):
            measure_white(sample_run.out, targets)


@pytest.mark.parametrize("words", [[], ["--poses", "track.tum", "--chart"]])
def test_either_poses_or_charts_are_needed(
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "empty.yaml").write_text("")
    monkeypatch.setattr(
        "sys.argv",
        [
            "stereo-seecolor",
            "water",
            str(tmp_path),
            "--config",
            str(tmp_path / "empty.yaml"),
            *words,
        ],
    )
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 1
    assert "give --poses FILE" in " ".join(capsys.readouterr().err.split())
