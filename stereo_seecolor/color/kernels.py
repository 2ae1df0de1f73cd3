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

from stereo_seecolor.color.tables import LEVELS, LOW_BITS, NEAREST_M

FINE_LEVELS = 4 * LEVELS
"""Levels of gain: steps of 0.4 to 0.8 % in range, too fine to be seen as bands."""

_FIRST = int(np.float32(NEAREST_M).view(np.int32))
_INFINITY = int(np.float32(np.inf).view(np.int32))
_LAST = (LEVELS << LOW_BITS) - 1
_LOW = (1 << LOW_BITS) - 1
_FINE_BITS = LOW_BITS - 2


def count(image: NDArray[Any], bits: NDArray[np.int32], values: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Counts (3, 256, values) and offset sums (256,) of (N, 3) pixels with the (N,) bits of their ranges."""
    shift = 0 if image.dtype == np.uint8 else 4
    bounds = _bounds(bits.size)
    counts = np.zeros((len(bounds), 3, LEVELS, values), np.int32)
    offsets = np.zeros((len(bounds), LEVELS), np.int64)

    def part(i: int) -> None:
        _count(image, bits, shift, *bounds[i], counts[i], offsets[i])

    _spread(part, len(bounds))
    return counts.sum(axis=0, dtype=np.int64), offsets.sum(axis=0)


def look_up(
    image: NDArray[np.uint8], bits: NDArray[np.int32], table: NDArray[np.uint8], capped: NDArray[np.bool_]
) -> tuple[NDArray[np.uint8], NDArray[np.bool_], NDArray[np.bool_], int]:
    """(N, 3) pixels through table (3, 1024, 256); unknown; whose level is capped; how many have a channel at full scale."""
    out, unknown, beyond = np.empty_like(image), np.empty(bits.size, np.bool_), np.empty(bits.size, np.bool_)
    bounds = _bounds(bits.size)
    clipped = [0] * len(bounds)

    def part(i: int) -> None:
        clipped[i] = _look_up(image, bits, table, capped, *bounds[i], out, unknown, beyond)

    _spread(part, len(bounds))
    return out, unknown, beyond, sum(clipped)


def compute(
    image: NDArray[np.uint16],
    bits: NDArray[np.int32],
    gain: NDArray[np.float32],
    offset: NDArray[np.float32],
    decoded: NDArray[np.float32],
    nodes: NDArray[np.float32],
    capped: NDArray[np.bool_],
) -> tuple[NDArray[np.uint16], NDArray[np.bool_], NDArray[np.bool_], int]:
    """What ``look_up`` gives, for 16 bits: gain[c, level] * decoded[value] - offset[c, level], through the curve of ``nodes``."""
    out, unknown, beyond = np.empty_like(image), np.empty(bits.size, np.bool_), np.empty(bits.size, np.bool_)
    bounds = _bounds(bits.size)
    clipped = [0] * len(bounds)

    def part(i: int) -> None:
        clipped[i] = _compute(image, bits, gain, offset, decoded, nodes, capped, *bounds[i], out, unknown, beyond)

    _spread(part, len(bounds))
    return out, unknown, beyond, sum(clipped)


def linear(
    image: NDArray[Any],
    bits: NDArray[np.int32],
    gain: NDArray[np.float32],
    offset: NDArray[np.float32],
    decoded: NDArray[np.float32],
) -> NDArray[np.float32]:
    """(N, 3) float32 gain[c, level] * decoded[value] - offset[c, level], neither clipped nor encoded; 0 where unknown."""
    out = np.empty(image.shape, np.float32)
    bounds = _bounds(bits.size)
    _spread(lambda i: _linear(image, bits, gain, offset, decoded, *bounds[i], out), len(bounds))
    return out


def tabulate(
    gain: NDArray[np.float32], offset: NDArray[np.float32], decoded: NDArray[np.float32], nodes: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """The table (3, 1024, 256) that ``look_up`` takes."""
    table = np.empty((3, FINE_LEVELS, 256), np.uint8)
    _spread(lambda c: _tabulate(gain[c], offset[c], decoded, nodes, table[c]), 3)
    return table


def _bounds(pixels: int) -> list[tuple[int, int]]:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    parts = max(1, min(cores, 8, pixels // 65536))
    return list(itertools.pairwise(pixels * i // parts for i in range(parts + 1)))


def _spread(part: Callable[[int], None], parts: int) -> None:
    if parts == 1:
        part(0)
        return
    with ThreadPoolExecutor(parts) as pool:
        list(pool.map(part, range(parts)))


@njit(cache=True, nogil=True)
def _count(image, bits, shift, start, stop, counts, offsets):  # type: ignore[no-untyped-def]  # pragma: no cover
    for i in range(start, stop):
        if 0 < bits[i] < _INFINITY:  # positive and finite: NaN, infinities, zero and negative numbers are outside
            offset = min(max(bits[i] - _FIRST, 0), _LAST)
            level = offset >> LOW_BITS
            offsets[level] += offset & _LOW
            for channel in range(3):
                counts[channel, level, image[i, channel] >> shift] += 1


@njit(cache=True, nogil=True)
def _look_up(image, bits, table, capped, start, stop, out, unknown, beyond):  # type: ignore[no-untyped-def]  # pragma: no cover
    clipped = 0
    for i in range(start, stop):
        if 0 < bits[i] < _INFINITY:
            level = min(max(bits[i] - _FIRST, 0), _LAST) >> _FINE_BITS
            red, green, blue = table[0, level, image[i, 0]], table[1, level, image[i, 1]], table[2, level, image[i, 2]]
            out[i, 0], out[i, 1], out[i, 2] = red, green, blue
            unknown[i], beyond[i] = False, capped[level]
            clipped += max(red, green, blue) == 255
        else:
            out[i, 0], out[i, 1], out[i, 2] = 0, 0, 0
            unknown[i], beyond[i] = True, False
    return clipped


@njit(cache=True, nogil=True)
def _encoded(light, nodes):  # type: ignore[no-untyped-def]  # pragma: no cover
    place = min(max(light, np.float32(0)), np.float32(1)) * np.float32(nodes.size - 2)
    node = int(place)
    return int(nodes[node] + (nodes[node + 1] - nodes[node]) * (place - np.float32(node)))


@njit(cache=True, nogil=True)
def _tabulate(gain, offset, decoded, nodes, table):  # type: ignore[no-untyped-def]  # pragma: no cover
    for level in range(gain.size):
        for value in range(256):
            table[level, value] = _encoded(gain[level] * decoded[value] - offset[level], nodes)


@njit(cache=True, nogil=True)
def _compute(image, bits, gain, offset, decoded, nodes, capped, start, stop, out, unknown, beyond):  # type: ignore[no-untyped-def]  # pragma: no cover
    clipped = 0
    for i in range(start, stop):
        unknown[i], beyond[i] = True, False
        full = False
        if 0 < bits[i] < _INFINITY:
            level = min(max(bits[i] - _FIRST, 0), _LAST) >> _FINE_BITS
            unknown[i], beyond[i] = False, capped[level]
            for c in range(3):
                out[i, c] = _encoded(gain[c, level] * decoded[image[i, c]] - offset[c, level], nodes)
                full |= out[i, c] == 65535
        else:
            out[i, 0], out[i, 1], out[i, 2] = 0, 0, 0
        clipped += full
    return clipped


@njit(cache=True, nogil=True)
def _linear(image, bits, gain, offset, decoded, start, stop, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    for i in range(start, stop):
        if 0 < bits[i] < _INFINITY:
            level = min(max(bits[i] - _FIRST, 0), _LAST) >> _FINE_BITS
            for c in range(3):
                out[i, c] = gain[c, level] * decoded[image[i, c]] - offset[c, level]
        else:
            out[i, 0], out[i, 1], out[i, 2] = 0, 0, 0


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
