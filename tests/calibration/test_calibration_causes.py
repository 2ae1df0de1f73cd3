"""Causes of what rows and motion show: of drawn dives with one fault, with two, and with none."""

import re
from dataclasses import replace

import numpy as np
import pytest
from drawn_rigs import DrawnDive, Fault, affine, both, drawn_dive, rig, shutters, turned

from calibration import StereoRig
from calibration.checks import RowCheck, judge_matches
from calibration.port import flat_port
from calibration.rectification import plan_rectification
from calibration.verification.causes import find_causes
from calibration.verification.explanations import Causes, Explanation
from calibration.verification.motion import motion_of
from calibration.verification.motion_result import Motion
from calibration.verification.table import CAUSES

YAW, PITCH, ROLL = "(yaw)", "(pitch)", "a roll of a camera"
ALONG, ACROSS = "shifted along the baseline", "shifted across the baseline"
RIGHT, LEFT, BOTH = (f"focal length of {side}" for side in ("the right", "the left", "both"))
CUT, SHUTTERS = "images of both sides cropped and", "rolling shutters"
IN_HEIGHT = "times in height"


def bent(side: str, more: float) -> StereoRig:
    """The rig with another distortion of a side's lens."""
    lens = getattr(rig(), side)
    return replace(
        rig(), **{side: replace(lens, distortion=lens.distortion + np.array([more, 0, 0, 0, 0]))}
    )


def with_distortions(times: float) -> StereoRig:
    """The rig with lenses that bend so many times as much."""
    left, right = (
        replace(lens, distortion=times * lens.distortion) for lens in (rig().left, rig().right)
    )
    return replace(rig(), left=left, right=right)


def in_air() -> StereoRig:
    """The rig as it is in water, if its calibration was made in air."""
    return replace(rig(), medium="air", port=flat_port("30mm:10mm"))


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"relief_m": 0.0, "seed": 2},
        {"points": 70},
        {"noise_px": 0.35},
        {"pairs": 3, "seed": 5},
        {"seed": 9},
    ],
    ids=["rough", "flat", "few features", "noise", "three pairs", "another bottom"],
)
def test_no_cause_is_named_without_a_fault(settings: dict[str, float]) -> None:
    drawn = drawn_dive(**settings)
    found = find_causes(drawn.rig, drawn.matches, drawn.couples)
    assert (found.line, found.is_wrong, found.explains) == ("", False, True)


def test_ranges_are_wrong_where_a_rival_says_so() -> None:
    """Which of two explanations that are as likely is the best is chance."""
    harmless, harmful = (
        Explanation(text, (), 0.0, is_wrong=is_wrong)
        for text, is_wrong in (("a pitch", False), ("a focal length", True))
    )
    assert Causes(harmless, (harmful,)).is_wrong
    assert Causes(harmless, (harmful,)).is_wrong_if_refined
    assert not Causes(harmless, (harmless,)).is_wrong


def test_only_one_cause_alone_is_more_likely_than_a_mistake_with_the_file() -> None:
    """Of a real dive with R transposed: pitch, roll and a crop left fewer pixels of the rows."""
    for many in (0, 1, 3):
        causes = Causes(Explanation("", CAUSES[:many], 0.0), numbers=20, rig=rig())
        assert (causes.rig_of_one is not None) == (many == 1)
    assert replace(causes, best=Explanation("", CAUSES[:1], 100.0)).rig_of_one is None


def test_ends_of_a_dive_outrank_what_explains_all_of_it() -> None:
    """The couples of one end decide most of what explains all."""
    cause, nothing = (
        Causes(Explanation(text, CAUSES[:many], 0.0, is_wrong=bool(text)), numbers=20)
        for text, many in (("a shift", 1), ("", 0))
    )
    motion = Motion(couples=4, range_error=0.2, range_std=0.04, at_m=2.0, disparity_px=20.0)
    row_check = RowCheck(12, 900, 0.06, 0.0, 1.0, 0.0, 0.06, 0.0, motion=motion)
    for found, says in (
        (replace(cause, motion=motion), "ranges may be wrong by +20%"),
        (cause.in_parts(nothing, cause), "beginning (nothing is wrong) and another their end"),
    ):
        lines = "\n".join(replace(row_check, causes=found).lines())
        assert found.is_wrong and says in lines
        assert ("+20%" in lines) == (not found.parts)


