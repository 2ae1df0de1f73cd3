"""Linear light in 16-bit files that are read as encoded for a screen."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_seecolor.checks.image_files import encoding_notes
from stereo_seecolor.checks.sample import DiveImages
from stereo_seecolor.config import RunConfig
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.inputs.file_form import stored_facts
from stereo_seecolor.inputs.pairing import Pair

ENCODED = np.repeat(
    np.clip(np.random.default_rng(1).normal(0.3, 0.17, (64, 80, 1)), 0.02, 1), 3, axis=2
)


def said_of(config: RunConfig, pairs: list[Pair]) -> tuple[str, ...]:
    return encoding_notes(DiveImages(pairs, config, stored_facts(config.input, pairs)))


@pytest.mark.parametrize(
    ("light", "full", "encoding", "said"),
    [
        (ENCODED, 65535, "srgb", False),
        (decode_srgb(ENCODED), 65535, "srgb", True),
        (decode_srgb(ENCODED) / 8, 65535, "srgb", True),
        (decode_srgb(ENCODED), 65535, "linear", False),
        (decode_srgb(ENCODED), 255, "srgb", False),
    ],
)
def test_linear_light_read_as_encoded_is_named(
    tmp_path: Path, light: np.ndarray, full: int, encoding: str, said: bool
) -> None:
    path = tmp_path / "0001.tiff"
    cv2.imwrite(str(path), np.round(light * full).astype(np.uint16 if full > 255 else np.uint8))
    config = RunConfig.model_validate({"color": {"input_encoding": encoding}})
    notes = said_of(config, [Pair("0001", path, path)])
    assert bool(notes) == said
    assert all(
        "0001.tiff" in note and "--set color.input_encoding=linear" in note for note in notes
    )


def test_an_image_that_cannot_be_read_is_left_to_the_run(tmp_path: Path) -> None:
    config = RunConfig()
    for pairs in ([Pair("a", tmp_path / "a.png", tmp_path / "b.png")], []):
        assert said_of(config, pairs) == ()
