"""The response of a dive's cameras, measured before the pairs are read."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from stereo_seecolor.checks.sample import evenly_spaced, of_each
from stereo_seecolor.color.response.measure import (
    UNDECIDED,
    MeasuredResponse,
    measure_jpeg,
    measure_response,
)
from stereo_seecolor.config import InputConfig, RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.color_spaces import SPACES
from stereo_seecolor.files.image_headers import jpeg_quantization
from stereo_seecolor.inputs.capture import orientation
from stereo_seecolor.inputs.images import read_image_bytes
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.inputs.stated_encoding import stated_encoding, stated_space
from stereo_seecolor.records import Image

LEFT_FRAMES, RIGHT_FRAMES = 6, 3
"""Frames, spread over the dive: noise curves of six agree within some 10 %."""
LEAST_BALANCED = 4
"""Frames that show that all were balanced."""
SAME_MEAN, SAME_SCENE = 0.005, 0.03
"""Standard deviations over frames, fractions of the mean: means that differ by less were made
equal (0.1 % on a real dive of balanced frames, 7 % on one of automatic exposure), if the contrast
differs by more (13 %), since other frames are of one scene.
"""


def settle_response(
    config: RunConfig, pairs: Sequence[Pair], has_right: bool = True
) -> tuple[RunConfig, tuple[str, ...]]:
    """Settle ``color.input_encoding`` where it is auto, with the pedestal, and the color space.
    has_right: the second file of a pair is an image, too. Returns the settings, and notes on what
    was found; none for images encoded by sRGB, as most are.
    """
    config, of_space = _settle_space(config, pairs)
    if config.color.input_encoding != "auto":
        return config, of_space
    files, images = _read(pairs, "left", LEFT_FRAMES, config.input)
    if not images:
        return config, of_space
    left, right = _measured(files, images), UNDECIDED
    if left.verdict == "undecided" and (steps := _common_quantization(files)):
        left = measure_jpeg(images, steps)
    if has_right:
        right = _measured(*_read(pairs, "right", RIGHT_FRAMES, config.input))
    color = config.color.model_copy(update=left.settings)
    notes = (*of_space, *_notes(left, right), *_balanced(images))
    return config.model_copy(update={"color": color}), notes


def _settle_space(config: RunConfig, pairs: Sequence[Pair]) -> tuple[RunConfig, tuple[str, ...]]:
    """Settle ``color.input_space`` where it is auto and the first file that is not empty states
    another than sRGB.
    """
    if config.color.input_space != "auto":
        return config, ()
    first = next(
        (pair.left for pair in evenly_spaced(pairs, LEFT_FRAMES) if _holds(pair.left)), None
    )
    if first is None:
        return config, ()
    space, unknown = stated_space(first)
    if unknown:
        known = ", ".join(own.title for own in SPACES.values())
        return config, (
            f'response: the profile "{unknown}" of {first.name} is none of these: '
            f"{known}: its colors are read as those of sRGB: convert the images to sRGB",
        )
    if space == "srgb":
        return config, ()
    color = config.color.model_copy(update={"input_space": space})
    return config.model_copy(update={"color": color}), (
        f"response: the first file states {SPACES[space].title}: colors are converted to sRGB",
    )


def _notes(left: MeasuredResponse, right: MeasuredResponse) -> tuple[str, ...]:
    notes: tuple[str, ...] = () if left.verdict == "encoded" else (f"response: {left.line}",)
    decided = {left.verdict, right.verdict} - {"undecided"}
    if len(decided) > 1:
        notes += (
            f"response: the left images are {left.verdict} and the right ones {right.verdict}: "
            "did different programs save the two sides?",
        )
    return notes


def _balanced(images: Sequence[Image]) -> tuple[str, ...]:
    """A note where each frame was brought to the same mean of each channel before it was saved."""
    if len(images) < LEAST_BALANCED:
        return ()
    means, contrasts = np.array([cv2.meanStdDev(image) for image in images])[..., 0].swapaxes(0, 1)
    spread, varies = (
        (of.std(axis=0) / np.maximum(of.mean(axis=0), 1e-9)).max() for of in (means, contrasts)
    )
    if spread > SAME_MEAN or varies < SAME_SCENE:
        return ()
    return (
        f"response: {len(images)} frames of the dive have the same mean of red, of green and of "
        f"blue, to {spread:.2%}: each was balanced separately before it was saved. The gains of "
        "frames are estimated from spots that several frames show; if you can, save frames without "
        "automatic white balance",
    )


def _measured(files: Sequence[Path], images: Sequence[Image]) -> MeasuredResponse:
    return measure_response(images, stated_encoding(files[0]) if files else None)


def _common_quantization(files: Sequence[Path]) -> bytes:
    """The steps of upright JPEGs that all have the same; else empty."""
    steps = set[bytes]()
    for path in files:
        with suppress(InputError):  # the run names it
            content = read_image_bytes(path)
            steps.add(jpeg_quantization(content) if orientation(content) == 1 else b"")
    return steps.pop() if len(steps) == 1 else b""


def _holds(path: Path) -> bool:
    """False for a file that is empty or cannot be read."""
    with suppress(InputError):  # the run names it
        return bool(read_image_bytes(path))
    return False


def _read(
    pairs: Sequence[Pair], side: str, most: int, config: InputConfig
) -> tuple[list[Path], list[Image]]:
    """Files spread over the dive with their images; others in the place of damaged ones."""
    files = [getattr(pair, side) for pair in evenly_spaced(pairs, most)]
    found = of_each(files, config, lambda image: image)
    if len(found) < len(files):
        others = [path for pair in pairs if (path := getattr(pair, side)) not in files]
        spare = evenly_spaced(others, most)
        found = [*found, *of_each(spare, config, lambda image: image)][:most]
    return [path for path, _ in found], [image for _, image in found]
