"""Gains of all frames of a long dive: what the frames differ by comes back, also outside the part
that gives the pattern.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from small_dives import write_short_reef

from calibration import Rectification
from calibration.formats import load_rig
from stereo_seecolor.checks.exposure import recorded_exposure_notes
from stereo_seecolor.color.photometry.light_of_frames import (
    ACROSS,
    MEAN,
    PART,
    Differences,
    solve_frames,
)
from stereo_seecolor.color.photometry.light_solver import LightTerms
from stereo_seecolor.color.photometry.recorded_exposure import (
    explain,
    is_informative,
    log_exposures,
    misread,
    offsets_about,
)
from stereo_seecolor.color.photometry.survey_light import SurveyLight
from stereo_seecolor.color.response.response import Response
from stereo_seecolor.color.table.encoding import InputEncoding
from stereo_seecolor.commands.run import run
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive import light_search
from stereo_seecolor.dive.light_search import LightSearch, SampleSettings
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.files.encode import encode_image
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.records import Capture, Image, Map

REEF = Path(__file__).parents[2] / "data_samples" / "reef"
FRAMES = 400
ALL = LightTerms(pattern=True, ranged=True, gains=True)
RECTIFICATION = Rectification.from_rig(load_rig(REEF / "cam.yaml"))
HALF = RECTIFICATION.pair.reduced(2)


NO_SHADING = False, False


def chained(gains: NDArray[np.float64], noise: float, wrong: int = 0) -> Differences:
    """What frames one, two and four apart differ by: (F,) gains of luminance, none of color. The
    reef is even.
    """
    rng, found = np.random.default_rng(1), []
    for i in range(FRAMES):
        for j in (i - 1, i - 2, i - 4):
            for held in (False, True) if j >= 0 else ():
                value = gains[i] - gains[j] + rng.normal(0, noise)
                at = 15 * (i - j)
                found.append((i, j, (0, at), (0, -at), (value, 0, 0, 0), 200, held))
    parts = np.array(found, PART)
    parts["value"][rng.choice(len(found), wrong, replace=False), 0] += 1.0
    means = [(frame, (gain, 0, 0, 0)) for frame, gain in enumerate(gains)]
    return Differences(parts, np.array(means, MEAN))


def without(found: Differences, frames: Sequence[int]) -> Differences:
    """As if these frames showed nothing that others show."""
    parts, means = found
    kept = ~np.isin(parts["i"], frames) & ~np.isin(parts["j"], frames)
    return Differences(parts[kept], means[~np.isin(means["frame"], frames)])


NOTHING = Differences(np.zeros(0, PART), np.zeros(0, MEAN))


def varying() -> NDArray[np.float64]:
    gains = 0.2 * np.random.default_rng(2).standard_normal(FRAMES)
    return np.asarray(gains - gains.mean())


def test_gains_of_all_frames_come_back() -> None:
    gains = varying()
    chain = solve_frames(chained(gains, 0.02, wrong=20), np.zeros(FRAMES), NO_SHADING)
    assert np.abs(chain.gains - gains[:, None]).max() < 0.12
    assert np.abs(chain.gains - gains[:, None]).std() < 0.04
    assert chain.measured.all()
    assert chain.offsets[1] < 0.5 * chain.offsets[0]  # the wrong ones among them


def test_frames_that_nothing_was_held_against_have_no_gain() -> None:
    gains = varying()
    found = chained(gains, 0.02)
    cut = [100, 101, 102, 103, 104]
    chain = solve_frames(without(found, cut), np.zeros(FRAMES), NO_SHADING)
    assert list(np.flatnonzero(~chain.measured)) == [100, 101, 102, 103, 104]
    assert np.abs(chain.gains[~chain.measured]).max() < 0.02
    assert np.abs(chain.gains - gains[:, None])[chain.measured].std() < 0.05


def test_an_exposure_that_stays_changed_is_followed_to_the_end() -> None:
    """Halved after a third of the dive."""
    gains = np.where(np.arange(FRAMES) < FRAMES // 3, 0.0, np.log(0.5))
    chain = solve_frames(chained(gains, 0.002), np.zeros(FRAMES), NO_SHADING)
    np.testing.assert_allclose(chain.gains[:, 0], gains - gains.mean(), atol=0.05)


def test_a_reef_that_changes_for_good_is_not_evened_out() -> None:
    """Sand, then corals of half its light, at one exposure."""
    found = chained(np.zeros(FRAMES), 0.002)
    found.means["light"][FRAMES // 3 :, 0] += np.log(0.5)
    chain = solve_frames(found, np.zeros(FRAMES), NO_SHADING, chosen=(True, False))
    assert np.abs(chain.gains).max() < 0.05


@pytest.mark.slow
def test_an_error_of_the_pattern_along_the_track_is_no_drift_of_gains() -> None:
    found, slope = chained(np.zeros(FRAMES), 0.002), 0.03
    along = (found.parts["at_i"][:, 1].astype(float) - found.parts["at_j"][:, 1]) / ACROSS
    found.parts["value"][:, 0] += slope * along
    certain, free = (
        solve_frames(found, np.zeros(FRAMES), NO_SHADING, (error, 0.0), (True, False))
        for error in (0.0, 0.05)
    )
    assert np.ptp(certain.gains) > 1.0
    assert np.ptp(free.gains) < 0.05
    np.testing.assert_allclose(free.slopes, [[0.0] * 3, [slope] * 3], atol=0.002)


def test_gains_that_do_not_help_the_patches_left_out_are_not_used() -> None:
    """The half that judges is of frames that do not differ."""
    found = chained(varying(), 0.02)
    found.parts["value"][found.parts["held"]] = 0.0
    assert not solve_frames(found, np.zeros(FRAMES), NO_SHADING, chosen=(True, False)).gains.any()


@pytest.mark.parametrize("found", [chained(np.zeros(FRAMES), 0.02), NOTHING])
def test_noise_is_no_gain(found: Differences) -> None:
    assert not solve_frames(found, np.zeros(FRAMES), NO_SHADING).gains.any()


@pytest.mark.slow
def test_gains_that_were_chosen_with_the_pattern_are_used() -> None:
    gains = 0.05 * varying()  # offsets too small to be worth it by themselves
    found = chained(gains, 0.002)
    assert not solve_frames(found, np.zeros(FRAMES), NO_SHADING).gains.any()
    np.testing.assert_allclose(
        solve_frames(found, np.zeros(FRAMES), NO_SHADING, chosen=(True, False)).gains,
        np.repeat(gains[:, None], 3, axis=1),
        atol=0.02,
    )


@cache
def half_light(name: str) -> NDArray[np.float64]:
    """Linear light of a left image of the sample dive, rectified, at half its size."""
    image = RECTIFICATION.apply_left(read_image(REEF / "left" / f"{name}.png"))
    return np.asarray(decode_srgb(image / 255.0)[::2, ::2])


@dataclass(frozen=True)
class DrawnDive:
    """The sample dive at half its size, its frames darkened by (12,) log_gains; its files in sRGB
    or linear light, read as either.
    """

    log_gains: NDArray[np.float64]
    is_linear: bool = False
    read_as: InputEncoding = "srgb"

    @property
    def names(self) -> list[str]:
        return sorted(path.stem for path in (REEF / "left").iterdir())

    def read(self, name: str) -> tuple[Image, Map]:
        light = half_light(name) * np.exp(self.log_gains[self.names.index(name)])
        range_m = read_range_map(REEF / "truth" / "range" / f"{name}.tiff")[::2, ::2]
        values = np.round(255 * (light if self.is_linear else encode_srgb(light))).astype(np.uint8)
        return Response(self.read_as).standard(values), np.ascontiguousarray(range_m)

    def light(
        self,
        recorded: NDArray[np.float64],
        blank: tuple[int, ...] = (),
    ) -> SurveyLight | None:
        """What is found where the camera recorded exposures of the logarithms ``recorded``;
        ``blank`` frames have no ranges.
        """
        captures = [Capture(exposure_s=0.01 * np.exp(value), gain=2.0) for value in recorded]
        frames = [
            (name, partial(self._seen, name, k in blank)) for k, name in enumerate(self.names)
        ]
        return (
            LightSearch(
                frames,
                lambda read: read(),
                captures,
                HALF,
                "srgb",
                Threads(2),
                files=self.read_as,
            )
            .solve(ALL)
            .light
        )

    def _seen(self, name: str, blank: bool) -> tuple[Image, Map]:
        image, range_m = self.read(name)
        return image, np.full_like(range_m, np.nan) if blank else range_m


def log_gains_of(dive: DrawnDive, found: SurveyLight | None) -> NDArray[np.float64]:
    """Of the frames, of mean 0; NaN for frames without."""
    assert found is not None
    assert found.light is not None
    gains = [found.light.gains.get(name, np.full(3, np.nan)).mean() for name in dive.names]
    return np.asarray(gains - np.nanmean(gains))


def exposures() -> NDArray[np.float64]:
    drawn = np.random.default_rng(5).uniform(-1.4, 0.0, 12)
    return np.asarray(drawn - drawn.max())


@pytest.mark.slow
def test_recorded_exposures_give_the_gains_also_of_frames_without_overlap() -> None:
    true = exposures()
    dive = DrawnDive(true)
    found = dive.light(true, blank=(4,))
    assert found is not None
    assert found.recorded
    assert "the exposures that the camera recorded are used" in found.note
    np.testing.assert_allclose(log_gains_of(dive, found), true - true.mean(), atol=0.06)
    assert found.offsets is not None
    assert found.offsets[1] < 0.1 * found.offsets[0]


@pytest.mark.slow
def test_two_frames_are_enough_for_gains() -> None:
    true = np.array([0.0, -0.5])
    dive = DrawnDive(true)
    frames = [(name, partial(dive.read, name)) for name in dive.names[:2]]
    found = (
        LightSearch(frames, lambda read: read(), [Capture()] * 2, HALF, "srgb", Threads(2))
        .solve(ALL)
        .light
    )
    assert found is not None
    assert found.light is not None
    gains = np.array([found.light.gains[name].mean() for name in dive.names[:2]])
    np.testing.assert_allclose(gains, true - true.mean(), atol=0.04)
    assert "different exposure of frames" in found.note


@pytest.mark.slow
def test_exposures_that_are_recorded_wrongly_change_nothing() -> None:
    true = exposures()
    dive = DrawnDive(true)
    wrong = np.random.default_rng(6).permutation(true)
    found, alone = dive.light(wrong), dive.light(np.zeros(12))
    assert found is not None
    assert alone is not None
    assert not found.recorded
    assert found.content() == alone.content()
    assert re.search(
        r"the camera recorded are not used: frames of one spot differ by \d+ % with them, \d+ % "
        r"without$",
        found.note,
    )
    assert "recorded" not in alone.note


@pytest.mark.slow
def test_one_frame_whose_exposure_is_recorded_wrongly_is_corrected_by_its_neighbors() -> None:
    true = exposures()
    dive = DrawnDive(true)
    wrong = true.copy()
    wrong[6] += 0.7
    found = dive.light(wrong)
    assert found is not None
    assert found.recorded
    np.testing.assert_allclose(log_gains_of(dive, found), true - true.mean(), atol=0.15)


@pytest.mark.slow
def test_a_run_uses_the_exposures_of_its_table(tmp_path: Path) -> None:
    true = exposures()
    names = DrawnDive(true).names
    write_short_reef(tmp_path, range(len(names)))
    for side in ("left", "right"):
        for name, log_gain in zip(names, true, strict=True):
            path = tmp_path / side / f"{name}.png"
            light = decode_srgb(read_image(path) / 255.0) * np.exp(log_gain)
            image = np.round(255 * encode_srgb(light)).astype(np.uint8)
            path.write_bytes(encode_image(image, "png"))
    rows = [f"{name},{10 * np.exp(value):.6f}" for name, value in zip(names, true, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["name,exposure_ms", *rows]))
    config = load_config(None, [f"input.exposures={tmp_path / 'log.csv'}"])
    summary = run(
        tmp_path / "left",
        tmp_path / "right",
        tmp_path / "cam.yaml",
        tmp_path / "out",
        config,
        RunOptions(page="none"),
    )
    assert any("exposures that the camera recorded are used" in note for note in summary.notes)
    gains = [row.facts["light_gain"] for row in summary.rows]
    np.testing.assert_allclose(np.log(gains), true - true.mean(), atol=0.01)


def test_records_behind_a_strobe_change_nothing() -> None:
    """The flash is shorter than any exposure time: frames are alike whatever is recorded."""
    recorded = varying()
    assert not explain(offsets_about(chained(np.zeros(FRAMES), 0.02).parts, recorded))
    assert explain(offsets_about(chained(recorded, 0.02).parts, recorded))
    assert not explain(offsets_about(NOTHING.parts, recorded))


@pytest.mark.parametrize(
    ("altered", "said"),
    [
        (lambda true: -true, "as reciprocals (60 for 1/60 s)"),
        (lambda true: np.roll(true, 1), "as those of 1 frame after"),
        (lambda true: np.roll(true, -2), "as those of 2 frames before"),
        (lambda true: np.random.default_rng(8).permutation(true), ""),
    ],
)
def test_records_that_are_read_wrongly_are_named(
    altered: Callable[[NDArray[np.float64]], NDArray[np.float64]], said: str
) -> None:
    true = np.random.default_rng(7).normal(0, 0.4, FRAMES)
    reading = misread(chained(true, 0.02).parts, altered(true))
    whole = f"read {said} they would explain the differences: correct the table"
    assert reading == (whole if said else "")


@pytest.mark.slow
@pytest.mark.parametrize("is_linear", [True, False])
@pytest.mark.parametrize("read_as", ["srgb", "linear"])
def test_records_of_a_dive_in_the_other_encoding_are_not_used(
    is_linear: bool, read_as: InputEncoding
) -> None:
    true, encoding = exposures(), "linear" if is_linear else "srgb"
    found = DrawnDive(true, is_linear, read_as).light(true)
    assert found is not None
    assert found.recorded == (read_as == encoding)
    said = f"with color.input_encoding={encoding} they would explain the differences"
    assert found.note.endswith(said) == (read_as != encoding)


def test_exposures_longer_than_the_time_between_frames_and_few_names_are_said() -> None:
    captures = [Capture(exposure_s=16.7)] * 3 + [Capture()]
    names, unit = recorded_exposure_notes(captures, [0.0, 1.0, 2.0, 3.0], has_table=True)
    assert "names the files of 3 of 4 pairs" in names
    assert "16.7 s (median), are longer than the 1 s between frames" in unit
    right = [Capture(exposure_s=0.0167)] * 4
    assert recorded_exposure_notes(right, [0.0, 1.0, None, 3.0], has_table=True) == ()
    assert recorded_exposure_notes([Capture()] * 4, [None] * 4, has_table=False) == ()


def test_gains_are_solved_about_the_records() -> None:
    """The records hold but for one frame, and one shows nothing that others show."""
    recorded = varying()
    gains = recorded.copy()
    gains[200] += 0.8
    found = chained(gains, 0.02)
    chain = solve_frames(without(found, [100]), recorded, NO_SHADING)
    np.testing.assert_allclose(chain.gains[100], recorded[100], atol=0.02)
    assert np.abs(chain.gains - gains[:, None]).max() < 0.12
    assert chain.measured.all()
    assert chain.offsets[1] < 0.2 * chain.offsets[0]


def test_logarithms_of_recorded_exposures() -> None:
    captures = [
        Capture(0.01, 1.0, 4.0),
        Capture(0.02, 1.0, 4.0),
        Capture(0.01, 4.0, 4.0),
        Capture(0.01, 1.0, 8.0),
    ]
    logs = log_exposures(captures)
    np.testing.assert_allclose(logs - logs[0], np.log([1, 2, 4, 0.25]))
    some = log_exposures([*captures, Capture(gain=1.0, aperture=4.0), Capture()])
    np.testing.assert_allclose(
        some, [*logs, 0, 0], err_msg="frames that lack what others recorded are taken as usual ones"
    )
    assert not is_informative(log_exposures([Capture()] * 3))
    assert not is_informative(log_exposures([Capture(0.01)] * 3))
    assert is_informative(logs)


@pytest.mark.slow
def test_frames_outside_the_part_that_the_pattern_is_solved_from_get_gains(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The sample dive, its frames exposed by known factors; two segments of five of its twelve
    frames are looked at first.
    """
    monkeypatch.setattr(light_search, "SAMPLE", SampleSettings(most_frames=10))
    true = np.random.default_rng(3).uniform(-0.4, 0.0, 12)
    dive = DrawnDive(true)
    names = dive.names
    frames = [(name, name) for name in names]
    found = LightSearch(
        frames, dive.read, [Capture()] * len(frames), HALF, "srgb", Threads(2)
    ).solve(ALL)
    assert found.light is not None
    assert found.light.light is not None
    assert "different exposure of frames" in found.light.note
    measured = np.array([found.light.light.gains[name].mean() for name in names])
    assert np.abs(measured - (true - true.mean())).max() < 0.08
    assert tuple(found.linked) == tuple(names[1:])


@pytest.mark.parametrize("parts", [1, 2, 50])
@pytest.mark.parametrize("numbers", [range(12), range(200), light_search.sampled_frames(500)])
def test_segments_hold_every_frame_once_and_all_that_it_is_held_against(
    numbers: Sequence[int], parts: int
) -> None:
    length = light_search.SEGMENTS.length(len(numbers), parts)
    segments = list(light_search._Segments(numbers, [(str(k), k) for k in range(500)], length))
    assert min(parts, len(numbers) // 15) <= len(segments) <= max(parts, len(numbers) // 15)
    assert [
        number for segment in segments for number, _ in segment.frames[segment.before :]
    ] == list(numbers)
    for segment in segments:
        inside = [number for number, _ in segment.frames]
        for number in inside[segment.before :]:
            assert {number - back for back in light_search.LOOK.back} & set(numbers) <= set(inside)
