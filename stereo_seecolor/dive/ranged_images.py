"""Images that come with range maps, instead of a second camera, as a source of a dive."""

from pathlib import Path

import numpy as np

from calibration import Rectification, RectifiedPair
from calibration.original_view import OriginalView
from stereo_seecolor.color.response.response import Response, standard_config
from stereo_seecolor.compute.threads import Clock
from stereo_seecolor.config import RunConfig
from stereo_seecolor.device import make_corrector, memory_of
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.inputs.frame_reader import FrameReader
from stereo_seecolor.inputs.images import read_image, read_image_bytes, read_range_map
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.inputs.seams import seam_row, seam_text
from stereo_seecolor.records import Image, Mask, RangeMap
from stereo_seecolor.version import __version__


class RangedImages:
    """A Source of images and their range maps, which are read instead of measured."""

    makes_ranges = False
    rectification: Rectification | None = None
    geometry: RectifiedPair | None = None
    seen: Mask | None = None
    original: OriginalView | None = None  # its images are the camera's own already

    def __init__(self, config: RunConfig, matched_by: RectifiedPair | None = None) -> None:
        self.config, self.matched_by = config, matched_by
        self.corrector = make_corrector(standard_config(config.color), memory_of(config.device))
        self.response = Response.of(config.color)
        self.reader = FrameReader(config.input)
        self.settings = content_key(__version__, self.reader.settings, matched_by)

    def inputs(self, pair: Pair) -> dict[str, Path]:
        """The files of a pair: its image and its range map."""
        return {"image": pair.left, "range": pair.right}

    def raw(self, pair: Pair, clock: Clock) -> Image:
        """The image as sRGB values without a pedestal. Raises InputError."""
        with clock("read"):
            image = read_image(pair.left, self.config.input)
            return self.response.of_frame(image).standard(image)

    image = raw

    def measure(self, pair: Pair, clock: Clock) -> tuple[Image, RangeMap]:
        """The image and its range map. Raises InputError if sizes differ or one is unreadable."""
        image = self.image(pair, clock)
        with clock("read"):
            range_m = read_range_map(pair.right, self.config.input.range_units_per_m)
        if range_m.shape != image.shape[:2]:
            raise InputError(
                f"{pair.right}: the range map is {range_m.shape[1]}x{range_m.shape[0]} px but "
                f"its image {pair.left.name} is {image.shape[1]}x{image.shape[0]}: give the "
                "range map of this image, or resize it (to the nearest pixel) if it shows all of it"
            )
        row = seam_row(image, read_image_bytes(pair.left))
        warnings = () if row is None else (f"{pair.left.name}: {seam_text(row)}",)
        return image, RangeMap.of_ranges(range_m, np.isfinite(range_m), warnings)
