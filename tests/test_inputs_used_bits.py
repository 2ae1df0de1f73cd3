"""Sensors of 10, 12 or 14 bits whose values lie at the lower end of 16-bit files."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_seecolor.commands.run import run
from stereo_seecolor.config import InputConfig
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.inputs.used_bits import with_used_bits


def pair(folder: Path, name: str, brightest: int, dtype: type = np.uint16) -> Pair:
    for side in "lr":
        pixels = np.linspace(0, brightest, 300).round().astype(dtype).reshape(15, 20)
        cv2.imwrite(str(folder / f"{name}_{side}.png"), pixels)
    return Pair(name, folder / f"{name}_l.png", folder / f"{name}_r.png")


@pytest.mark.parametrize(("brightest", "bits"), [(1000, 10), (1023, 10), (3000, 12), (16383, 14), (16384, None), (200, None)])
def test_the_brightest_value_tells(tmp_path: Path, brightest: int, bits: int | None) -> None:
    sample = [pair(tmp_path, "dark", 300), pair(tmp_path, "bright", brightest)]
    if brightest == 200:
        sample = sample[1:]  # black: nothing can be told
    assert with_used_bits(InputConfig(), sample).significant_bits == bits


def test_eight_bits_and_what_is_set_stay(tmp_path: Path) -> None:
    assert with_used_bits(InputConfig(), [pair(tmp_path, "a", 255, np.uint8)]).significant_bits is None
    deep = pair(tmp_path, "b", 1000)
    assert with_used_bits(InputConfig(significant_bits=None), [deep]).significant_bits is None
    assert with_used_bits(InputConfig(significant_bits=14), [deep]).significant_bits == 14
    deep.left.write_bytes(b"")
    assert with_used_bits(InputConfig(), [deep]).significant_bits == 10


def test_a_dive_of_ten_bits_runs_as_it_is(make_dive, tmp_path: Path) -> None:
    """Unscaled, its brightest pixel would be 1.6 % of white, and the left image "black"."""
    dive = make_dive(1, dtype=np.uint16)
    for path in dive.root.glob("[LR]/*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED) >> 6)
    summary = run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out")
    assert [row.status for row in summary.rows] == ["ok"]
    assert json.loads((tmp_path / "out" / "run.json").read_text())["config"]["input"]["significant_bits"] == 10
    range_m = cv2.imread(str(tmp_path / "out" / "range" / "0000.tiff"), cv2.IMREAD_UNCHANGED)
    error = np.abs(range_m / dive.range_m - 1)
    assert np.nanmedian(error) < 0.01
    assert np.isfinite(range_m).mean() > 0.7
