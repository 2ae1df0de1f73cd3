"""Four pixels, sixteen disparities each, at a time: the vector steps of semi-global matching.

Numba widens 8 and 16-bit arithmetic to 64 bits and so misses the vector unit, so each step is
written out as LLVM vector code, which every processor that numba knows can run. All arrays are C
contiguous; a slice a[i:] means the elements that the step needs from i on, and nothing checks that
they exist. A block is PIXELS pieces, a piece one pixel's LANES costs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from stereo_seecolor.matching.sgm.band import BLOCK, FAR, LANES, P1_SHIFT, PIXELS, TILE, WINDOW

_BYTE, _SHORT, _WORD, _PIECE_BITS = (ir.IntType(bits) for bits in (8, 16, 32, 128))
_PIECE = ir.VectorType(_BYTE, LANES)
_BLOCK = ir.VectorType(_BYTE, BLOCK)
_PER_PIXEL = ir.VectorType(_BYTE, PIXELS)
_SHORTS, _WORDS = ir.VectorType(_SHORT, LANES), ir.VectorType(_WORD, LANES)
_TILE_SHORTS = ir.VectorType(_SHORT, TILE)
_WINDOW, _WIDE_WINDOW = ir.VectorType(_SHORT, WINDOW), ir.VectorType(_WORD, WINDOW)
_BLOCK_SHORTS = ir.VectorType(_SHORT, BLOCK)
_LANE = ir.Constant(_SHORTS, list(range(LANES)))
_FAR = ir.Constant(_BLOCK, [FAR] * BLOCK)


@dataclass(frozen=True)
class _Memory:
    """An array argument of a step: where its elements are loaded from and stored to. align: of an
    element, bytes.
    """

    context: Any
    builder: Any
    type: Any
    array: Any
    align: int = 1

    def load(self, index: Any, vector: Any) -> Any:
        """A vector from array[index:] on."""
        value = self.builder.load(self._at(index, vector))
        value.align = self.align  # elements, not vectors, are aligned
        return value

    def store(self, index: Any, value: Any) -> None:
        """A vector to array[index:]."""
        self.builder.store(value, self._at(index, value.type), align=self.align)

    def _at(self, index: Any, vector: Any) -> Any:
        data = self.context.make_array(self.type)(self.context, self.builder, self.array).data
        return self.builder.bitcast(self.builder.gep(data, [index]), vector.as_pointer())


_INDEX, _ARRAY = types.intp, None
"""Kinds of arguments; an array's is whatever the caller has."""


