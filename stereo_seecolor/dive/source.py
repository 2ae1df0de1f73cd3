"""Lazy sequences over the pairs of a dive: some of them, with their names, or in groups; each item
is made when asked for.
"""

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration import Rectification, RectifiedPair
from calibration.rectification import OriginalView
from stereo_seecolor.compute.sequences import Chosen, Lazy
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.config import RunConfig
from stereo_seecolor.device import make_corrector
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.decoding import seam_row, seam_text
from stereo_seecolor.inputs.images import FrameReader, read_image, read_image_bytes, read_range_map
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import Image, Mask, RangeMap
from stereo_seecolor.version import __version__

GROUP = 32
"""Pairs of a group. A stretch with a water of its own begins with one, and has 256 frames or more
in a dive that needs groups.
"""


def chosen(pairs: Sequence[Pair], wanted: Callable[[Pair], bool]) -> Sequence[Pair]:
    """The pairs that are ``wanted``, in their order."""
    return Chosen(pairs, array("q", (number for number, pair in enumerate(pairs) if wanted(pair))))


@dataclass(frozen=True)
class Named(Lazy[tuple[str, Pair]]):
    """Pairs with their names."""

    pairs: Sequence[Pair]

    def __len__(self) -> int:
        return len(self.pairs)

    def item(self, number: int) -> tuple[str, Pair]:
        """The pair of this number, and its name."""
        pair = self.pairs[number]
        return pair.name, pair


@dataclass(frozen=True)
class Groups(Lazy[Sequence[Pair]]):
    """Groups of neighboring pairs, the same for any number of workers, so that sums are always
    added in the same order.
    """

    pairs: Sequence[Pair]

    def __len__(self) -> int:
        return -(-len(self.pairs) // GROUP)

    def item(self, number: int) -> Sequence[Pair]:
        """The group of this number."""
        return self.pairs[number * GROUP : (number + 1) * GROUP]


# Images that come with range maps, instead of a second camera, as a source of a dive.


class RangedImages:
    """A Source of images and their range maps, which are read instead of measured."""

    makes_ranges = False
    rectification: Rectification | None = None
    geometry: RectifiedPair | None = None
    seen: Mask | None = None
    original: OriginalView | None = None  # its images are the camera's own already

    def __init__(self, config: RunConfig) -> None:
        self.config = config
        self.corrector = make_corrector(config.color)
        self.reader = FrameReader(config.input)
        self.settings = content_key(__version__, self.reader.settings)

    def inputs(self, pair: Pair) -> dict[str, Path]:
        """The files of a pair: its image and its range map."""
        return {"image": pair.left, "range": pair.right}

    def raw(self, pair: Pair, clock: Clock) -> Image:
        """The image as it is. Raises InputError."""
        with clock("read"):
            return read_image(pair.left, self.config.input)

    image = raw

    def measure(self, pair: Pair, clock: Clock) -> tuple[Image, RangeMap]:
        """The image and its range map. Raises InputError if they differ in size or cannot be
        read.
        """
        image = self.image(pair, clock)
        with clock("read"):
            range_m = read_range_map(pair.right, self.config.input.range_units_per_m)
        if range_m.shape != image.shape[:2]:
            raise InputError(
                f"{pair.right}: the range map is {range_m.shape[1]}x{range_m.shape[0]} px but its "
                f"image {pair.left.name} is "
                f"{image.shape[1]}x{image.shape[0]}: give the range map of this very image"
            )
        row = seam_row(image, read_image_bytes(pair.left))
        warnings = () if row is None else (f"{pair.left.name}: {seam_text(row)}",)
        return image, RangeMap.of_ranges(range_m, np.isfinite(range_m), warnings)
