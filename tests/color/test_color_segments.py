"""``color.lock: auto``: frames that share one water get one, and where they do not the dive is
cut.
"""

from dataclasses import replace
from functools import reduce
from operator import add

import numpy as np
import pytest
from test_color_engine_survey import reef, same
from test_color_robust import BLUE as SEA
from test_color_robust import SHAPE, seen_through
from test_color_robust import reef as reef_colors

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.fitting.jackknife import with_errors_of_blocks
from stereo_seecolor.color.sharing import segments
from stereo_seecolor.color.sharing.survey import CountedFrames
from stereo_seecolor.color.white_point import white_errors
from stereo_seecolor.config import ColorConfig

CLEAR = np.array([0.9, 0.95, 1.0])
GREEN = np.array([0.12, 0.9, 0.35])
BLUE = np.array([0.1, 0.45, 1.0])


def frames_under(*lights):
    """A frame of one reef under each light."""
    frames = []
    for seed, light in enumerate(lights):
        image, range_m = reef(seed)
        frames.append((np.clip(image * light + 0.5, 0, 255).astype(np.uint8), range_m))
    return frames


def fitted(frames, lock="auto"):
    corrector = Corrector(ColorConfig(input_encoding="as-is", lock=lock))
    fitter = corrector.survey_fitter()
    for i, (image, range_m) in enumerate(frames):
        fitter.add(str(i), corrector.measure(image, range_m))
    return fitter, fitter.waters()


@pytest.mark.slow
def test_frames_that_share_a_water_get_that_of_the_survey():
    frames = frames_under(*[CLEAR] * 6)
    fitter, waters = fitted(frames)
    assert fitter.notes() == ()
    assert all(same(waters[name], survey) for name, survey in fitted(frames, "survey")[1].items())


@pytest.mark.slow
@pytest.mark.parametrize("lights", [(CLEAR, GREEN), (GREEN, BLUE), (BLUE, CLEAR, BLUE)])
def test_the_dive_is_cut_where_the_water_changes(lights):
    fitter, waters = fitted(frames_under(*(light for light in lights for _ in range(4))))
    assert [names[0] for names in fitter.segments] == [str(4 * i) for i in range(len(lights))]
    assert fitter.notes()[0].startswith(
        f"the frames do not share one water: {len(lights)} waters were fitted, one each for 0 to "
        "3; 4 to 7"
    )
    alone = fitted(frames_under(*[lights[0]] * 4), "survey")[1]
    assert same(waters["0"], alone["3"])
    assert not same(waters["4"], waters["3"])


@pytest.mark.slow
def test_unrelated_pictures_are_not_forced_into_one_water():
    frames = frames_under(CLEAR, GREEN, BLUE)
    fitter, waters = fitted(frames)
    assert fitter.segments == [["0"], ["1"], ["2"]]
    own = fitted(frames[1:2], "survey")[1]["0"]
    assert same(waters["1"], own)


@pytest.mark.slow
def test_long_dives_are_held_in_a_bounded_number_of_chunks(monkeypatch):
    monkeypatch.setattr(segments, "SETTINGS", segments.SegmentSettings(most_chunks=4))
    fitter, waters = fitted(frames_under(*[CLEAR] * 8, *[GREEN] * 5))
    assert [len(names) for names in fitter.segments] == [8, 5]
    assert list(waters) == [str(i) for i in range(13)]


@pytest.mark.slow
def test_frames_without_a_known_range_go_with_those_before_them():
    frames = frames_under(CLEAR, CLEAR, CLEAR, GREEN, GREEN, GREEN)
    frames[3] = (frames[3][0], np.full_like(frames[3][1], np.nan))
    fitter, waters = fitted(frames)
    assert fitter.segments == [["0", "1", "2", "3"], ["4", "5"]]
    assert waters["3"] is waters["2"]


@pytest.mark.slow
def test_frames_that_show_the_same_are_not_cut_apart():
    corrector = Corrector(ColorConfig(input_encoding="as-is"))
    fitter = corrector.survey_fitter(linked=["2", "3"])
    for i, (image, range_m) in enumerate(frames_under(CLEAR, CLEAR, GREEN, GREEN, BLUE, BLUE)):
        fitter.add(str(i), corrector.measure(image, range_m))
    fitter.waters()
    assert fitter.segments == [["0", "1", "2", "3"], ["4", "5"]]


@pytest.mark.slow
@pytest.mark.parametrize("lock", ["auto", "survey"])
def test_frames_that_were_added_up_before_give_the_water_of_the_same_frames(lock):
    frames = frames_under(*[CLEAR] * 4, *[GREEN] * 4)
    config = ColorConfig(input_encoding="as-is", lock=lock)
    corrector = Corrector(config)
    tables = [(str(i), corrector.measure(*frame)) for i, frame in enumerate(frames)]
    fitter = corrector.survey_fitter()
    assert fitter.joins
    for start in (0, 4):
        fitter.join(CountedFrames.of(tables[start : start + 4], config))
    expected = fitted(frames, lock)[1]
    waters = fitter.waters()
    assert list(waters) == list(expected)
    assert all(same(waters[name], expected[name]) for name in expected)


