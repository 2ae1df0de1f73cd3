"""Images that hold blue in the place of red are named, and read as the settings say."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from color_waters import clear_water

from stereo_seecolor.checks.channel_order import channel_order
from stereo_seecolor.checks.fitted_water import channel_order_notes
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.config import InputConfig, RunConfig
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import Pair

VEILS = {
    "clear": ((0.003, 0.015, 0.034), (0.60, 0.21, 0.11)),
    "strobe": ((0.024, 0.026, 0.035), (0.57, 0.13, 0.09)),
    "yellow": ((0.050, 0.080, 0.001), (0.60, 0.50, 1.40)),
}


@pytest.mark.parametrize("name", VEILS)
def test_exchanged_channels_are_named(name: str) -> None:
    veil, attenuation = map(np.array, VEILS[name])
    given = replace(clear_water("srgb"), gamma_inf=veil, beta=attenuation)
    exchanged = replace(given, gamma_inf=veil[::-1], beta=attenuation[::-1])
    assert channel_order_notes({"a": given, "b": given}) == ()
    named = channel_order_notes({"a": exchanged, "b": exchanged})
    assert len(named) == (name != "yellow")  # of which both orders may be
    assert all("set input.channels=bgr" in line for line in named)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_channels_are_read_as_the_settings_say(tmp_path: Path, suffix: str) -> None:
    image = np.random.default_rng(0).integers(0, 60000, (20, 30, 3)).astype(np.uint16)
    cv2.imwrite(str(tmp_path / f"a{suffix}"), image)
    np.testing.assert_array_equal(
        read_image(tmp_path / f"a{suffix}", InputConfig(channels="bgr")), image
    )


@pytest.mark.parametrize("exchanged", [(), range(17, 40), range(8, 23)])
def test_the_image_is_named_from_which_on_red_and_blue_are_exchanged(
    tmp_path: Path, exchanged: Sequence[int]
) -> None:
    """Of a dive of changing light, exposure and scene."""
    rng, pairs = np.random.default_rng(2), []
    for number in range(40):
        scene = rng.uniform(0.3, 1.0, (24, 32, 1)) * [30 + number, 90, 120] * rng.uniform(0.7, 1.4)
        image = np.clip(scene * rng.uniform(0.9, 1.1, (24, 32, 3)), 0, 255).astype(np.uint8)
        path = tmp_path / f"{number:04d}.png"
        cv2.imwrite(str(path), image if number in exchanged else image[..., ::-1])
        pairs.append(Pair(path.stem, path, path))
    notes = channel_order(DiveImages(pairs, RunConfig())).notes
    assert len(notes) == bool(exchanged)
    last = "and the following images" if exchanged and exchanged[-1] == 39 else "to 0022.png"
    assert all(f"{exchanged[0]:04d}.png {last}" in line for line in notes)