def test_causes_that_explain_both_ends_are_no_change_in_the_dive() -> None:
    """In any order, and as the best of one end and a rival at the other."""
    one, turned_around, another = (
        Explanation("both", causes, 0.0) for causes in (CAUSES[:2], CAUSES[1::-1], CAUSES[2:4])
    )
    before = Causes(one, numbers=20)
    for after in (Causes(turned_around, numbers=20), Causes(another, (one,), numbers=20)):
        assert before.in_parts(before, after).parts is None
    assert before.in_parts(before, Causes(another, numbers=20)).parts


def test_a_wrong_baseline_leaves_no_trace() -> None:
    T = rig().T_right_left.copy()
    T[:3, 3] *= 1.1
    drawn = drawn_dive(true=replace(rig(), T_right_left=T))
    assert find_causes(drawn.rig, drawn.matches, drawn.couples).line == ""
    assert abs(drawn.range_error) > 0.05


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "true", "named", "rivals"),
    [
        (affine(x_px=6), None, ALONG, {YAW}),
        (affine(x_px=-6), None, ALONG, {YAW}),
        (affine(y_px=3), None, ACROSS, {PITCH}),
        (affine(scale=1.02), None, RIGHT, {LEFT}),
        (affine(right=False, scale=1.02), None, LEFT, {RIGHT}),
        (both(1.1), None, CUT, {BOTH}),
        (shutters(-3), None, SHUTTERS, set()),
        (None, turned(yaw=0.009), YAW, set()),
        (None, turned(pitch=0.005), PITCH, {ACROSS}),
        (None, turned(roll=0.009), ROLL, set()),
    ],
)
def test_a_fault_is_named_with_what_it_does_to_ranges(
    fault: Fault | None, true: StereoRig | None, named: str, rivals: set[str]
) -> None:
    drawn = drawn_dive(*([fault] if fault else []), true=true)
    found = find_causes(drawn.rig, drawn.matches, drawn.couples)
    assert found.best and named in found.best.text and len(found.best.causes) == 1
    assert all(any(rival in one.text for rival in rivals) for one in found.rivals)
    assert any(
        one.range_error == pytest.approx(drawn.range_error, abs=2 * one.range_std + 0.01)
        for one in (found.best, *found.rivals)
    )
    # a pitch and a shift across the baseline leave ranges as they are
    assert found.is_wrong == (named not in (PITCH, ACROSS))


@pytest.mark.slow
def test_a_crop_of_the_middle_of_both_sides_is_named() -> None:
    """The calibration is of images of 1360 by 980 px."""
    left, right = (
        replace(camera, K=camera.K + np.array([[0, 0, 200], [0, 0, 130], [0, 0, 0]]))
        for camera in (rig().left, rig().right)
    )
    drawn = drawn_dive(true=rig(), given=replace(rig(), left=left, right=right))
    found = find_causes(drawn.rig, drawn.matches, drawn.couples)
    assert found.explains and found.best
    assert "cropped from larger ones" in found.best.text and len(found.best.causes) == 1


