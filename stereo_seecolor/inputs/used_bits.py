"""How many bits the 16-bit images of a dive really use: many cameras store 10, 12 or 14 bits unshifted."""

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Literal

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.inputs.headers import is_eight_bit
from stereo_seecolor.inputs.image_facts import image_facts
from stereo_seecolor.inputs.images import read_image_bytes
from stereo_seecolor.inputs.pairing import Pair

UNSHIFTED: tuple[Literal[10, 12, 14], ...] = (10, 12, 14)
"""Bits of the sensors whose values lie at the lower end of 16-bit files."""


def with_used_bits(config: InputConfig, sample: Iterable[Pair]) -> InputConfig:
    """The same, its ``significant_bits`` a number, or None where images use all that their files have, instead of "auto".

    sample: pairs from all parts of a dive; the first image of 8 bits ends the search, what cannot be read is left out.
    """
    if config.significant_bits != "auto":
        return config
    paths = (path for pair in sample for path in (pair.left, pair.right))
    return config.model_copy(update={"significant_bits": _used_bits(paths)})


def _used_bits(paths: Iterable[Path]) -> Literal[None, 10, 12, 14]:
    most = 0
    for path in paths:
        with suppress(InputError):  # the run names it
            if is_eight_bit(read_image_bytes(path)):
                return None
            facts = image_facts(path)
            if facts.bits < 16:
                return None
            most = max(most, facts.used_bits)
    return next((bits for bits in UNSHIFTED if bits == most), None)
