"""Pairs of open water and even sand among others: a picture at the dive's typical range, marked,
and no range.
"""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from conftest import Dive

CODES = {"interpolate": 2, "black": 1}


def open_water(path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = cv2.imread(str(path))
    smooth = np.linspace(110, 70, image.shape[0])[:, None, None] * np.array(
        [1.0, 0.9, 0.5]
    ) + np.zeros(image.shape)
    cv2.imwrite(str(path), np.clip(smooth + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8))


@pytest.fixture
def dive(make_dive: Callable[..., Dive]) -> Dive:
    made = make_dive(3)
    for seed, side in enumerate("LR"):
        open_water(made.root / side / "0001.png", seed)
    return made


@pytest.mark.slow
@pytest.mark.parametrize("unknown", CODES)
def test_a_pair_of_open_water_is_done_and_marked(
    dive: Dive, unknown: str, cli, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    words = [
        "--strict",
        "--json",
        "--set",
        "color.lock=survey",
        "--set",
        f"color.unknown_pixels={unknown}",
    ]
    code, printed, _ = cli(*dive.command(out, *words))
    assert code == 0
    assert json.loads(printed)["ok"] == 3
    assert np.isnan(tifffile.imread(out / "range/0001.tiff")).all()
    assert not cv2.imread(str(out / "confidence/0001.png"), cv2.IMREAD_GRAYSCALE).any()
    assert (cv2.imread(str(out / "mask/0001.png"), cv2.IMREAD_GRAYSCALE) == CODES[unknown]).all()
    corrected, raw = (
        cv2.imread(str(path)).astype(float)
        for path in (out / "corrected/0001.png", dive.root / "L/0001.png")
    )
    warned = (out / "frames.csv").read_text()
    assert "both images show too little texture to match" in warned
    assert ("corrected for 1." in warned) == (unknown == "interpolate")
    if unknown == "black":
        assert not corrected.any()
    else:  # the red that 1.5 m of this water take is given back
        assert (
            corrected[..., 2].mean() / corrected[..., 1].mean()
            > 1.2 * raw[..., 2].mean() / raw[..., 1].mean()
        )
        known_m = tifffile.imread(out / "range/0000.tiff")
        typical_m = json.loads((out / "water.json").read_text())["water"]["typical_range_m"]
        assert typical_m == pytest.approx(np.nanmedian(known_m), rel=0.05)


@pytest.mark.slow
def test_a_dive_of_nothing_but_open_water_says_so(dive: Dive, cli, tmp_path: Path) -> None:
    for seed, path in enumerate(sorted(dive.root.rglob("*.png"))):
        open_water(path, seed)
    code, _, said = cli(*dive.command(tmp_path / "out"))
    assert code == 1
    assert sum("known range" in line for line in said.splitlines()) == 1
    assert "(is it all open water?)" in said
