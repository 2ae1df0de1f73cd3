"""Four pixels, sixteen disparities each, at a time: the few vector steps that semi-global matching is made of.

Numba widens 8 and 16-bit arithmetic to 64 bits and so misses the vector unit, so each step is written out as LLVM vector
code, which every processor that numba knows can run. All arrays are C contiguous; a slice a[i:] means the elements that the
step needs from i on, and nothing checks that they exist. A block is PIXELS pieces, a piece one pixel's LANES costs.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from stereo_seecolor.matching.sgm.layout import BLOCK, FAR, LANES, PIXELS, TILE, WINDOW

_vector_code: Callable[[Callable[..., Any]], Callable[..., Any]] = intrinsic

_BYTE, _SHORT, _WORD, _PIECE_BITS = (ir.IntType(bits) for bits in (8, 16, 32, 128))
_PIECE, _BLOCK, _PER_PIXEL = ir.VectorType(_BYTE, LANES), ir.VectorType(_BYTE, BLOCK), ir.VectorType(_BYTE, PIXELS)
_SHORTS, _WORDS = ir.VectorType(_SHORT, LANES), ir.VectorType(_WORD, LANES)
_TILE_SHORTS = ir.VectorType(_SHORT, TILE)
_WINDOW, _WIDE_WINDOW = ir.VectorType(_SHORT, WINDOW), ir.VectorType(_WORD, WINDOW)
_BLOCK_SHORTS = ir.VectorType(_SHORT, BLOCK)
_LANE = ir.Constant(_SHORTS, list(range(LANES)))
_FAR = ir.Constant(_BLOCK, [FAR] * BLOCK)


@_vector_code
def hamming(typing: Any, bits: Any, others: Any, i: Any, cost: Any, c: Any) -> Any:
    """cost[c:] (a piece) = number of bits in which ``bits`` (uint32) differs from each of others[i:] (uint32)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        bits, others, i, cost, c = arguments
        met = _load(builder, _at(context, builder, signature.args[1], others, i, _WORDS), 4)
        count = _call(builder, "llvm.ctpop.v16i32", _WORDS, builder.xor(met, _splat(builder, bits, _WORDS)))
        builder.store(builder.trunc(count, _PIECE), _at(context, builder, signature.args[3], cost, c, _PIECE), align=1)
        return context.get_dummy_value()

    return types.void(types.uint32, others, types.intp, cost, types.intp), generate


