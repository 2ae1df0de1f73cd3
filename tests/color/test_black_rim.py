"""A black rim around the picture is no scene: the water is fitted as if it were not there."""

import numpy as np
import pytest

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.table.black_rim import without_rim
from stereo_seecolor.extras.evaluation.measures import angle_deg
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb

SHAPE = (192, 256)


def turbid_frame(seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """A picture of blocks of sand, rock and coral through green haze, and its range."""
    rng = np.random.default_rng(seed)
    materials = np.array(
        [
            [0.5, 0.43, 0.33],
            [0.25, 0.23, 0.2],
            [0.25, 0.17, 0.09],
            [0.45, 0.1, 0.06],
            [0.02, 0.02, 0.02],
        ]
    )
    blocks = rng.choice(
        len(materials), (SHAPE[0] // 8, SHAPE[1] // 8), p=[0.35, 0.3, 0.15, 0.1, 0.1]
    )
    truth = np.kron(materials[blocks], np.ones((8, 8, 1))) * np.exp(
        0.3 * rng.standard_normal((*SHAPE, 1))
    )
    range_m = np.broadcast_to(
        np.linspace(1.0, 3.0, SHAPE[0], dtype=np.float32)[:, None], SHAPE
    ).copy()
    z = range_m[..., None]
    light = truth * [0.5, 0.9, 0.6] * np.exp(-z * [0.6, 0.4, 0.5]) + np.array(
        [0.1, 0.25, 0.18]
    ) * -np.expm1(-z * [0.6, 0.4, 0.5])
    return np.round(
        255 * np.clip(encode_srgb(light) + 0.004 * rng.standard_normal(light.shape), 0, 1)
    ).astype(np.uint8), range_m


def port(soft: float) -> np.ndarray:
    """(H, W, 1) light that a round port lets through, its edge this wide against half the width."""
    y, x = np.mgrid[-1 : 1 : SHAPE[0] * 1j, -1 : 1 : SHAPE[1] * 1j]
    return np.clip((1 - np.hypot(x, y * SHAPE[0] / SHAPE[1])) / soft + 0.5, 0, 1)[..., None]


def bars() -> np.ndarray:
    light = np.ones((*SHAPE, 1))
    light[:24], light[-24:] = 0, 0
    return light


@pytest.mark.slow
@pytest.mark.parametrize(
    "rim", [port(0.06), port(0.01), bars()], ids=["soft port", "sharp port", "bars"]
)
@pytest.mark.parametrize("bits", [8, 16])
def test_the_water_is_that_without_the_rim(rim: np.ndarray, bits: int) -> None:
    image, range_m = turbid_frame()
    kind = np.uint8 if bits == 8 else np.uint16
    shaded = np.round(encode_srgb(decode_srgb(image / 255) * rim) * (2**bits - 1)).astype(kind)
    corrector, seen = Corrector(), rim[..., 0] == 1
    colors = [
        encode_srgb(corrector.apply_linear(image, range_m, corrector.fit_frame(by, range_m)))[seen]
        for by in (image, shaded)
    ]
    assert np.median(angle_deg(*colors)) < 1.0


def test_a_shadow_in_a_corner_is_no_rim() -> None:
    image, range_m = turbid_frame()
    image[:40, :60] = 3
    assert without_rim(image, range_m, "srgb") is range_m


@pytest.mark.parametrize("divisor", [64, 255])
def test_an_almost_black_picture_has_no_rim(divisor: int) -> None:
    image, range_m = turbid_frame()
    assert without_rim(image // divisor, range_m, "srgb") is range_m


def test_where_only_the_rim_has_ranges_they_count() -> None:
    image, range_m = turbid_frame()
    image[:24], range_m[24:] = 0, np.nan
    assert without_rim(image, range_m, "srgb") is range_m


def test_a_rim_is_unknown_and_the_rest_as_measured() -> None:
    image, range_m = turbid_frame()
    image[:24] = 0
    known = np.isfinite(without_rim(image, range_m, "srgb"))
    assert not known[:24].any()
    assert known[30:-6, 6:-6].all()


def test_a_rim_without_ranges_changes_nothing() -> None:
    image, range_m = turbid_frame()
    image[:24], range_m[:24] = 0, np.nan
    assert without_rim(image, range_m, "srgb") is range_m