@pytest.mark.parametrize(
    "changes",
    [{"lock": "frame"}, {"lock": 20}, {"lock": "survey", "camera_exposure": "brightness"}],
)
def test_frames_of_a_fit_that_goes_from_one_to_the_next_are_not_added_up_before(changes):
    fitter = Corrector(ColorConfig(input_encoding="as-is", **changes)).survey_fitter()
    assert not fitter.joins


def dive_in_sea(rng, frames, fish=()):
    """Drawn frames of a reef in blue water, 1 to 3 m away; over half of those with a fish a flat
    gray thing, at half their range.
    """
    for i in range(frames):
        range_m = np.broadcast_to(np.linspace(1 + rng.random(), 3, SHAPE[1]), SHAPE)
        color = reef_colors(rng)
        if i in fish:
            part = np.s_[:, : SHAPE[1] // 2]
            range_m, color = range_m.copy(), color.copy()
            range_m[part] = 0.7 + 0.02 * rng.random(range_m[part].shape)
            color[part] = 0.25 * (1 + 0.05 * rng.standard_normal(range_m[part].shape))[..., None]
        yield seen_through(SEA, color, range_m, rng), range_m.astype(np.float32)


def water_of(frames):
    corrector = Corrector(ColorConfig())
    fitter = corrector.survey_fitter(linked=[str(i) for i in range(1, 99)])
    for i, (image, range_m) in enumerate(frames):
        fitter.add(str(i), corrector.measure(image, range_m))
    return fitter.waters()["0"]


@pytest.mark.slow
def test_a_fish_over_half_of_some_frames_does_not_move_the_colors_of_the_dive():
    """Red over green is compared: what all channels lose alike is brightness."""
    without, with_fish = (
        water_of(dive_in_sea(np.random.default_rng(3), 12, fish)) for fish in ((), (2, 5, 8, 11))
    )
    for water in (without, with_fish):
        red, green, _ = water.attenuation(np.array(2.0)) / SEA.attenuation(np.array(2.0))
        assert red / green == pytest.approx(1, abs=0.08)
    red_over_green = [water.white[0] / water.white[1] for water in (without, with_fish)]
    assert red_over_green[1] == pytest.approx(red_over_green[0], rel=0.12)


@pytest.mark.slow
def test_the_errors_of_a_water_by_its_parts_are_the_spread_of_dives():
    """Twelve dives over one reef in one water; errors of the fit, which are larger, set to 0."""
    found, errors = [], []
    for seed in range(12):
        corrector = Corrector(ColorConfig())
        tables = [
            corrector.measure(*frame) for frame in dive_in_sea(np.random.default_rng(seed), 8)
        ]
        whole = reduce(add, tables)
        water = corrector.fit(whole)
        exact = replace(water, standard_errors={"y": np.zeros(3), "white": 1e-6 * water.white})
        shown = with_errors_of_blocks(exact, whole, tables, corrector.config).standard_errors
        found.append([water.y, np.log(water.white / np.exp(np.log(water.white).mean()))])
        errors.append([shown["y"], shown["white"] / water.white])
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / np.std(found, axis=0)
    assert (ratio > 0.6).all()
    assert (ratio < 2.0).all()


def test_the_errors_of_blocks_are_those_of_fits_that_reach_their_minimum():
    """Fits that ended early, as for costs, gave .85 of these errors here, and four times a real
    dive's.
    """
    corrector = Corrector(ColorConfig())
    tables = [corrector.measure(*frame) for frame in dive_in_sea(np.random.default_rng(0), 8)]
    whole = reduce(add, tables)
    water = corrector.fit(whole)
    exact = replace(water, standard_errors={"y": np.zeros(3), "white": 1e-6 * water.white})
    shown = with_errors_of_blocks(exact, whole, tables, corrector.config).standard_errors["y"]
    without = np.array([corrector.fit(whole - table).y for table in tables])
    assert shown == pytest.approx(np.sqrt(7 * without.var(axis=0)), rel=0.01)


@pytest.mark.slow
def test_blocks_that_enlarge_one_error_of_the_white_point_leave_none_of_its_ratios_smaller():
    """Errors of red, green and blue over their mean hold those of ratios: each cannot be enlarged
    for itself (on frames of a real dive red over green had 27 %, and blue over green 0 %).
    """
    frames = dive_in_sea(np.random.default_rng(1), 8)
    red_grows = [
        (np.clip(image * [red, 1, 1] + 0.5, 0, 255).astype(np.uint8), range_m)
        for red, (image, range_m) in zip(np.linspace(0.2, 1.0, 8), frames, strict=True)
    ]
    corrector = Corrector(ColorConfig())
    tables = [corrector.measure(*frame) for frame in red_grows]
    alone = corrector.fit(reduce(add, tables))
    errors = white_errors(
        with_errors_of_blocks(alone, reduce(add, tables), tables, corrector.config)
    )
    assert errors[0] > 1.3 * white_errors(alone)[0]
    assert errors[1] >= white_errors(alone)[1] * (1 - 1e-9)


def test_a_frame_of_another_exposure_takes_no_part_in_the_errors_either():
    """It is left out of the fit; so it is of the blocks that are taken out of the fit's table."""
    frames = list(dive_in_sea(np.random.default_rng(7), 10))
    dark = [(frames[0][0] // 12, frames[0][1])]
    alone, with_dark = (
        water_of(some).standard_errors["y"] for some in (frames, [*frames[:5], *dark, *frames[5:]])
    )
    assert with_dark == pytest.approx(alone, rel=0.35)
