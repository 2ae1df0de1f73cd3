"""The loops that touch every pixel, on all cores. Counts are integers: the same result whatever the number of threads.

Compiled without numba's own threads, whose simplest layer must not be entered by two threads at once: each call spreads its
parts over a few threads of its own.
"""

import itertools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stereo_seecolor.color.gains import FINE, FINE_LEVELS, Gains
from stereo_seecolor.color.tables import LEVELS, LOW_BITS, NEAREST_M

U = np.uint64
ZERO, ONE, PIXEL = np.int32(0), np.int32(1), np.int64(1 << 40)
BLOCK = 2048
MOST = 1 << 22
"""Pixels of one part: their places in a level then add up to less than 40 bits."""
_FIRST = int(np.float32(NEAREST_M).view(np.int32))
_INFINITY = int(np.float32(np.inf).view(np.int32))
_LAST = (LEVELS << LOW_BITS) - 1
_LOW = (1 << LOW_BITS) - 1
_FINE_BITS = LOW_BITS - FINE.bit_length() + 1


def count(image: NDArray[Any], bits: NDArray[np.int32], values: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Counts (3, 256, values) and offset sums (256,) of (N * 3,) pixels with the (N,) bits of their ranges."""
    shift = 0 if image.dtype == np.uint8 else 4
    bounds = _bounds(bits.size)
    # red's counter holds its pixels above 40 bits, and below them the sum of their places in the level: one addition for both
    red = np.zeros((len(bounds), LEVELS + 1, values), np.int64)
    others = np.zeros((len(bounds), LEVELS + 1, 2, values), np.int32)

    def part(i: int) -> None:
        a, b = bounds[i]
        _count(image[3 * a : 3 * b], bits[a:b], shift, red[i].reshape(-1), others[i].reshape(-1))

    _spread(part, len(bounds))
    known, place_sum = red[:, :LEVELS], np.zeros(LEVELS, np.int64)
    counts = np.empty((3, LEVELS, values), np.int64)
    (known >> 40).sum(axis=0, out=counts[0])
    place_sum = (known & (PIXEL - 1)).sum(axis=(0, 2))
    others[:, :LEVELS].transpose(0, 2, 1, 3).sum(axis=0, out=counts[1:])
    return counts, place_sum


def apply(
    image: NDArray[Any], bits: NDArray[np.int32], by_level: Gains, decoded: NDArray[np.float32], curve: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[np.bool_], NDArray[np.bool_], int]:
    """(N * 3,) pixels through gain[c, level] * decoded[value] - offset[c, level] and the encoding curve; 0 where unknown.

    Gives the pixels; (N,) unknown; (N,) whose level is capped; how many pixels have a channel at full scale.
    """
    out, unknown, beyond = np.empty_like(image), np.empty(bits.size, np.bool_), np.zeros(bits.size, np.bool_)
    bounds = _bounds(bits.size)
    clipped: dict[int, int] = {}
    table = color_table(by_level, decoded, curve) if image.dtype == np.uint8 else None
    full = out.dtype.type(np.iinfo(out.dtype).max)
    runs = _runs(by_level.capped)

    def part(i: int) -> None:
        a, b = bounds[i]
        if table is not None:
            _look_up(image[3 * a : 3 * b], bits[a:b], table, out[3 * a : 3 * b])
        else:
            _compute(image[3 * a : 3 * b], bits[a:b], by_level.gain, by_level.offset, decoded, curve, out[3 * a : 3 * b])
        _outside(bits[a:b], unknown[a:b])
        for low, high in runs:
            _between(bits[a:b], low, high, beyond[a:b])
        clipped[i] = _full(out[3 * a : 3 * b], full)

    _spread(part, len(bounds))
    return out, unknown, beyond, sum(clipped.values())


def linear(image: NDArray[Any], bits: NDArray[np.int32], by_level: Gains, decoded: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N * 3,) float32 gain[c, level] * decoded[value] - offset[c, level], neither clipped nor encoded; 0 where unknown."""
    out = np.empty(image.size, np.float32)
    bounds = _bounds(bits.size)

    def part(i: int) -> None:
        a, b = bounds[i]
        _linear(image[3 * a : 3 * b], bits[a:b], by_level.gain, by_level.offset, decoded, out[3 * a : 3 * b])

    _spread(part, len(bounds))
    return out


def _runs(capped: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """From which bits of a range to before which the fine levels are capped; the first and the last level have no end."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], capped, [False]]).astype(np.int8)))
    ends = [1 if at == 0 else _INFINITY if at == FINE_LEVELS else _FIRST + (int(at) << _FINE_BITS) for at in change]
    return list(zip(ends[::2], ends[1::2], strict=True))


def color_table(by_level: Gains, decoded: NDArray[np.float32], curve: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(1025 * 768,) what each value of each channel becomes at each fine level; the last level, unknown, is black."""
    table = np.zeros((FINE_LEVELS + 1, 3, 256), np.uint8)
    for c in range(3):
        _tabulate(by_level.gain[c], by_level.offset[c], decoded, curve, table[:, c])
    return table.reshape(-1)


def _bounds(pixels: int) -> list[tuple[int, int]]:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    parts = max(1, min(cores, 8, pixels // 65536), -(-pixels // MOST))
    return list(itertools.pairwise(pixels * i // parts for i in range(parts + 1)))


def _spread(part: Callable[[int], None], parts: int) -> None:
    if parts == 1:
        part(0)
        return
    with ThreadPoolExecutor(parts - 1) as pool:
        others = [pool.submit(part, i) for i in range(1, parts)]
        part(0)
        for other in others:
            other.result()


@njit(cache=True, nogil=True)
def _levels(bits, fine, levels):  # type: ignore[no-untyped-def]  # pragma: no cover
    """The place of each range among the levels, in their low bits if not ``fine``; past the last where it is not known."""
    zero, infinity, first, last = ZERO, np.int32(_INFINITY), np.int32(_FIRST), np.int32(_LAST)
    shift, none = np.int32(_FINE_BITS if fine else 0), np.int32(_LAST + 1)
    for i in range(bits.size):  # 32-bit arithmetic and no branch: the compiler does eight at a time
        place = min(max(bits[i] - first, zero), last)
        known = (bits[i] > zero) & (bits[i] < infinity)  # NaN, infinities, zero and negative numbers are not
        levels[i] = np.uint32((place if known else none) >> shift)


@njit(cache=True, nogil=True)
def _count(image, bits, shift, red, others):  # type: ignore[no-untyped-def]  # pragma: no cover
    # flat arrays and unsigned indices: numba then leaves out its tests for negative ones
    block = np.empty(BLOCK, np.uint32)
    values, shift = U(red.size // (LEVELS + 1)), U(shift)
    at = U(0)
    for start in range(0, bits.size, BLOCK):
        part = bits[start : start + BLOCK]
        _levels(part, False, block)
        for i in range(part.size):
            place = U(block[i])
            row = (place >> U(LOW_BITS)) * values
            red[row + (U(image[at]) >> shift)] += PIXEL + np.int64(place & U(_LOW))
            row += row
            others[row + (U(image[at + U(1)]) >> shift)] += ONE
            others[row + values + (U(image[at + U(2)]) >> shift)] += ONE
            at += U(3)


@njit(cache=True, nogil=True)
def _look_up(image, bits, table, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    block = np.empty(BLOCK, np.uint32)
    at = U(0)
    for start in range(0, bits.size, BLOCK):
        part = bits[start : start + BLOCK]
        _levels(part, True, block)
        for i in range(part.size):
            row = U(block[i]) * U(768)
            out[at] = table[row + U(image[at])]
            out[at + U(1)] = table[row + U(256) + U(image[at + U(1)])]
            out[at + U(2)] = table[row + U(512) + U(image[at + U(2)])]
            at += U(3)


@njit(cache=True, nogil=True)
def _compute(image, bits, gain, offset, decoded, nodes, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    block = np.empty(BLOCK, np.uint32)
    for start in range(0, bits.size, BLOCK):
        part = bits[start : start + BLOCK]
        _levels(part, True, block)
        for i in range(part.size):
            level, at = block[i], 3 * (start + i)
            for c in range(3):
                out[at + c] = (
                    0 if level == FINE_LEVELS else _encoded(gain[c, level] * decoded[image[at + c]] - offset[c, level], nodes)
                )


@njit(cache=True, nogil=True)
def _linear(image, bits, gain, offset, decoded, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    block = np.empty(BLOCK, np.uint32)
    for start in range(0, bits.size, BLOCK):
        part = bits[start : start + BLOCK]
        _levels(part, True, block)
        for i in range(part.size):
            level, at = block[i], 3 * (start + i)
            for c in range(3):
                out[at + c] = 0 if level == FINE_LEVELS else gain[c, level] * decoded[image[at + c]] - offset[c, level]


@njit(cache=True, nogil=True)
def _between(bits, low, high, inside):  # type: ignore[no-untyped-def]  # pragma: no cover
    low, high = np.int32(low), np.int32(high)
    for i in range(bits.size):
        inside[i] |= (bits[i] >= low) & (bits[i] < high)


@njit(cache=True, nogil=True)
def _outside(bits, unknown):  # type: ignore[no-untyped-def]  # pragma: no cover
    infinity = np.int32(_INFINITY)
    for i in range(bits.size):
        unknown[i] = (bits[i] <= ZERO) | (bits[i] >= infinity)


@njit(cache=True, nogil=True)
def _full(image, full):  # type: ignore[no-untyped-def]  # pragma: no cover
    number = 0
    for i in range(image.size // 3):
        number += (image[3 * i] == full) | (image[3 * i + 1] == full) | (image[3 * i + 2] == full)
    return number


@njit(cache=True, nogil=True)
def _encoded(light, nodes):  # type: ignore[no-untyped-def]  # pragma: no cover
    place = min(max(light, np.float32(0)), np.float32(1)) * np.float32(nodes.size - 2)
    node = int(place)
    return int(nodes[node] + (nodes[node + 1] - nodes[node]) * (place - np.float32(node)))


@njit(cache=True, nogil=True)
def _tabulate(gain, offset, decoded, encoded, table):  # type: ignore[no-untyped-def]  # pragma: no cover
    last = np.float32(encoded.size - 1)
    nearest = np.empty(256, np.int32)
    for level in range(gain.size):
        scale, shift = gain[level] * last, offset[level] * last - np.float32(0.5)
        for value in range(256):
            nearest[value] = np.int32(min(max(scale * decoded[value] - shift, np.float32(0)), last))
        for value in range(256):
            table[level, value] = encoded[np.uint32(nearest[value])]


@njit(cache=True, nogil=True)
def brightest(counts, light, gain, offset, allowed):  # type: ignore[no-untyped-def]  # pragma: no cover
    """The value that at most ``allowed`` of the channels' values gain * light - offset exceed, to 1/128 of an octave."""
    seen = np.zeros(0x7F80, np.int64)
    one = np.empty(1, np.float32)
    whole = one.view(np.int32)
    for c in range(3):
        for level in range(counts.shape[1]):
            for value in range(counts.shape[2]):
                if counts[c, level, value] > 0:
                    one[0] = max(gain[c, level] * light[value] - offset[c, level], 0.0)
                    seen[whole[0] >> 16] += counts[c, level, value]
    place = seen.size - 1
    while place > 0 and seen[place] <= allowed:
        allowed -= seen[place]
        place -= 1
    whole[0] = (place + 1) << 16
    return one[0] if place > 0 else np.float32(0)