@pytest.mark.slow
def test_a_zoom_of_both_sides_in_the_dive_is_named() -> None:
    before, after = (
        find_causes(part.rig, part.matches, part.couples)
        for part in (drawn_dive(), drawn_dive(both(1.1)))
    )
    found = replace(before, best=Explanation("", (), 1e9)).in_parts(before, after)
    assert not found.explains and found.parts
    assert not found.parts[0].text and CUT in found.parts[1].text
    assert "zoom, focus, crop or mode changed in the dive" in found.line
    assert before.in_parts(before, before).parts is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "true", "named", "amount"),
    [
        (None, turned(yaw=np.radians(0.8)), YAW, r"\(yaw\) by \+0\.(8|79|81) "),
        (None, turned(yaw=np.radians(-2)), YAW, r"\(yaw\) by -(2|1\.9|2\.1) "),
        (None, turned(pitch=np.radians(2)), PITCH, r"\(pitch\) by \+2 "),
        (affine(scale=1.06), None, "images of the right side cropped", "enlarged 1.06 "),
        (both(1.4), None, CUT, r"enlarged 1\.(39|40|41) "),
        (both(1, 1.333), None, IN_HEIGHT, r"stretched 1\.3[234] "),
        (both(0.75, 1), None, "times their width", r"squeezed to 0\.7[456] "),
        (affine(scale=0.94), None, "images of the right side with a wider view", r"at 0\.94 "),
        (None, in_air(), "flat port", r"index 1\.3[345] "),
        (None, bent("right", 0.05), "distortion of the right lens", r"k1 by \+0\.0(49|5|51) "),
        (
            None,
            with_distortions(0),
            "distortion of both lenses",
            r"lenses of -?0\.[01]\d \+- 0\.\d+ times",
        ),
        (
            None,
            with_distortions(-1),
            "distortion of both lenses",
            r"lenses of -(1|0\.9)[.\d]* \+- 0\.\d+ times",
        ),
    ],
    ids=[
        "yaw .8",
        "yaw -2",
        "pitch",
        "one side cut out",
        "both cut out",
        "stretched",
        "squeezed",
        "one side wider",
        "air",
        "one lens",
        "without distortion",
        "other sign",
    ],
)
def test_a_large_fault_is_named_with_its_size(
    fault: Fault | None, true: StereoRig | None, named: str, amount: str
) -> None:
    """Large ones are not in proportion to what they leave of rows and motion."""
    drawn = drawn_dive(*([fault] if fault else []), true=true)
    found = find_causes(drawn.rig, drawn.matches, drawn.couples)
    assert found.best and named in found.best.text and found.is_wrong and found.explains
    assert re.search(amount, found.best.text)
    assert len(found.best.causes) == 1
    for rival in found.rivals:  # another k1 for none at all
        assert rival.range_error == pytest.approx(found.best.range_error, abs=found.best.range_std)
    assert found.best.range_error == pytest.approx(
        drawn.range_error, abs=3 * found.best.range_std + 0.01
    )


@pytest.mark.slow
def test_what_nothing_explains_gets_no_number() -> None:
    """Points that another rig took."""
    lens = replace(
        rig().left,
        K=np.array([[600.0, 0, 470], [0, 610, 350], [0, 0, 1]]),
        distortion=np.array([-0.3, 0.1, 0.001, 0.002, 0]),
    )
    drawn = drawn_dive(true=replace(turned(0.03, 0.05, -0.01), left=lens))
    found = find_causes(drawn.rig, drawn.matches, drawn.couples)
    assert found.is_wrong and not found.explains
    assert found.line.startswith("no cause that was tested explains it") and "%" not in found.line


@pytest.mark.slow
@pytest.mark.parametrize(
    ("faults", "named"),
    [
        ([affine(x_px=5, roll=0.008)], {ROLL, ALONG}),
        ([affine(scale=1.02), shutters(3)], {RIGHT, SHUTTERS}),
        ([affine(x_px=8, y_px=4, scale=1.02)], {RIGHT, ALONG, ACROSS}),
    ],
)
def test_faults_at_once_are_all_named(faults: list[Fault], named: set[str]) -> None:
    drawn = drawn_dive(*faults)
    found = find_causes(drawn.rig, drawn.matches, drawn.couples)
    named_sets = [
        one.text for one in (found.best, *found.rivals) if one and len(one.causes) == len(named)
    ]
    assert any(all(name in text for name in named) for text in named_sets)
    assert found.explains and found.is_wrong