@_vector_code
def step(
    typing: Any, paths: Any, before: Any, now: Any,
    cost: Any, c: Any, cost_stride: Any, p2: Any, j: Any, p2_stride: Any, P1: Any,
) -> Any:  # fmt: skip
    """One step of the paths of four pixels whose bands have LANES disparities each (Hirschmueller 2008, eq. 13).

    paths[now:] = cost + min(b, b of the disparity below + P1, above + P1, floor + P2) - floor for b = paths[before:], floor
    each pixel's least b. The pixels' costs lie cost_stride apart from cost[c] on, their P2 p2_stride from p2[j] on.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        paths, before, now, cost, c, cost_stride, p2, j, p2_stride, P1 = arguments
        same = _load_block(context, builder, signature.args[0], paths, before)
        here = _gather(context, builder, signature.args[3], cost, c, cost_stride)
        penalties = _p2_of_pixels(context, builder, signature.args[6], p2, j, p2_stride)
        result = _step(builder, _FAR, same, _FAR, _floor(builder, same), here, penalties, P1)
        _store_block(context, builder, signature.args[0], paths, now, result)
        return context.get_dummy_value()

    u8, i = types.uint8, types.intp
    return types.void(paths, i, i, cost, i, i, p2, i, i, u8), generate


@_vector_code
def steps(
    typing: Any, paths: Any, at: Any, cost: Any, c: Any, along: Any, onward: Any, stride: Any,
    p2: Any, j: Any, j_onward: Any, p2_stride: Any, P1: Any,
) -> Any:  # fmt: skip
    """TILE steps of the paths along TILE rows, from paths[at:] and back to it; each also to ``along``, laid out as ``cost``.

    From one step to the next, costs lie ``onward`` and P2 ``j_onward`` apart.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        paths, at, cost, c, along, onward, stride, p2, j, j_onward, p2_stride, P1 = arguments
        halves = [_further(builder, at, half * BLOCK) for half in range(TILE // PIXELS)]
        same = [_load_block(context, builder, signature.args[0], paths, half) for half in halves]
        for _ in range(TILE):
            for half in range(len(halves)):
                row, p2_row = _nth(builder, c, stride, half * PIXELS), _nth(builder, j, p2_stride, half * PIXELS)
                here = _gather(context, builder, signature.args[2], cost, row, stride)
                penalties = _p2_of_pixels(context, builder, signature.args[7], p2, p2_row, p2_stride)
                same[half] = _step(builder, _FAR, same[half], _FAR, _floor(builder, same[half]), here, penalties, P1)
                _scatter(context, builder, signature.args[4], along, row, stride, same[half])
            c, j = builder.add(c, onward), builder.add(j, j_onward)
        for half, result in zip(halves, same, strict=True):
            _store_block(context, builder, signature.args[0], paths, half, result)
        return context.get_dummy_value()

    u8, i = types.uint8, types.intp
    return types.void(paths, i, cost, i, along, i, i, p2, i, i, i, u8), generate


@_vector_code
def step_of_many(
    typing: Any, paths: Any, below: Any, before: Any, above: Any, floor: Any, now: Any,
    cost: Any, c: Any, cost_stride: Any, p2: Any, j: Any, p2_stride: Any, P1: Any,
) -> Any:  # fmt: skip
    """As step, for one block of several: paths[below:] and paths[above:] are the blocks beside it, the floor is paths[floor:]'s."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        paths, below, before, above, floor, now, cost, c, cost_stride, p2, j, p2_stride, P1 = arguments
        under, same, over, least = (
            _load_block(context, builder, signature.args[0], paths, place) for place in (below, before, above, floor)
        )
        here = _gather(context, builder, signature.args[6], cost, c, cost_stride)
        penalties = _p2_of_pixels(context, builder, signature.args[9], p2, j, p2_stride)
        result = _step(builder, under, same, over, _floor(builder, least), here, penalties, P1)
        _store_block(context, builder, signature.args[0], paths, now, result)
        return context.get_dummy_value()

    u8, i = types.uint8, types.intp
    return types.void(paths, i, i, i, i, i, cost, i, i, p2, i, i, u8), generate


@_vector_code
def fold(typing: Any, paths: Any, i: Any, j: Any, least: Any) -> Any:
    """paths[least:] = min(paths[i:], paths[j:]), a block."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        paths, i, j, least = arguments
        a, b = (_load_block(context, builder, signature.args[0], paths, place) for place in (i, j))
        _store_block(context, builder, signature.args[0], paths, least, _minimum(builder, a, b))
        return context.get_dummy_value()

    return types.void(paths, types.intp, types.intp, types.intp), generate


@_vector_code
def scatter(typing: Any, paths: Any, i: Any, rows: Any, r: Any, stride: Any) -> Any:
    """The four pieces of the block paths[i:] to rows[r:], rows[r + stride:] and so on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        paths, i, rows, r, stride = arguments
        block = _load_block(context, builder, signature.args[0], paths, i)
        _scatter(context, builder, signature.args[2], rows, r, stride, block)
        return context.get_dummy_value()

    return types.void(paths, types.intp, rows, types.intp, types.intp), generate


@_vector_code
def add(typing: Any, a: Any, i: Any, b: Any, j: Any, total: Any, t: Any) -> Any:
    """total[t:] = a[i:] + b[j:], a block; the sum is below 256."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, i, b, j, total, t = arguments
        first = _load_block(context, builder, signature.args[0], a, i)
        second = _load_block(context, builder, signature.args[2], b, j)
        _store_block(context, builder, signature.args[4], total, t, builder.add(first, second))
        return context.get_dummy_value()

    return types.void(a, types.intp, b, types.intp, total, types.intp), generate


@_vector_code
def add_wide(typing: Any, a: Any, i: Any, b: Any, j: Any, c: Any, k: Any, total: Any, t: Any) -> Any:
    """total[t:] (uint16) = a[i:] + b[j:] + c[k:], a block."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, i, b, j, c, k, total, t = arguments
        loads = ((0, a, i), (2, b, j), (4, c, k))
        first, second, third = (
            builder.zext(_load_block(context, builder, signature.args[n], array, place), _BLOCK_SHORTS) for n, array, place in loads
        )
        pointer = _at(context, builder, signature.args[6], total, t, _BLOCK_SHORTS)
        builder.store(builder.add(first, builder.add(second, third)), pointer, align=2)
        return context.get_dummy_value()

    return types.void(a, types.intp, b, types.intp, c, types.intp, total, types.intp), generate


@_vector_code
def slide(typing: Any, a: Any, low: Any, high: Any, by: Any, t: Any) -> Any:
    """a[t:] (a piece) = the LANES elements from ``by`` (0..LANES - 1) on of the pieces a[low:] and a[high:] put end to end."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, low, high, by, t = arguments
        first, second = (_load(builder, _at(context, builder, signature.args[0], a, i, _PIECE_BITS), 1) for i in (low, high))
        bits = builder.zext(builder.shl(by, ir.Constant(by.type, 3)), _PIECE_BITS)
        piece = _call(builder, "llvm.fshr.i128", _PIECE_BITS, second, first, bits)
        builder.store(piece, _at(context, builder, signature.args[0], a, t, _PIECE_BITS), align=1)
        return context.get_dummy_value()

    return types.void(a, types.intp, types.intp, types.intp, types.intp), generate


@_vector_code
def winners(typing: Any, sums: Any, i: Any, low: Any, facts: Any, x: Any, stride: Any) -> Any:
    """The least of each of the TILE x LANES uint16 sums[i:], all below 4096, of pixels whose bands start at ``low`` (int16).

    To facts[x:] (int16) go their disparities; ``stride`` further the sums there; then the least beyond +-1 of it; then those one
    below and one above it, -1 where the band ends.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        sums, i, low, facts, x, stride = arguments
        places = [_further(builder, i, pixel * LANES) for pixel in range(TILE)]
        pixels = [_load(builder, _at(context, builder, signature.args[0], sums, place, _SHORTS), 2) for place in places]
        four = ir.Constant(_SHORTS, [4] * LANES)
        keys = _least_of_each(builder, [builder.or_(builder.shl(values, four), _LANE) for values in pixels])
        lanes = builder.and_(keys, ir.Constant(_TILE_SHORTS, [LANES - 1] * TILE))
        before = builder.sub(lanes, ir.Constant(_TILE_SHORTS, [1] * TILE))
        never = ir.Constant(_SHORTS, [0xFFFF] * LANES)
        offsets = [builder.sub(_LANE, builder.shuffle_vector(before, before, _mask([pixel] * LANES))) for pixel in range(TILE)]

        def least_where(condition: str, offset: int) -> Any:
            bound = ir.Constant(_SHORTS, [offset] * LANES)
            kept = [builder.icmp_unsigned(condition, offsets[pixel], bound) for pixel in range(TILE)]
            return _least_of_each(builder, [builder.select(keep, values, never) for keep, values in zip(kept, pixels, strict=True)])

        found = (
            builder.add(lanes, _splat(builder, low, _TILE_SHORTS)),
            builder.lshr(keys, ir.Constant(_TILE_SHORTS, [4] * TILE)),
            least_where(">=", 3),
            least_where("==", 0),
            least_where("==", 2),
        )
        for row, values in enumerate(found):
            place = _nth(builder, x, stride, row)
            builder.store(values, _at(context, builder, signature.args[3], facts, place, _TILE_SHORTS), align=2)
        return context.get_dummy_value()

    return types.void(sums, types.intp, types.int16, facts, types.intp, types.intp), generate


@_vector_code
def smallest(typing: Any, a: Any, i: Any) -> Any:
    """min(a[i:]) * 16 + its first lane, of LANES uint16 below 4096."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        values = _load(builder, _at(context, builder, signature.args[0], arguments[0], arguments[1], _SHORTS), 2)
        keys = builder.or_(builder.shl(values, ir.Constant(_SHORTS, [4] * LANES)), _LANE)
        return _call(builder, "llvm.vector.reduce.umin.v16i16", _SHORT, keys)

    return types.uint16(a, types.intp), generate


@_vector_code
def smallest_but(typing: Any, a: Any, i: Any, center: Any) -> Any:
    """min(a[i:]) of LANES uint16 without the lanes center - 1, center and center + 1 (center: int16, may lie outside)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, i, center = arguments
        values = _load(builder, _at(context, builder, signature.args[0], a, i, _SHORTS), 2)
        first = _splat(builder, builder.sub(center, ir.Constant(_SHORT, 1)), _SHORTS)
        near = builder.icmp_unsigned("<", builder.sub(_LANE, first), ir.Constant(_SHORTS, [3] * LANES))
        others = builder.select(near, ir.Constant(_SHORTS, [0xFFFF] * LANES), values)
        return _call(builder, "llvm.vector.reduce.umin.v16i16", _SHORT, others)

    return types.uint16(a, types.intp, types.int16), generate


@_vector_code
def claim(typing: Any, sums: Any, i: Any, first: Any, best: Any, j: Any) -> Any:
    """The TILE x LANES uint16 sums[i:] of a row of a tile claim the pixels of the right image that they look at.

    best (uint32): sum * 2^16 + disparity - NEVER, the least wins, then the first pixel. Lane l of pixel p looks at
    best[j - p + l], with disparity first + l (int16). A sum of 2^16 - 1 claims nothing.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        sums, i, first, best, j = arguments
        keys = ir.Constant(_WINDOW, [0xFFFF] * WINDOW)
        for pixel in range(TILE):
            lead = TILE - 1 - pixel
            place = _further(builder, i, pixel * LANES - lead)
            values = _load(builder, _at(context, builder, signature.args[0], sums, place, _WINDOW), 2)
            own = [pixel if lead <= lane < lead + LANES else 0xFFFF for lane in range(WINDOW)]
            key = builder.or_(builder.shl(values, ir.Constant(_WINDOW, [3] * WINDOW)), ir.Constant(_WINDOW, own))
            keys = _minimum(builder, keys, key)
        place = _further(builder, j, 1 - TILE)
        wide = builder.zext(keys, _WIDE_WINDOW)
        pixel = builder.and_(wide, ir.Constant(_WIDE_WINDOW, [TILE - 1] * WINDOW))
        cost = builder.shl(builder.lshr(wide, ir.Constant(_WIDE_WINDOW, [3] * WINDOW)), ir.Constant(_WIDE_WINDOW, [16] * WINDOW))
        lane = builder.add(pixel, ir.Constant(_WIDE_WINDOW, [(lane - TILE + 1 + 0x8000) & 0xFFFFFFFF for lane in range(WINDOW)]))
        disparity = builder.add(lane, _splat(builder, builder.sext(first, _WORD), _WIDE_WINDOW))
        claimed = builder.or_(cost, disparity)
        pointer = _at(context, builder, signature.args[3], best, place, _WIDE_WINDOW)
        builder.store(_minimum(builder, _load(builder, pointer, 4), claimed), pointer, align=4)
        return context.get_dummy_value()

    return types.void(sums, types.intp, types.int16, best, types.intp), generate


def _step(builder: Any, under: Any, same: Any, over: Any, floor: Any, here: Any, p2: Any, P1: Any) -> Any:
    below = builder.shuffle_vector(under, same, _mask(_beside([LANES - 1, *range(BLOCK, BLOCK + LANES - 1)])))
    above = builder.shuffle_vector(same, over, _mask(_beside([*range(1, LANES), BLOCK])))
    slope = _saturated(builder, _minimum(builder, below, above), _splat(builder, P1, _BLOCK))
    best = _minimum(builder, _minimum(builder, same, slope), _saturated(builder, floor, p2))
    return builder.add(here, builder.sub(best, floor))


def _beside(lanes: list[int]) -> list[int]:
    """Of two blocks end to end: ``lanes``, given for a block's first pixel, for each of its pixels."""
    return [pixel * LANES + lane for pixel in range(PIXELS) for lane in lanes]


def _least_of_each(builder: Any, pixels: list[Any]) -> Any:
    """The least of each of TILE vectors of LANES, as one vector: halved and joined in pairs until one is left."""
    lanes = LANES
    while len(pixels) > 1:
        half, groups = lanes // 2, LANES // lanes
        low, high = (
            _mask(
                [side * LANES + group * lanes + first + lane for group in range(groups) for side in (0, 1) for lane in range(half)]
            )
            for first in (0, half)
        )
        pairs = list(zip(pixels[::2], pixels[1::2], strict=True))
        pixels = [_minimum(builder, builder.shuffle_vector(a, b, low), builder.shuffle_vector(a, b, high)) for a, b in pairs]
        lanes = half
    mirrored_bits = (0, 4, 2, 6, 1, 5, 3, 7)  # the order that joining in pairs leaves the pixels in
    even, odd = (_mask([2 * place + first for place in mirrored_bits]) for first in (0, 1))
    return _minimum(builder, *(builder.shuffle_vector(pixels[0], pixels[0], mask) for mask in (even, odd)))


def _floor(builder: Any, block: Any) -> Any:
    """Each piece's least value, in all its lanes."""
    for turn in (8, 4, 2, 1):
        turned = [pixel * LANES + (lane + turn) % LANES for pixel in range(PIXELS) for lane in range(LANES)]
        block = _minimum(builder, block, builder.shuffle_vector(block, block, _mask(turned)))
    return block


def _gather(context: Any, builder: Any, array_type: Any, array: Any, index: Any, stride: Any) -> Any:
    places = [_nth(builder, index, stride, pixel) for pixel in range(PIXELS)]
    a, b, c, d = (_load(builder, _at(context, builder, array_type, array, place, _PIECE), 1) for place in places)
    two = _mask(range(2 * LANES))
    return builder.shuffle_vector(builder.shuffle_vector(a, b, two), builder.shuffle_vector(c, d, two), _mask(range(BLOCK)))


def _scatter(context: Any, builder: Any, array_type: Any, array: Any, index: Any, stride: Any, block: Any) -> None:
    for pixel in range(PIXELS):
        piece = builder.shuffle_vector(block, block, _mask(range(pixel * LANES, (pixel + 1) * LANES)))
        place = _nth(builder, index, stride, pixel)
        builder.store(piece, _at(context, builder, array_type, array, place, _PIECE), align=1)


def _p2_of_pixels(context: Any, builder: Any, array_type: Any, array: Any, index: Any, stride: Any) -> Any:
    p2 = ir.Constant(_PER_PIXEL, ir.Undefined)
    for pixel in range(PIXELS):
        place = _nth(builder, index, stride, pixel)
        value = _load(builder, _at(context, builder, array_type, array, place, _BYTE), 1)
        p2 = builder.insert_element(p2, value, ir.Constant(_WORD, pixel))
    return builder.shuffle_vector(p2, p2, _mask([pixel for pixel in range(PIXELS) for _ in range(LANES)]))


def _further(builder: Any, index: Any, by: int) -> Any:
    return builder.add(index, ir.Constant(index.type, by))


def _nth(builder: Any, index: Any, stride: Any, n: int) -> Any:
    return builder.add(index, builder.mul(stride, ir.Constant(stride.type, n)))


def _load_block(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    return _load(builder, _at(context, builder, array_type, array, index, _BLOCK), 1)


def _store_block(context: Any, builder: Any, array_type: Any, array: Any, index: Any, value: Any) -> None:
    builder.store(value, _at(context, builder, array_type, array, index, _BLOCK), align=1)


def _at(context: Any, builder: Any, array_type: Any, array: Any, index: Any, vector: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def _load(builder: Any, pointer: Any, align: int) -> Any:
    value = builder.load(pointer)
    value.align = align  # elements, not vectors, are aligned
    return value


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
    function = declare(builder.module, ir.FunctionType(result, [argument.type for argument in arguments]), name)
    return builder.call(function, arguments)
