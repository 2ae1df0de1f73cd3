"""Raw images: color filter patterns, and sensors of 10, 12 or 14 bits whose values lie at the lower
end of 16-bit files.
"""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_seecolor.commands.run import correct, run
from stereo_seecolor.config import InputConfig
from stereo_seecolor.inputs.file_form import as_stored, stored_facts, stored_notes
from stereo_seecolor.inputs.pairing import Pair, pair_folders

REEF = Path(__file__).parents[2] / "data_samples" / "reef"


def pair(folder: Path, name: str, brightest: int, dtype: type = np.uint16) -> Pair:
    for side in "lr":
        pixels = np.linspace(0, brightest, 300).round().astype(dtype).reshape(15, 20)
        cv2.imwrite(str(folder / f"{name}_{side}.png"), pixels)
    return Pair(name, folder / f"{name}_l.png", folder / f"{name}_r.png")


def settled(config: InputConfig, sample: list[Pair]) -> InputConfig:
    return as_stored(config, stored_facts(config, sample))


@pytest.mark.parametrize(
    ("brightest", "bits"),
    [(1000, 10), (1023, 10), (3000, 12), (16383, 14), (16384, None), (200, None)],
)
def test_the_brightest_value_tells(tmp_path: Path, brightest: int, bits: int | None) -> None:
    sample = [pair(tmp_path, "dark", 300), pair(tmp_path, "bright", brightest)]
    if brightest == 200:
        sample = sample[1:]  # black: nothing can be told
    assert settled(InputConfig(), sample).significant_bits == bits


def test_eight_bits_and_what_is_set_stay(tmp_path: Path) -> None:
    assert settled(InputConfig(), [pair(tmp_path, "a", 255, np.uint8)]).significant_bits is None
    deep = pair(tmp_path, "b", 1000)
    assert settled(InputConfig(significant_bits=None), [deep]).significant_bits is None
    assert settled(InputConfig(significant_bits=14), [deep]).significant_bits == 14
    shifted = pair(tmp_path, "c", 100)
    for path in (shifted.left, shifted.right):
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED) * 16)
    assert settled(InputConfig(), [shifted]).significant_bits is None  # a dark dive
    deep.left.write_bytes(b"")
    assert settled(InputConfig(), [deep]).significant_bits == 10


@pytest.mark.slow
def test_a_dive_of_ten_bits_runs_as_it_is(make_dive, tmp_path: Path) -> None:
    """Unscaled, its brightest pixel would be 1.6 % of white, and the left image "black"."""
    dive = make_dive(1, dtype=np.uint16)
    for path in dive.root.glob("[LR]/*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path), cv2.IMREAD_UNCHANGED) >> 6)
    summary = run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out")
    assert [row.status for row in summary.rows] == ["ok"]
    assert (
        json.loads((tmp_path / "out" / "run.json").read_text())["config"]["input"][
            "significant_bits"
        ]
        == 10
    )
    range_m = cv2.imread(str(tmp_path / "out" / "range" / "0000.tiff"), cv2.IMREAD_UNCHANGED)
    error = np.abs(range_m / dive.range_m - 1)
    assert np.nanmedian(error) < 0.01
    assert np.isfinite(range_m).mean() > 0.7
    colored = correct(dive.root / "L", tmp_path / "out" / "range", tmp_path / "colors")
    assert "input: the 16-bit images hold 10 bits, which are scaled to 16" in colored.notes


def mosaic_of(bgr: np.ndarray, pattern: str) -> np.ndarray:
    channels = ["bgr".index(letter) for letter in pattern]
    raw = np.empty(bgr.shape[:2], bgr.dtype)
    for place, channel in enumerate(channels):
        y, x = divmod(place, 2)
        raw[y::2, x::2] = bgr[y::2, x::2, channel]
    return raw


@pytest.mark.parametrize("noise", [0, 8])
def test_a_raw_left_camera_of_faint_colors_beside_a_monochrome_one(
    tmp_path: Path, noise: float
) -> None:
    """As a strobe-lit reef: red and blue differ from green by a tenth, less than neighboring pixels
    do.
    """
    rng = np.random.default_rng(2)
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for path in sorted((REEF / side).glob("*.png"))[:2]:
            gray = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2GRAY)[..., None] * np.array(
                [0.95, 1.0, 0.9]
            )
            seen = np.clip(gray + rng.normal(0, noise, gray.shape), 0, 255).astype(np.uint8)
            cv2.imwrite(
                str(tmp_path / side / path.name),
                mosaic_of(seen, "rggb") if side == "left" else seen[..., 1],
            )
    found = pair_folders(tmp_path / "left", tmp_path / "right", InputConfig()).pairs
    assert settled(InputConfig(), found).bayer == "rggb"
    swapped = [Pair(one.name, one.right, one.left) for one in found]
    assert settled(InputConfig(), swapped).bayer == "none"


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_raw_dive_is_read_in_color(tmp_path: Path, pattern: str) -> None:
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for path in sorted((REEF / side).glob("*.png"))[:2]:
            cv2.imwrite(str(tmp_path / side / path.name), mosaic_of(cv2.imread(str(path)), pattern))
    sample = pair_folders(tmp_path / "left", tmp_path / "right", InputConfig()).pairs
    found = settled(InputConfig(), sample)
    assert (found.bayer, found.significant_bits) == (pattern, None)
    assert settled(InputConfig(bayer="none"), sample).bayer == "none"
    (said,) = stored_notes(InputConfig(), found)
    assert f"a color filter pattern, read as {pattern}, assuming that red is darker" in said


def test_one_raw_side_is_left_as_it_is(tmp_path: Path) -> None:
    color = np.full((40, 60, 3), (200, 120, 60), np.uint8)
    one = Pair("a", tmp_path / "l.png", tmp_path / "r.png")
    cv2.imwrite(str(one.left), mosaic_of(color, "rggb"))
    cv2.imwrite(str(one.right), color)
    assert settled(InputConfig(), [one]).bayer == "none"