def _step_of(*kinds: Any, result: Any = types.void) -> Callable[..., Callable[..., Any]]:
    """Make a step that compiled functions call of the function that writes its code: it is given
    the builder and the arguments, arrays as ``_Memory``, and returns the result, if there is one.
    """

    def made(write: Callable[..., Any]) -> Callable[..., Any]:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            taken = [
                _Memory(context, builder, kind, argument, max(1, kind.dtype.bitwidth // 8))
                if isinstance(kind, types.Array)
                else argument
                for kind, argument in zip(signature.args, arguments, strict=True)
            ]
            found = write(builder, *taken)
            return context.get_dummy_value() if found is None else found

        @wraps(write)
        def typed(typing: Any, *given: Any) -> Any:
            own = (one if kind is None else kind for kind, one in zip(kinds, given, strict=True))
            return result(*own), generate

        step: Callable[..., Any] = intrinsic(typed)
        return step

    return made


@_step_of(types.uint32, _ARRAY, _INDEX, _ARRAY, _INDEX)
def hamming(builder: Any, bits: Any, others: _Memory, i: Any, cost: _Memory, c: Any) -> None:
    """cost[c:] (a piece) = number of bits in which ``bits`` (uint32) differs from each of
    others[i:] (uint32).
    """
    met = others.load(i, _WORDS)
    count = _call(
        builder, "llvm.ctpop.v16i32", _WORDS, builder.xor(met, _splat(builder, bits, _WORDS))
    )
    cost.store(c, builder.trunc(count, _PIECE))


@_step_of(_ARRAY, _INDEX, _INDEX, _ARRAY, _INDEX, _INDEX, _ARRAY, _INDEX, _INDEX)
def step(
    builder: Any, paths: _Memory, before: Any, now: Any, cost: _Memory, c: Any, cost_stride: Any,
    p2: _Memory, j: Any, p2_stride: Any,
) -> None:  # fmt: skip
    """One step of the paths of four pixels of LANES disparities each (Hirschmueller 2008, eq. 13).

    paths[now:] = cost + min(b, b of the disparity below + P1, above + P1, floor + P2) - floor for b
    = paths[before:], floor each pixel's least b, P1 = P2 >> P1_SHIFT. The pixels' costs lie
    cost_stride apart from cost[c] on, their P2 p2_stride from p2[j] on.
    """
    same = paths.load(before, _BLOCK)
    penalties, here = _penalties(p2, j, p2_stride), _gather(cost, c, cost_stride)
    result = _step(builder, (_FAR, same, _FAR), _floor(builder, same), here, penalties)
    paths.store(now, result)


@_step_of(_ARRAY, _INDEX, _ARRAY, _INDEX, _ARRAY, _INDEX, _INDEX, _ARRAY, _INDEX, _INDEX, _INDEX)
def steps(
    builder: Any, paths: _Memory, at: Any, cost: _Memory, c: Any, along: _Memory, onward: Any,
    stride: Any, p2: _Memory, j: Any, j_onward: Any, p2_stride: Any,
) -> None:  # fmt: skip
    """TILE steps of the paths along TILE rows, from paths[at:] and back to it; each also to
    ``along``, laid out as ``cost``.

    From one step to the next, costs lie ``onward`` and P2 ``j_onward`` apart.
    """
    halves = [_further(builder, at, half * BLOCK) for half in range(TILE // PIXELS)]
    same = [paths.load(half, _BLOCK) for half in halves]
    for _ in range(TILE):
        for half in range(len(halves)):
            row = _nth(builder, c, stride, half * PIXELS)
            p2_row = _nth(builder, j, p2_stride, half * PIXELS)
            here, penalties = _gather(cost, row, stride), _penalties(p2, p2_row, p2_stride)
            same[half] = _step(
                builder, (_FAR, same[half], _FAR), _floor(builder, same[half]), here, penalties
            )
            _scatter(along, row, stride, same[half])
        c, j = builder.add(c, onward), builder.add(j, j_onward)
    for half, result in zip(halves, same, strict=True):
        paths.store(half, result)


@_step_of(
    _ARRAY, _INDEX, _INDEX, _INDEX, _INDEX, _INDEX, _ARRAY, _INDEX, _INDEX, _ARRAY, _INDEX, _INDEX
)
def step_of_many(
    builder: Any, paths: _Memory, below: Any, before: Any, above: Any, floor: Any, now: Any,
    cost: _Memory, c: Any, cost_stride: Any, p2: _Memory, j: Any, p2_stride: Any,
) -> None:  # fmt: skip
    """As step, for one block of several: paths[below:] and paths[above:] are the blocks beside it,
    the floor is paths[floor:]'s.
    """
    under, same, over, least = (
        paths.load(place, _BLOCK) for place in (below, before, above, floor)
    )
    penalties, here = _penalties(p2, j, p2_stride), _gather(cost, c, cost_stride)
    result = _step(builder, (under, same, over), _floor(builder, least), here, penalties)
    paths.store(now, result)


@_step_of(_ARRAY, _INDEX, _INDEX, _INDEX)
def fold(builder: Any, paths: _Memory, i: Any, j: Any, least: Any) -> None:
    """paths[least:] = min(paths[i:], paths[j:]), a block."""
    paths.store(least, _minimum(builder, paths.load(i, _BLOCK), paths.load(j, _BLOCK)))


@_step_of(_ARRAY, _INDEX, _ARRAY, _INDEX, _INDEX)
def scatter(builder: Any, paths: _Memory, i: Any, rows: _Memory, r: Any, stride: Any) -> None:
    """The four pieces of the block paths[i:] to rows[r:], rows[r + stride:] and so on."""
    _scatter(rows, r, stride, paths.load(i, _BLOCK))


@_step_of(_ARRAY, _INDEX, _ARRAY, _INDEX, _ARRAY, _INDEX)
def add(builder: Any, a: _Memory, i: Any, b: _Memory, j: Any, total: _Memory, t: Any) -> None:
    """total[t:] = a[i:] + b[j:], a block; the sum is below 256."""
    total.store(t, builder.add(a.load(i, _BLOCK), b.load(j, _BLOCK)))


@_step_of(_ARRAY, _INDEX, _ARRAY, _INDEX, _ARRAY, _INDEX, _ARRAY, _INDEX)
def add_wide(
    builder: Any, a: _Memory, i: Any, b: _Memory, j: Any, c: _Memory, k: Any, total: _Memory, t: Any
) -> None:
    """total[t:] (uint16) = a[i:] + b[j:] + c[k:], a block."""
    first, second, third = (
        builder.zext(memory.load(place, _BLOCK), _BLOCK_SHORTS)
        for memory, place in zip((a, b, c), (i, j, k), strict=True)
    )
    total.store(t, builder.add(first, builder.add(second, third)))


@_step_of(_ARRAY, _INDEX, _INDEX, _INDEX, _INDEX)
def slide(builder: Any, a: _Memory, low: Any, high: Any, by: Any, t: Any) -> None:
    """a[t:] (a piece) = the LANES elements from ``by`` (0..LANES - 1) on of the pieces a[low:] and
    a[high:] put end to end.
    """
    first, second = a.load(low, _PIECE_BITS), a.load(high, _PIECE_BITS)
    bits = builder.zext(builder.shl(by, ir.Constant(by.type, 3)), _PIECE_BITS)
    piece = _call(builder, "llvm.fshr.i128", _PIECE_BITS, second, first, bits)
    a.store(t, piece)


@_step_of(_ARRAY, _INDEX, types.int16, _ARRAY, _INDEX, _INDEX)
def winners(
    builder: Any, sums: _Memory, i: Any, low: Any, facts: _Memory, x: Any, stride: Any
) -> None:
    """The least of each of the TILE x LANES uint16 sums[i:], all below 4096, of pixels whose bands
    start at ``low`` (int16).

    To facts[x:] (int16) go their disparities; ``stride`` further the sums there; then the least
    beyond +-1 of it; then those one below and one above it, -1 where the band ends.
    """
    pixels = [sums.load(_further(builder, i, pixel * LANES), _SHORTS) for pixel in range(TILE)]
    four = ir.Constant(_SHORTS, [4] * LANES)
    keys = _least_of_each(
        builder, [builder.or_(builder.shl(values, four), _LANE) for values in pixels]
    )
    lanes = builder.and_(keys, ir.Constant(_TILE_SHORTS, [LANES - 1] * TILE))
    before = builder.sub(lanes, ir.Constant(_TILE_SHORTS, [1] * TILE))
    never = ir.Constant(_SHORTS, [0xFFFF] * LANES)
    offsets = [
        builder.sub(_LANE, builder.shuffle_vector(before, before, _mask([pixel] * LANES)))
        for pixel in range(TILE)
    ]

    def least_where(condition: str, offset: int) -> Any:
        bound = ir.Constant(_SHORTS, [offset] * LANES)
        kept = [builder.icmp_unsigned(condition, offsets[pixel], bound) for pixel in range(TILE)]
        return _least_of_each(
            builder,
            [
                builder.select(keep, values, never)
                for keep, values in zip(kept, pixels, strict=True)
            ],
        )

    found = (
        builder.add(lanes, _splat(builder, low, _TILE_SHORTS)),
        builder.lshr(keys, ir.Constant(_TILE_SHORTS, [4] * TILE)),
        least_where(">=", 3),
        least_where("==", 0),
        least_where("==", 2),
    )
    for row, values in enumerate(found):
        facts.store(_nth(builder, x, stride, row), values)


@_step_of(_ARRAY, _INDEX, result=types.uint16)
def smallest(builder: Any, a: _Memory, i: Any) -> Any:
    """min(a[i:]) * 16 + its first lane, of LANES uint16 below 4096."""
    values = a.load(i, _SHORTS)
    keys = builder.or_(builder.shl(values, ir.Constant(_SHORTS, [4] * LANES)), _LANE)
    return _call(builder, "llvm.vector.reduce.umin.v16i16", _SHORT, keys)


@_step_of(_ARRAY, _INDEX, types.int16, result=types.uint16)
def smallest_but(builder: Any, a: _Memory, i: Any, center: Any) -> Any:
    """min(a[i:]) of LANES uint16 without the lanes center - 1, center and center + 1 (center:
    int16, may lie outside).
    """
    values = a.load(i, _SHORTS)
    first = _splat(builder, builder.sub(center, ir.Constant(_SHORT, 1)), _SHORTS)
    near = builder.icmp_unsigned("<", builder.sub(_LANE, first), ir.Constant(_SHORTS, [3] * LANES))
    others = builder.select(near, ir.Constant(_SHORTS, [0xFFFF] * LANES), values)
    return _call(builder, "llvm.vector.reduce.umin.v16i16", _SHORT, others)


@_step_of(_ARRAY, _INDEX, types.int16, _ARRAY, _INDEX)
def claim(builder: Any, sums: _Memory, i: Any, first: Any, best: _Memory, j: Any) -> None:
    """The TILE x LANES uint16 sums[i:] of a row of a tile claim pixels of the right image.

    best (uint32): sum * 2^16 + disparity - NEVER, the least wins, then the first pixel. Lane l of
    pixel p looks at best[j - p + l], with disparity first + l (int16). A sum of 2^16 - 1 claims
    nothing.
    """
    keys = ir.Constant(_WINDOW, [0xFFFF] * WINDOW)
    for pixel in range(TILE):
        lead = TILE - 1 - pixel
        values = sums.load(_further(builder, i, pixel * LANES - lead), _WINDOW)
        own = [pixel if lead <= lane < lead + LANES else 0xFFFF for lane in range(WINDOW)]
        key = builder.or_(
            builder.shl(values, ir.Constant(_WINDOW, [3] * WINDOW)), ir.Constant(_WINDOW, own)
        )
        keys = _minimum(builder, keys, key)
    place = _further(builder, j, 1 - TILE)
    wide = builder.zext(keys, _WIDE_WINDOW)
    pixel = builder.and_(wide, ir.Constant(_WIDE_WINDOW, [TILE - 1] * WINDOW))
    cost = builder.shl(
        builder.lshr(wide, ir.Constant(_WIDE_WINDOW, [3] * WINDOW)),
        ir.Constant(_WIDE_WINDOW, [16] * WINDOW),
    )
    lane = builder.add(
        pixel,
        ir.Constant(
            _WIDE_WINDOW, [(lane - TILE + 1 + 0x8000) & 0xFFFFFFFF for lane in range(WINDOW)]
        ),
    )
    disparity = builder.add(lane, _splat(builder, builder.sext(first, _WORD), _WIDE_WINDOW))
    claimed = builder.or_(cost, disparity)
    best.store(place, _minimum(builder, best.load(place, _WIDE_WINDOW), claimed))


def _step(
    builder: Any, beside: tuple[Any, Any, Any], floor: Any, here: Any, penalties: tuple[Any, Any]
) -> Any:
    """beside: the blocks below, here and above. penalties: P1 and P2 of each pixel."""
    under, same, over = beside
    p1, p2 = penalties
    below = builder.shuffle_vector(
        under, same, _mask(_beside([LANES - 1, *range(BLOCK, BLOCK + LANES - 1)]))
    )
    above = builder.shuffle_vector(same, over, _mask(_beside([*range(1, LANES), BLOCK])))
    slope = _saturated(builder, _minimum(builder, below, above), p1)
    best = _minimum(builder, _minimum(builder, same, slope), _saturated(builder, floor, p2))
    return builder.add(here, builder.sub(best, floor))


def _beside(lanes: list[int]) -> list[int]:
    """Of two blocks end to end: ``lanes``, of a block's first pixel, for all its pixels."""
    return [pixel * LANES + lane for pixel in range(PIXELS) for lane in lanes]


def _least_of_each(builder: Any, pixels: list[Any]) -> Any:
    """The least of each of TILE vectors of LANES, as one vector: halved and joined in pairs until
    one is left.
    """
    lanes = LANES
    while len(pixels) > 1:
        half, groups = lanes // 2, LANES // lanes
        low, high = (
            _mask(
                [
                    side * LANES + group * lanes + first + lane
                    for group in range(groups)
                    for side in (0, 1)
                    for lane in range(half)
                ]
            )
            for first in (0, half)
        )
        pairs = list(zip(pixels[::2], pixels[1::2], strict=True))
        pixels = [
            _minimum(builder, builder.shuffle_vector(a, b, low), builder.shuffle_vector(a, b, high))
            for a, b in pairs
        ]
        lanes = half
    mirrored_bits = (0, 4, 2, 6, 1, 5, 3, 7)  # the order that joining in pairs leaves the pixels in
    even, odd = (_mask([2 * place + first for place in mirrored_bits]) for first in (0, 1))
    return _minimum(
        builder, *(builder.shuffle_vector(pixels[0], pixels[0], mask) for mask in (even, odd))
    )


def _floor(builder: Any, block: Any) -> Any:
    """Each piece's least value, in all its lanes."""
    for turn in (8, 4, 2, 1):
        turned = [
            pixel * LANES + (lane + turn) % LANES
            for pixel in range(PIXELS)
            for lane in range(LANES)
        ]
        block = _minimum(builder, block, builder.shuffle_vector(block, block, _mask(turned)))
    return block


def _gather(costs: _Memory, index: Any, stride: Any) -> Any:
    a, b, c, d = (
        costs.load(_nth(costs.builder, index, stride, pixel), _PIECE) for pixel in range(PIXELS)
    )
    two = _mask(range(2 * LANES))
    shuffle = costs.builder.shuffle_vector
    return shuffle(shuffle(a, b, two), shuffle(c, d, two), _mask(range(BLOCK)))


def _scatter(rows: _Memory, index: Any, stride: Any, block: Any) -> None:
    for pixel in range(PIXELS):
        piece = rows.builder.shuffle_vector(
            block, block, _mask(range(pixel * LANES, (pixel + 1) * LANES))
        )
        rows.store(_nth(rows.builder, index, stride, pixel), piece)


def _penalties(p2: _Memory, index: Any, stride: Any) -> tuple[Any, Any]:
    """P1 and P2 of PIXELS pixels, each in all the lanes of its piece."""
    builder, values = p2.builder, ir.Constant(_PER_PIXEL, ir.Undefined)
    for pixel in range(PIXELS):
        value = p2.load(_nth(builder, index, stride, pixel), _BYTE)
        values = builder.insert_element(values, value, ir.Constant(_WORD, pixel))
    lanes = _mask([pixel for pixel in range(PIXELS) for _ in range(LANES)])
    slopes = builder.lshr(values, ir.Constant(_PER_PIXEL, [P1_SHIFT] * PIXELS))
    return builder.shuffle_vector(slopes, slopes, lanes), builder.shuffle_vector(
        values, values, lanes
    )


def _further(builder: Any, index: Any, by: int) -> Any:
    return builder.add(index, ir.Constant(index.type, by))


def _nth(builder: Any, index: Any, stride: Any, n: int) -> Any:
    return builder.add(index, builder.mul(stride, ir.Constant(stride.type, n)))


def _mask(lanes: Any) -> Any:
    lanes = list(lanes)
    return ir.Constant(ir.VectorType(_WORD, len(lanes)), lanes)


def _splat(builder: Any, scalar: Any, vector: Any) -> Any:
    undefined = ir.Constant(vector, ir.Undefined)
    single = builder.insert_element(undefined, scalar, ir.Constant(_WORD, 0))
    return builder.shuffle_vector(single, undefined, _mask([0] * vector.count))


def _minimum(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.icmp_unsigned("<", a, b), a, b)


def _saturated(builder: Any, a: Any, b: Any) -> Any:
    return _call(builder, "llvm.uadd.sat.v64i8", _BLOCK, a, b)


def _call(builder: Any, name: str, result: Any, *arguments: Any) -> Any:
    declare: Any = cgutils.get_or_insert_function
    function = declare(
        builder.module, ir.FunctionType(result, [argument.type for argument in arguments]), name
    )
    return builder.call(function, arguments)
