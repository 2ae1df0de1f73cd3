"""Exposure of frames: from brightness, and as the camera recorded it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.photometry.gain_chain import (
    Chain,
    Chosen,
    Differences,
    offset_between,
    solve_chain,
)
from stereo_seecolor.color.table.encoding import InputEncoding, decoded_bins
from stereo_seecolor.color.table.moment_table import RANGE_BINS, MomentTable
from stereo_seecolor.records import Capture, Water

# A frame's camera exposure relative to others, from brightness at equal ranges: exposure scales
# reef and backscatter alike.

_PACKED = np.dtype([("range_bin", "u1"), ("light", "<f4"), ("pixels", "<i4")])


@dataclass(frozen=True, eq=False)
class Brightness:
    """Sums of light over channels and pixels of a range bin, and the pixels; (256,), they add."""

    light: NDArray[np.floating]
    pixels: NDArray[np.signedinteger]

    @classmethod
    def of(cls, table: MomentTable, encoding: InputEncoding) -> "Brightness":
        """The brightness of a table's pixels."""
        return cls(table.counts.sum(axis=0) @ decoded_bins(table.bit_depth, encoding), table.pixels)

    def __add__(self, other: "Brightness") -> "Brightness":
        return Brightness(self.light + other.light, self.pixels + other.pixels)

    def packed(self) -> bytes:
        """The range bins that have pixels, as 9 bytes each: a dive has thousands of frames."""
        bins = np.flatnonzero(self.pixels)
        packed = np.empty(bins.size, _PACKED)
        packed["range_bin"] = bins
        packed["light"] = self.light[bins]
        packed["pixels"] = self.pixels[bins]
        return packed.tobytes()

    @classmethod
    def unpacked(cls, content: bytes) -> "Brightness":
        """The brightness from ``packed``, in single precision, to which none may be added."""
        packed = np.frombuffer(content, _PACKED)
        light, pixels = np.zeros(RANGE_BINS, np.float32), np.zeros(RANGE_BINS, np.int32)
        light[packed["range_bin"]], pixels[packed["range_bin"]] = packed["light"], packed["pixels"]
        return cls(light, pixels)

    @property
    def stops(self) -> float:
        """log2 of the mean light; -inf where there is none."""
        mean = self.light.sum() / max(int(self.pixels.sum()), 1)
        return float(np.log2(mean)) if mean > 0 else -np.inf

    def ratio(self, reference: "Brightness") -> float:
        """Brightness over the reference's, averaged over common range bins; 1 without any."""
        both = (self.light > 0) & (reference.light > 0)
        if not both.any():
            return 1.0
        brighter = np.log(self.light[both] / self.pixels[both]) - np.log(
            reference.light[both] / reference.pixels[both]
        )
        return float(
            np.exp(
                np.average(brighter, weights=np.minimum(self.pixels[both], reference.pixels[both]))
            )
        )


def darkened(table: MomentTable, factor: float, encoding: InputEncoding) -> MomentTable:
    """The table for a ``factor`` times shorter exposure: pixels move to the nearest value bin."""
    light = decoded_bins(table.bit_depth, encoding)
    nearest = np.searchsorted(0.5 * (light[1:] + light[:-1]), light / factor)
    counts = np.zeros_like(table.counts)
    for value, target in enumerate(nearest):
        counts[:, :, target] += table.counts[:, :, value]
    return MomentTable(counts, table.offset_sum, table.bit_depth)


def exposed(water: Water, factor: float) -> Water:
    """The water as it looks at a ``factor`` times longer exposure."""
    if water.final_sigmoid:
        return replace(
            water, final_sigmoid=water.final_sigmoid * factor, white=water.white * factor
        )
    return replace(
        water,
        gamma_inf=water.gamma_inf * factor,
        eta=water.eta * factor,
        white=water.white * factor,
    )


# The exposure that the camera recorded, as a prior of each frame's gain, where it explains
# differences between frames.
#
# Records may be wrong, and with a strobe the exposure time has no effect. So differences between
# frames that show the same spots decide whether the records are used.

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RecordSettings:
    """When records are used."""

    varies: float = 0.03
    """Least standard deviation (logarithm) of records that are examined; less is not corrected."""
    left: float = 0.8
    """Fraction of the offsets between frames that may be left with them, as for gains."""
    no_gain: float = 1e-9
    """Logarithm: a gain of color alone has none of luminance but for rounding."""


SETTINGS = RecordSettings()


def log_exposures(captures: Sequence[Capture]) -> Array:
    """(F,) logarithms of recorded exposures, of mean 0; 0 where a number is missing."""
    values = (value for c in captures for value in (c.exposure_s, c.gain, c.aperture))
    fields = np.fromiter(
        (np.nan if value is None else value for value in values), np.float64
    ).reshape(len(captures), 3)
    recorded = ~np.isnan(fields)
    complete = (recorded | ~recorded.any(axis=0)).all(axis=1)
    logs = np.log(np.where(recorded, fields, 1.0)) @ np.array([1.0, 1.0, -2.0])
    usual = logs[complete].mean() if complete.any() else 0.0
    return np.where(complete, logs - usual, 0.0)


def is_informative(recorded: Array) -> bool:
    """Whether the (F,) records differ enough between frames to be examined."""
    return bool(recorded.size) and float(recorded.std()) > SETTINGS.varies


def offsets_about(found: Differences, recorded: Array) -> tuple[float, float]:
    """rms of luminance between frames, without and with the (F,) records subtracted."""
    return offset_between(found, np.zeros_like(recorded)), offset_between(found, recorded)


def explain(offsets: tuple[float, float]) -> bool:
    """Whether subtracting the records lowers the ``offsets_about`` enough."""
    return offsets[1] < SETTINGS.left * offsets[0]


def solve_recorded(found: Differences, recorded: Array, chosen: Chosen) -> Chain:
    """Gains of all frames about the (F,) records; a frame without overlap gets its record."""
    chain = solve_chain(found, recorded, chosen)
    left = (
        chain.offsets[1]
        if np.abs(chain.gains.mean(axis=1)).max() > SETTINGS.no_gain
        else chain.offsets[0]
    )
    return Chain(
        chain.gains + recorded[:, None],
        chain.measured | (recorded != 0),
        (offset_between(found, np.zeros_like(recorded)), left),
    )
