"""A warning about deep images that are read as encoded for a screen, but look as if they held linear light, as raw converters write
it.
"""

from collections.abc import Mapping
from pathlib import Path

from stereo_seecolor.config import ColorConfig
from stereo_seecolor.inputs.image_facts import ImageFacts

DARK_MEDIAN = 0.2
"""Median of the brightest channel over its brightest thousandth. Encoded: 0.29 to 0.59 in frames of a real reef, a Sea-thru scene
and drawn dives by day and night; the same as linear light 0.07 to 0.31.
"""


def encoding_notes(config: ColorConfig, facts: Mapping[Path, ImageFacts]) -> tuple[str, ...]:
    """Warn where the first of a dive's images contradicts ``input_encoding: srgb``; nothing where it has 8 bits."""
    first = next(iter(facts), None)
    if config.input_encoding != "srgb" or first is None or facts[first].bits <= 8 or facts[first].middle >= DARK_MEDIAN:
        return ()
    doubt = f"color: {first.name} is dark for an image encoded for a screen, as which it is read"
    return (f"{doubt}: if it holds linear light, as from a raw converter: --set color.input_encoding=linear",)