def checked(drawn: DrawnDive) -> RowCheck:
    """What ``check`` finds on a dive."""
    motion = motion_of(drawn.couples, plan_rectification(drawn.rig).matching_pair)
    causes = find_causes(drawn.rig, drawn.matches, drawn.couples)
    return replace(judge_matches(drawn.rig, drawn.matches), motion=motion, causes=causes)


def of_motion(range_error: float, range_std: float) -> RowCheck:
    """Rows that agree, and a motion that no cause explains."""
    motion = Motion(
        couples=5,
        points=900,
        offset_px=8.0,
        offset_std_px=3.0,
        range_error=range_error,
        range_std=range_std,
        at_m=1.9,
        pixel_error=0.007,
        disparity_px=80.0,
    )
    causes = Causes(Explanation("", (), 32.0), numbers=11, motion=motion)
    return RowCheck(12, 4000, 0.13, 0.0, 1.0, 0.0, 0.12, 0.0, "", motion, causes, disparity_px=80.0)


@pytest.mark.slow
def test_a_stretch_is_no_movement_of_a_camera_and_is_wrong() -> None:
    """Ranges are right, and lengths across the baseline are not."""
    found = checked(drawn_dive(both(1, 1.1), points=200))
    assert found.causes.best and IN_HEIGHT in found.causes.best.text and not found.causes.rivals
    assert abs(found.causes.best.range_error) < 0.02
    assert found.ranges_are_wrong and found.cut_out and not found.has_moved


@pytest.mark.slow
def test_rows_alone_do_not_tell_a_stretch_from_two_movements() -> None:
    def named(drawn: DrawnDive) -> list[str]:
        found = find_causes(drawn.rig, drawn.matches)
        return [one.text for one in (found.best, *found.rivals) if one]

    moved, *rivals = named(drawn_dive(both(1, 1.333), points=200))
    assert ROLL in moved and any(IN_HEIGHT in rival for rival in rivals)
    assert not any("shapes" in one for one in named(drawn_dive(true=turned(roll=0.0005))))


@pytest.mark.parametrize("sign", [1, -1])
def test_ranges_that_the_motion_contradicts_are_wrong_without_a_clear_cause(sign: int) -> None:
    """By two to three standard errors: no cause is sure, and ranges are wrong all the same."""
    found = of_motion(sign * 0.11, 0.046)
    assert found.ranges_are_wrong and not found.acceptable
    assert found.measured and found.measured.is_sure
    (line,) = found.advice
    assert f"ranges may be wrong by {sign * 11:+d}%" in line
    assert "\n".join(found.lines()).count("motion between") == 1
    within = of_motion(sign * 0.08, 0.046)
    assert within.acceptable and within.measured and not within.advice


@pytest.mark.slow
@pytest.mark.parametrize("x_px", [0.0, 2.0, -2.0])
def test_an_error_that_the_motion_cannot_tell_is_in_what_it_measured(x_px: float) -> None:
    drawn = drawn_dive(affine(x_px=x_px))
    found = checked(drawn)
    assert found.acceptable and found.measured and not found.measured.is_sure
    assert abs(drawn.range_error) < 2 * found.measured.rms


@pytest.mark.slow
def test_without_motion_what_rows_show_is_named_alone() -> None:
    drawn = drawn_dive(affine(x_px=6, scale=1.02))
    found = find_causes(drawn.rig, drawn.matches)
    assert found.best and RIGHT in found.line and LEFT in found.line and ALONG not in found.line


def test_points_in_one_place_tell_nothing() -> None:
    drawn = drawn_dive(points=2)
    assert find_causes(drawn.rig, drawn.matches).line == ""
    assert np.isfinite(drawn.range_error)
