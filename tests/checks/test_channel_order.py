"""Images that hold blue in the place of red are named, and read as the settings say."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import REEF
from numpy.typing import NDArray

from stereo_seecolor.checks.channel_order import channel_order, order_of_sides
from stereo_seecolor.checks.exchanged_channels import exchanged_channels_notes
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.color.sharing.survey import CountedFrames
from stereo_seecolor.color.table.counting import measure
from stereo_seecolor.config import ColorConfig, InputConfig, RunConfig
from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import Pair

WATERS = {  # white point, attenuation, backscatter far away, its rate, of R, G, B
    "deep ocean": ((0.05, 0.8, 1.1), (0.35, 0.09, 0.05), (0.005, 0.12, 0.24), (0.3, 0.09, 0.06)),
    "turbid coast": ((0.6, 1.0, 0.6), (0.50, 0.36, 0.55), (0.09, 0.30, 0.17), (0.45, 0.33, 0.50)),
}


@pytest.mark.parametrize("name", WATERS)
def test_exchanged_channels_are_named(name: str) -> None:
    """Coastal water is nearly the same in both orders."""
    white, attenuation, far, rate = map(np.array, WATERS[name])
    rng = np.random.default_rng(5)
    range_m = np.broadcast_to(np.geomspace(1.0, 5.0, 300), (200, 300)).astype(np.float32)
    reef = rng.lognormal(-1.5, 0.7, (200, 300, 1)) * rng.lognormal(0.0, 0.15, (200, 300, 3))
    reef *= [0.5, 0.4, 0.3]
    z = range_m[..., None]
    light = reef * white * np.exp(-attenuation * z) - far * np.expm1(-rate * z)
    image = np.round(255 * encode_srgb(np.clip(light, 0, 1))).astype(np.uint8)

    def notes(seen: NDArray[np.uint8]) -> tuple[str, ...]:
        config = ColorConfig(input_encoding="srgb")
        frames = CountedFrames.of([("a", measure(seen, range_m))], config)
        return exchanged_channels_notes(frames.classes, config, InputConfig().other_channels)

    assert notes(image) == ()
    named = notes(image[..., ::-1].copy())
    assert len(named) == (name == "deep ocean")
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
    blue_first = RunConfig(input=InputConfig(channels="bgr"))
    for of_setting, other in (
        (notes, "bgr"),
        (channel_order(DiveImages(pairs, blue_first)).notes, "rgb"),
    ):
        assert all(line.endswith(f"--set input.channels={other}") for line in of_setting)
    last = "and the following images" if exchanged and exchanged[-1] == 39 else "to 0022.png"
    assert all(f"{exchanged[0]:04d}.png {last}" in line for line in notes)
    assert all("another white balance" in line for line in notes)  # no point tells


def test_sides_of_which_one_has_red_and_blue_exchanged_are_named(tmp_path: Path) -> None:
    """As two cameras of one kind see a reef; a monochrome side has no order."""
    image = cv2.imread(str(next((REEF / "left").iterdir())))
    other = np.clip(image * [0.95, 1.0, 1.06] + 2, 0, 255).astype(np.uint8)
    gray = np.repeat(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)[..., None], 3, axis=2)
    cases = {"alike": other, "exchanged": other[..., ::-1], "gray": gray}
    cases["another balance"] = _balanced(image)
    named = {}
    for name, right in cases.items():
        paths = [tmp_path / f"{name}_{side}.png" for side in ("left", "right")]
        for path, picture in zip(paths, (image, right), strict=True):
            cv2.imwrite(str(path), picture)
        found = order_of_sides(DiveImages([Pair(name, *paths)], RunConfig()))
        named[name] = found.wrong
    assert {name for name, wrong in named.items() if wrong == {"colors"}} == {"exchanged"}


def _balanced(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3) B, G, R with a white balance by which red and blue seem to be exchanged."""
    dark = image / 255.0 * [0.33, 1.0, 2.6]
    return np.clip(255 * dark, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("is_exchanged", [True, False])
def test_another_white_balance_is_not_exchanged_channels(
    tmp_path: Path, is_exchanged: bool
) -> None:
    """From the fourth image of a dive on, which shows the same reef as those before."""
    image, pairs = cv2.imread(str(next((REEF / "left").iterdir()))), []
    changed = image[..., ::-1] if is_exchanged else _balanced(image)
    for number in range(6):
        path = tmp_path / f"{number}.png"
        cv2.imwrite(str(path), np.roll(image if number < 3 else changed, 20 * number, axis=1))
        pairs.append(Pair(path.stem, path, path))
    notes = channel_order(DiveImages(pairs, RunConfig())).notes
    assert len(notes) == is_exchanged
    assert not any("white balance" in line for line in notes)


@pytest.mark.parametrize(("first", "last"), [(3, 5), (0, 2)])
def test_pairs_of_which_one_side_has_red_and_blue_exchanged_are_named(
    tmp_path: Path, first: int, last: int
) -> None:
    image, pairs = cv2.imread(str(next((REEF / "left").iterdir()))), []
    for number in range(6):
        paths = [tmp_path / side / f"{number}.png" for side in ("left", "right")]
        for path in paths:
            path.parent.mkdir(exist_ok=True)
        cv2.imwrite(str(paths[0]), image)
        cv2.imwrite(str(paths[1]), image[..., ::-1] if first <= number <= last else image)
        pairs.append(Pair(f"{number}", *paths))
    (note,) = order_of_sides(DiveImages(pairs, RunConfig())).notes
    assert f"pairs {first} to {last}, but not all" in note and "left/" in note and "right/" in note
    assert "input.channels" not in note
