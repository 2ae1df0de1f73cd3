"""The examples of CONTRIBUTING.md do what they say."""

import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from stereo_seecolor import Corrector, StereoFrame
from stereo_seecolor.config import ColorConfig, MatchingConfig
from stereo_seecolor.files.srgb import encode_srgb

CONTRIBUTING = Path(__file__).resolve().parents[2] / "CONTRIBUTING.md"


def example(title: str) -> dict[str, Any]:
    """The names that the example of a section defines."""
    section = CONTRIBUTING.read_text(encoding="utf-8").split(f"### {title}\n")[1].split("\n### ")[0]
    names: dict[str, Any] = {}
    exec(re.findall(r"```python\n(.*?)```", section, re.DOTALL)[0], names)
    return names


def test_the_matching_engine_finds_the_disparity() -> None:
    rng = np.random.default_rng(0)
    texture = cv2.GaussianBlur(rng.integers(0, 256, (120, 260), np.uint8), (0, 0), 1.2)
    left, right = (np.repeat(texture[:, at : at + 200, None], 3, axis=2) for at in (0, 24))
    engine = example("A matching engine")["Blocks"](MatchingConfig(), 5, 60)
    found = engine.find(StereoFrame("a", left, right), None).disparity
    assert np.isfinite(found).mean() > 0.4
    assert np.nanmedian(found) == pytest.approx(24, abs=0.2)


def test_the_color_method_finds_the_attenuation() -> None:
    rate = np.array([0.6, 0.25, 0.1])
    range_m = np.tile(np.linspace(1, 3, 200, dtype=np.float32), (100, 1))
    light = 0.8 * np.exp(-rate * range_m[..., None])
    image = np.rint(255 * encode_srgb(light)).astype(np.uint8)
    table = Corrector().measure(image, range_m)
    water = example("A color method")["fit"](table, ColorConfig())
    np.testing.assert_allclose(water.y, rate, rtol=0.03)
    np.testing.assert_allclose(water.white, 0.8, rtol=0.03)
