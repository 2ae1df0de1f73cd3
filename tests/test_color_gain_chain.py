"""Gains of all frames of a long dive: what the frames differ by comes back, also outside the part that gives the pattern."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calibration import Rectification
from calibration.formats import load_rig
from stereo_seecolor import dive_light
from stereo_seecolor.color.photometry.gain_chain import Difference, solve_chain
from stereo_seecolor.color.photometry.light_solver import Use
from stereo_seecolor.dive_light import LightSearch, SampleSettings
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.records import Image, Map

REEF = Path(__file__).parents[1] / "data_samples" / "reef"
FRAMES = 400


def chained(gains: NDArray[np.float64], noise: float, wrong: int = 0) -> list[Difference]:
    """What frames one, two and four apart differ by: (F,) gains of luminance, none of color."""
    rng, found = np.random.default_rng(1), []
    for i in range(FRAMES):
        for j in (i - 1, i - 2, i - 4):
            if j >= 0:
                whole, fitted, judged = (gains[i] - gains[j] + rng.normal(0, noise) for _ in range(3))
                medians = [np.array([value, 0.0, 0.0, 0.0]) for value in (whole, fitted, judged)]
                found.append(Difference(i, j, *medians, np.full(4, 0.3), 400))
    for k in rng.choice(len(found), wrong, replace=False):
        found[k].whole[0] += 1.0
    return found


def varying() -> NDArray[np.float64]:
    gains = 0.2 * np.random.default_rng(2).standard_normal(FRAMES)
    return np.asarray(gains - gains.mean())


def test_gains_of_all_frames_come_back() -> None:
    gains = varying()
    chain = solve_chain(chained(gains, 0.02, wrong=20), FRAMES)
    assert np.abs(chain.gains - gains[:, None]).max() < 0.12
    assert np.abs(chain.gains - gains[:, None]).std() < 0.04
    assert chain.measured.all()
    assert chain.offsets[1] < 0.2 * chain.offsets[0]


def test_frames_that_nothing_was_held_against_have_no_gain() -> None:
    gains = varying()
    apart = [d for d in chained(gains, 0.02) if not {d.i, d.j} & {100, 101, 102, 103, 104}]
    chain = solve_chain(apart, FRAMES)
    assert list(np.flatnonzero(~chain.measured)) == [100, 101, 102, 103, 104]
    assert np.abs(chain.gains[~chain.measured]).max() < 0.02
    assert np.abs(chain.gains - gains[:, None])[chain.measured].std() < 0.05


@pytest.mark.parametrize("found", [chained(np.zeros(FRAMES), 0.02), []])
def test_noise_is_no_gain(found: list[Difference]) -> None:
    assert not solve_chain(found, FRAMES).gains.any()


def test_gains_that_were_chosen_with_the_pattern_are_used() -> None:
    gains = 0.05 * varying()  # offsets too small to be worth it by themselves
    found = chained(gains, 0.002)
    assert not solve_chain(found, FRAMES).gains.any()
    np.testing.assert_allclose(solve_chain(found, FRAMES, (True, False)).gains, np.repeat(gains[:, None], 3, axis=1), atol=0.02)


@pytest.mark.slow
def test_frames_outside_the_part_that_the_pattern_is_solved_from_get_gains(monkeypatch: pytest.MonkeyPatch) -> None:
    """The sample dive, its frames exposed by known factors; two stretches of five of its twelve frames are looked at first."""
    monkeypatch.setattr(dive_light, "SAMPLE", SampleSettings(most_frames=10))
    rectification = Rectification.from_rig(load_rig(REEF / "cam.yaml"))
    names = sorted(path.stem for path in (REEF / "left").iterdir())
    gains = dict(zip(names, np.random.default_rng(3).uniform(-0.4, 0.0, len(names)), strict=True))

    def read(name: str) -> tuple[Image, Map]:
        light = decode_srgb(rectification.apply_left(read_image(REEF / "left" / f"{name}.png")) / 255.0) * np.exp(gains[name])
        image = np.round(255 * encode_srgb(light)).astype(np.uint8)
        return image, read_range_map(REEF / "truth" / "range" / f"{name}.tiff")

    frames = [(name, lambda name=name: read(name)) for name in names]
    found = LightSearch(frames, rectification.pair, "srgb").solve(Use(pattern=True, ranged=True, gains=True))
    assert found.light is not None
    assert found.light.light is not None
    assert f"a gain for each of {len(names)} frames" in found.light.note
    true = np.array([gains[name] for name in names])
    measured = np.array([found.light.light.gains[name].mean() for name in names])
    assert np.abs(measured - (true - true.mean())).max() < 0.08
    assert found.linked == tuple(names[1:])
