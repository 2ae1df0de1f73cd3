"""A dive lit by the rig's own lamps: their pattern is learned from the dive and taken out before the water is fitted."""

import cv2
import numpy as np
import pytest

from stereo_seecolor.commands.run import run
from stereo_seecolor.config_file import load_config


def unevenness(folder, names) -> float:  # type: ignore[no-untyped-def]
    """Spread of the dive's mean brightness over the picture, relative to its mean, in linear light."""
    shown = np.mean([cv2.imread(str(folder / f"{name}.png")).mean(axis=2) for name in names], axis=0)[16:-16, 32:-16]
    parts = cv2.resize((shown / 255) ** 2.2, (6, 4), interpolation=cv2.INTER_AREA)
    return float(parts.std() / parts.mean())


@pytest.mark.slow
def test_lamps_are_learned_and_taken_out(make_dive, tmp_path) -> None:
    dive = make_dive(16)
    height, width = dive.range_m.shape
    y, x = np.mgrid[:height, :width]
    lamp = np.exp(-(((x - width / 2) / (0.45 * width)) ** 2) - ((y - height / 2) / (0.45 * height)) ** 2)
    lamp *= (dive.range_m.min() / dive.range_m) ** 2
    for path in dive.root.glob("?/*.png"):
        light = (cv2.imread(str(path)) / 255.0) ** 2.2 * lamp[..., None]
        cv2.imwrite(str(path), np.round(light ** (1 / 2.2) * 255).astype(np.uint8))
    sides = (dive.root / "L", dive.root / "R", dive.root / "cam.yaml")
    names = [f"{i:04d}" for i in range(16)]
    spread = {}
    for lights in ("none", "learn"):
        config = load_config(None, [f"color.lights={lights}", "color.lock=survey"])
        assert run(*sides, tmp_path / lights, config).all_done
        spread[lights] = unevenness(tmp_path / lights / "corrected", names)
    assert spread["learn"] < 0.5 * spread["none"], spread
