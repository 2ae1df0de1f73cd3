"""Taking a known water out of an image: J = exposure (I - B(z)) / (A(z) white), by look-up for 8 bits, computed for 16."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.encoding import decode, decoded_bins, decoded_values, encoding_nodes
from stereo_seecolor.color.tables import MomentTable, level_edges_m, range_bits
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.data import Correction, Image, Map, Water

FINE = 4


@dataclass(frozen=True, eq=False)
class Gains:
    """J = gain I - offset for each channel and fine level of range; capped: where noise allowed no more gain.

    gain, offset: (3, 1024) float32, of full scale. capped: (1024,) bool. exposure: what they hold of it.
    """

    gain: NDArray[np.float32]
    offset: NDArray[np.float32]
    capped: NDArray[np.bool_]
    exposure: float


def fine_ranges_m() -> NDArray[np.float64]:
    """(1024,) the middle of each fine level, metres: 128 an octave from 1/8 m to 32 m."""
    edges = level_edges_m()
    steps = (np.arange(FINE) + 0.5) / FINE
    return np.asarray((edges[:-1, None] + np.diff(edges)[:, None] * steps).ravel())


def gains(table: MomentTable, water: Water, config: ColorConfig, exposure: float | None = None) -> Gains:
    """What takes this water out of the table's image; exposure None: the water's own, or else the one that clips
    ``config.clipped_share`` of the pixels.
    """
    z = fine_ranges_m()
    backscatter = water.backscatter(z).T
    gain = 1.0 / np.maximum(water.attenuation(z) * water.white, 1e-12).T
    exposure = water.exposure if exposure is None else exposure
    if exposure is None:
        exposure = _exposure(table, gain, backscatter, config)
    gain = gain * exposure
    most = config.output_noise / _noise(table, config)[:, None]
    capped = np.any(gain > most, axis=0)
    gain = np.minimum(gain, most)
    return Gains(gain.astype(np.float32), (gain * backscatter).astype(np.float32), capped, exposure)


def correct(
    image: Image, range_m: Map, water: Water, table: MomentTable, config: ColorConfig, exposure: float | None = None
) -> Correction:
    """The image without its water, at its own size and bit depth; black where the range is unknown, unless the config says else."""
    from stereo_seecolor.color import kernels

    bits = range_bits(image, range_m)
    flat: NDArray[Any] = np.ascontiguousarray(image).reshape(-1, 3)
    out: NDArray[Any]
    depth = table.bit_depth
    by_level = gains(table, water, config, exposure)
    decoded, nodes = decoded_values(depth, config.input_encoding), encoding_nodes(depth, config.input_encoding)
    if depth == 8:
        colors = kernels.tabulate(by_level.gain, by_level.offset, decoded, nodes)
        out, unknown, beyond, clipped = kernels.look_up(flat, bits, colors, by_level.capped)
    else:
        out, unknown, beyond, clipped = kernels.compute(flat, bits, by_level.gain, by_level.offset, decoded, nodes, by_level.capped)
    if config.unknown_pixels == "raw":
        out[unknown] = flat[unknown]
    shape = image.shape[:2]
    valid = bits.size - int(np.count_nonzero(unknown))
    return Correction(
        image=out.reshape(image.shape),
        unknown=unknown.reshape(shape),
        unrecoverable=beyond.reshape(shape),
        clipped_share=clipped / max(valid, 1),
        water=water,
        exposure=by_level.exposure,
        warnings=water.warnings,
    )


def correct_linear(
    image: Image, range_m: Map, water: Water, table: MomentTable, config: ColorConfig, exposure: float = 1.0
) -> NDArray[np.float32]:
    """(H, W, 3) float32 linear J, unclipped, 1 = full scale at exposure 1; 0 where the range is unknown."""
    from stereo_seecolor.color import kernels

    by_level = gains(table, water, config, exposure)
    decoded = decoded_values(table.bit_depth, config.input_encoding)
    flat: NDArray[Any] = np.ascontiguousarray(image).reshape(-1, 3)
    return kernels.linear(flat, range_bits(image, range_m), by_level.gain, by_level.offset, decoded).reshape(image.shape)


def _exposure(table: MomentTable, gain: NDArray[np.float64], backscatter: NDArray[np.float64], config: ColorConfig) -> float:
    """The factor at which no more than the stated share of the pixels has a channel at full scale; 1 for a black image."""
    from stereo_seecolor.color import kernels

    occupied = np.flatnonzero(table.pixels)
    middle = occupied * FINE + FINE // 2
    light = decoded_bins(table.bit_depth, config.input_encoding)
    allowed = int(config.clipped_share * table.pixels.sum())
    near = gain[:, middle]
    brightest = float(kernels.brightest(table.counts[:, occupied], light, near, near * backscatter[:, middle], allowed))
    full = 2.0**table.bit_depth - 1
    limit = float(decode(np.array((full - 0.6) / full), "srgb" if config.input_encoding != "as-is" else "as-is"))
    return limit / brightest if brightest > 0 else 1.0


def _noise(table: MomentTable, config: ColorConfig) -> NDArray[np.float64]:
    """(3,) noise of a channel in linear light: the config's, times the slope of the decoding at the channel's mean value."""
    total = max(int(table.pixels.sum()), 1)
    mean = table.counts.sum(axis=1) @ table.values / total
    step = 0.5 * config.input_noise
    slope = (decode(mean + step, config.input_encoding) - decode(mean - step, config.input_encoding)) / (2 * step)
    return np.asarray(slope * config.input_noise)
