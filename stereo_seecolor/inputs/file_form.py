"""How images store pixels: color filter patterns, and 10, 12 or 14 bits unshifted."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from statistics import mode

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.image_headers import is_finished_color
from stereo_seecolor.inputs.image_facts import ImageFacts, image_facts
from stereo_seecolor.inputs.images import read_image_bytes
from stereo_seecolor.inputs.pairing import Pair

UNSHIFTED = (10, 12, 14)
"""Bits of the sensors whose values lie at the lower end of 16-bit files."""


def stored_facts(config: InputConfig, sample: Sequence[Pair]) -> dict[Path, ImageFacts]:
    """Collect the facts of raw and of deep images, in their order; none where one is neither.

    One that cannot be read is left out, as is a monochrome one on the right of a raw one. sample:
    pairs from all parts of a dive; one of them is read where the settings say how images are
    stored.
    """
    if "auto" not in (config.significant_bits, config.bayer):
        sample = sample[:1]
    facts: dict[Path, ImageFacts] = {}
    for pair in sample:
        for path in (pair.left, pair.right):
            with suppress(InputError):  # the run names it
                if is_finished_color(read_image_bytes(path)):
                    return {}
                one = image_facts(path)
                if (
                    one.bayer == "none"
                    and path == pair.right
                    and pair.left in facts
                    and facts[pair.left].bayer != "none"
                ):
                    # a monochrome camera beside a raw one, which reading as raw hardly blurs
                    continue
                if one.bits < 16 and one.bayer == "none":
                    return {}
                facts[path] = one
    return facts


def as_stored(config: InputConfig, found: Mapping[Path, ImageFacts]) -> InputConfig:
    """Set ``significant_bits`` and ``bayer``, where "auto", to what the images have."""
    facts = list(found.values())
    update: dict[str, object] = {}
    if config.significant_bits == "auto":
        most = max((one.used_bits for one in facts), default=0)
        update["significant_bits"] = most if most in UNSHIFTED else None
    if config.bayer == "auto":
        patterns = [one.bayer for one in facts]  # that of most images, where all show one
        update["bayer"] = mode(patterns) if patterns and "none" not in patterns else "none"
    return config.model_copy(update=update)


def stored_notes(given: InputConfig, config: InputConfig) -> tuple[str, ...]:
    """Report the settings that were found."""
    notes = []
    if config.bayer != given.bayer and config.bayer != "none":
        notes.append(
            f"input: raw images with a color filter pattern, read as {config.bayer}, assuming "
            "that red is darker than blue: if the colors are exchanged, set input.bayer"
        )
    if config.significant_bits != given.significant_bits and config.significant_bits is not None:
        notes.append(
            f"input: the 16-bit images hold {config.significant_bits} bits, which are scaled to 16"
        )
    return tuple(notes)
