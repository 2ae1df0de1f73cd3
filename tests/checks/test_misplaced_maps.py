"""Range maps that are turned, shifted or of another image, by their steps and the images' edges."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from stereo_seecolor.checks.misplaced_maps import misplaced_maps
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.config import RunConfig
from stereo_seecolor.inputs.pairing import Pair

Array = NDArray[np.float32]
COUNT = 7


def rocks(seed: int) -> tuple[NDArray[np.uint8], Array]:
    """A textured bottom with nearer rocks on it, each of a gray of its own: an image and
    its ranges.
    """
    rng = np.random.default_rng(seed)
    range_m = np.full((240, 320), 3.0, np.float32)
    image = np.full(range_m.shape, 110.0)
    texture = 20 * cv2.GaussianBlur(rng.normal(size=range_m.shape), (0, 0), 1.5)
    for _ in range(60):
        middle = tuple(map(int, rng.integers((0, 0), (320, 240))))
        radius = int(rng.integers(8, 25))
        cv2.circle(range_m, middle, radius, float(rng.uniform(1.5, 2.8)), -1)
        cv2.circle(image, middle, radius, float(rng.uniform(40, 180)), -1)
    noisy = range_m + rng.normal(0, 0.003, range_m.shape).astype(np.float32)
    return np.clip(image + texture, 0, 255).astype(np.uint8), noisy


def folder(root: Path, place: Callable[[int, list[Array]], Array]) -> DiveImages:
    drawn = [rocks(seed) for seed in range(COUNT)]
    maps = [range_m for _, range_m in drawn]
    pairs = []
    for number, (image, _) in enumerate(drawn):
        files = root / f"{number}.png", root / f"{number}.tiff"
        cv2.imwrite(str(files[0]), image)
        cv2.imwrite(str(files[1]), np.ascontiguousarray(place(number, maps)))
        pairs.append(Pair(f"{number}", *files))
    return DiveImages(pairs, RunConfig())


@pytest.mark.parametrize(
    ("place", "said"),
    [
        (lambda i, maps: maps[i][:, ::-1], "are mirrored"),
        (lambda i, maps: maps[i][::-1], "are upside down"),
        (lambda i, maps: maps[i][::-1, ::-1], "are turned by 180 degrees"),
        (lambda i, maps: np.roll(maps[i], 14, axis=1), "14, 0 px (x, y), as maps of the"),
        (lambda i, maps: maps[(i + 1) % COUNT], "are of the image after its own"),
        (lambda i, maps: maps[i - 1], "are of the image before its own"),
    ],
)  # fmt: skip
def test_maps_of_another_place_are_named(
    place: Callable[[int, list[Array]], Array], said: str, tmp_path: Path
) -> None:
    found = misplaced_maps(folder(tmp_path, place))
    (note,) = found.notes
    assert said in note
    assert found.wrong == {"ranges", "colors"}


@pytest.mark.parametrize(
    "place",
    [
        lambda i, maps: maps[i],
        lambda i, maps: maps[(3 * i + 2) % COUNT],
        lambda i, maps: np.full_like(maps[i], 2),
        lambda i, maps: np.where(maps[i] < 2.9, maps[i], np.nan),
    ],
)
def test_what_lies_right_or_cannot_be_told_is_not_named(
    place: Callable[[int, list[Array]], Array], tmp_path: Path
) -> None:
    assert not misplaced_maps(folder(tmp_path, place)).notes
