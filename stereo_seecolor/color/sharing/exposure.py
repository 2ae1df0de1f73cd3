"""The camera exposure of a frame relative to others, from brightness at equal ranges: exposure
scales reef and backscatter equally.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.table.encoding import InputEncoding, decoded_bins
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.table.range_bins import RANGE_BINS
from stereo_seecolor.records import Water

_PACKED = np.dtype([("range_bin", "u1"), ("light", "<f4"), ("pixels", "<i4")])


@dataclass(frozen=True, eq=False)
class Brightness:
    """Sums of light over channels and pixels of a range bin, and numbers of pixels, (256,)."""

    light: NDArray[np.floating]
    pixels: NDArray[np.signedinteger]

    @classmethod
    def of(cls, table: MomentTable, encoding: InputEncoding) -> "Brightness":
        """The brightness of a table."""
        return cls(table.counts.sum(axis=0) @ decoded_bins(table.bit_depth, encoding), table.pixels)

    def packed(self) -> bytes:
        """Pack the range bins that have pixels, 9 bytes each: a dive has thousands of frames."""
        bins = np.flatnonzero(self.pixels)
        packed = np.empty(bins.size, _PACKED)
        packed["range_bin"] = bins
        packed["light"] = self.light[bins]
        packed["pixels"] = self.pixels[bins]
        return packed.tobytes()

    @classmethod
    def unpacked(cls, content: bytes) -> "Brightness":
        """Unpack the brightness of ``packed``, in single precision."""
        packed = np.frombuffer(content, _PACKED)
        light, pixels = np.zeros(RANGE_BINS, np.float32), np.zeros(RANGE_BINS, np.int32)
        light[packed["range_bin"]], pixels[packed["range_bin"]] = packed["light"], packed["pixels"]
        return cls(light, pixels)

    @property
    def stops(self) -> float:
        """Log2 of the mean light; -inf without light."""
        mean = self.light.sum() / max(int(self.pixels.sum()), 1)
        return float(np.log2(mean)) if mean > 0 else -np.inf

    def ratio(self, reference: "Brightness") -> float:
        """The ratio of brightness to the reference, mean over common range bins; 1 without any."""
        both = (self.light > 0) & (reference.light > 0)
        if not both.any():
            return 1.0
        brighter = np.log(self.light[both] / self.pixels[both]) - np.log(
            reference.light[both] / reference.pixels[both]
        )
        weights = np.minimum(self.pixels[both], reference.pixels[both])
        return float(np.exp(np.average(brighter, weights=weights)))


def shorten_exposure(table: MomentTable, factor: float, encoding: InputEncoding) -> MomentTable:
    """Convert a table to a ``factor`` times shorter exposure, in the nearest value bins."""
    light = decoded_bins(table.bit_depth, encoding)
    nearest = np.searchsorted(0.5 * (light[1:] + light[:-1]), light / factor)
    counts = np.zeros_like(table.counts)
    for value, target in enumerate(nearest):
        counts[:, :, target] += table.counts[:, :, value]
    return MomentTable(counts, table.offset_sum, table.bit_depth)


def exposed(water: Water, factor: float) -> Water:
    """Convert water parameters to a ``factor`` times longer exposure."""
    water = replace(water, white=water.white * factor)
    if water.final_sigmoid:
        return replace(water, final_sigmoid=water.final_sigmoid * factor)
    return replace(water, gamma_inf=water.gamma_inf * factor, eta=water.eta * factor)
