"""Sixteen disparities at a time: the few vector steps that semi-global matching is made of, for use inside numba kernels.

Numba widens 16-bit arithmetic to 64 bits and so misses the vector unit (measured: 130 ns a pixel where these take 9), so
each step is written out as LLVM vector code, which every processor that numba knows can run. All arrays are C contiguous
and uint16 unless said otherwise; a slice a[i:] means the LANES elements from i, and nothing checks that they exist.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 16
FAR = 0x3000
"""Cost of what lies outside a band; sums of it stay below 2^16."""

_written_out: Callable[[Callable[..., Any]], Callable[..., Any]] = intrinsic

_SHORT = ir.IntType(16)
_WORD = ir.IntType(32)
_SHORTS = ir.VectorType(_SHORT, LANES)
_WORDS = ir.VectorType(_WORD, LANES)
_LANE = ir.Constant(_SHORTS, list(range(LANES)))


@_written_out
def hamming(typing: Any, bits: Any, others: Any, i: Any, cost: Any, c: Any) -> Any:
    """cost[c:] = number of bits in which ``bits`` (uint32) differs from each of others[i:] (uint32)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        bits, others, i, cost, c = arguments
        met = _load(builder, _at(context, builder, signature.args[1], others, i, _WORDS), 4)
        count = _call(builder, "llvm.ctpop.v16i32", _WORDS, builder.xor(met, _splat(builder, bits, _WORDS)))
        builder.store(builder.trunc(count, _SHORTS), _at(context, builder, signature.args[3], cost, c, _SHORTS), align=2)
        return context.get_dummy_value()

    return types.void(types.uint32, others, types.intp, cost, types.intp), generate


@_written_out
def path_step(typing: Any, before: Any, b: Any, cost: Any, c: Any, now: Any, n: Any, floor: Any, P1: Any, P2: Any) -> Any:
    """now[n:] = cost[c:] + min(before[b:], before[b-1:] + P1, before[b+1:] + P1, floor + P2) - floor; returns its minimum.

    One step of one path (Hirschmueller 2008, eq. 13); floor is the minimum over all of ``before``.
    """
    return _path_step(before, cost, now), _path_code(alone=False)


@_written_out
def path_step_alone(typing: Any, before: Any, b: Any, cost: Any, c: Any, now: Any, n: Any, floor: Any, P1: Any, P2: Any) -> Any:
    """As path_step for a pixel of LANES disparities in all: what lies beyond them is taken as FAR, not read.

    Reading at b - 1 what was just written at b would make the processor wait for its memory.
    """
    return _path_step(before, cost, now), _path_code(alone=True)


def _path_step(before: Any, cost: Any, now: Any) -> Any:
    u16 = types.uint16
    return u16(before, types.intp, cost, types.intp, now, types.intp, u16, u16, u16)


def _path_code(alone: bool) -> Callable[..., Any]:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        before, b, cost, c, now, n, floor, P1, P2 = arguments

        def load(i: Any) -> Any:
            return _load(builder, _at(context, builder, signature.args[0], before, i, _SHORTS), 2)

        same, one = load(b), ir.Constant(b.type, 1)
        if alone:
            far = ir.Constant(_SHORTS, [FAR] * LANES)
            below = builder.shuffle_vector(same, far, ir.Constant(_WORDS, [LANES, *range(LANES - 1)]))
            above = builder.shuffle_vector(same, far, ir.Constant(_WORDS, [*range(1, LANES), LANES]))
        else:
            below, above = load(builder.sub(b, one)), load(builder.add(b, one))
        slope = builder.add(_minimum(builder, below, above), _splat(builder, P1, _SHORTS))
        jump = _splat(builder, builder.add(floor, P2), _SHORTS)
        best = _minimum(builder, _minimum(builder, same, slope), jump)
        here = _load(builder, _at(context, builder, signature.args[2], cost, c, _SHORTS), 2)
        total = builder.add(here, builder.sub(best, _splat(builder, floor, _SHORTS)))
        builder.store(total, _at(context, builder, signature.args[4], now, n, _SHORTS), align=2)
        return _call(builder, "llvm.vector.reduce.umin.v16i16", _SHORT, total)

    return generate


@_written_out
def add(typing: Any, a: Any, i: Any, b: Any, j: Any, total: Any, t: Any) -> Any:
    """total[t:] = a[i:] + b[j:]."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, i, b, j, total, t = arguments
        first = _load(builder, _at(context, builder, signature.args[0], a, i, _SHORTS), 2)
        second = _load(builder, _at(context, builder, signature.args[2], b, j, _SHORTS), 2)
        builder.store(builder.add(first, second), _at(context, builder, signature.args[4], total, t, _SHORTS), align=2)
        return context.get_dummy_value()

    return types.void(a, types.intp, b, types.intp, total, types.intp), generate


@_written_out
def add3(typing: Any, a: Any, i: Any, j: Any, total: Any, t: Any) -> Any:
    """total[t:] += a[i:] + a[j:]."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, i, j, total, t = arguments
        first, second = (_load(builder, _at(context, builder, signature.args[0], a, k, _SHORTS), 2) for k in (i, j))
        pointer = _at(context, builder, signature.args[3], total, t, _SHORTS)
        builder.store(builder.add(_load(builder, pointer, 2), builder.add(first, second)), pointer, align=2)
        return context.get_dummy_value()

    return types.void(a, types.intp, types.intp, total, types.intp), generate


@_written_out
def smallest(typing: Any, a: Any, i: Any) -> Any:
    """min(a[i:]) * 16 + its first lane; for values below 4096."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        values = _load(builder, _at(context, builder, signature.args[0], arguments[0], arguments[1], _SHORTS), 2)
        keys = builder.or_(builder.shl(values, ir.Constant(_SHORTS, [4] * LANES)), _LANE)
        return _call(builder, "llvm.vector.reduce.umin.v16i16", _SHORT, keys)

    return types.uint16(a, types.intp), generate


@_written_out
def smallest_but(typing: Any, a: Any, i: Any, centre: Any) -> Any:
    """min(a[i:]) without the lanes centre - 1, centre and centre + 1 (centre: int16, may lie outside)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, i, centre = arguments
        values = _load(builder, _at(context, builder, signature.args[0], a, i, _SHORTS), 2)
        first = _splat(builder, builder.sub(centre, ir.Constant(_SHORT, 1)), _SHORTS)
        near = builder.icmp_unsigned("<", builder.sub(_LANE, first), ir.Constant(_SHORTS, [3] * LANES))
        others = builder.select(near, ir.Constant(_SHORTS, [0xFFFF] * LANES), values)
        return _call(builder, "llvm.vector.reduce.umin.v16i16", _SHORT, others)

    return types.uint16(a, types.intp, types.int16), generate


@_written_out
def claim(typing: Any, a: Any, i: Any, best: Any, disparity: Any, j: Any, first: Any) -> Any:
    """Where a[i:] < best[j:]: best[j:] = a[i:] and disparity[j:] (int16) = first + lane."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, i, best, disparity, j, first = arguments
        values = _load(builder, _at(context, builder, signature.args[0], a, i, _SHORTS), 2)
        at_best = _at(context, builder, signature.args[2], best, j, _SHORTS)
        at_disparity = _at(context, builder, signature.args[3], disparity, j, _SHORTS)
        old, old_disparity = _load(builder, at_best, 2), _load(builder, at_disparity, 2)
        less = builder.icmp_unsigned("<", values, old)
        disparities = builder.add(_LANE, _splat(builder, first, _SHORTS))
        builder.store(builder.select(less, values, old), at_best, align=2)
        builder.store(builder.select(less, disparities, old_disparity), at_disparity, align=2)
        return context.get_dummy_value()

    return types.void(a, types.intp, best, disparity, types.intp, types.int16), generate


@_written_out
def shift(typing: Any, a: Any, b: Any, i: Any, count: Any, t: Any) -> Any:
    """a[t:] = a[b + i:] for those lanes whose i + lane lies in 0..count - 1, FAR for the others."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, b, i, count, t = arguments
        values = _load(builder, _at(context, builder, signature.args[0], a, builder.add(b, i), _SHORTS), 2)
        place = builder.add(_LANE, _splat(builder, builder.trunc(i, _SHORT), _SHORTS))
        inside = builder.icmp_unsigned("<", place, _splat(builder, builder.trunc(count, _SHORT), _SHORTS))
        shifted = builder.select(inside, values, ir.Constant(_SHORTS, [FAR] * LANES))
        builder.store(shifted, _at(context, builder, signature.args[0], a, t, _SHORTS), align=2)
        return context.get_dummy_value()

    return types.void(a, types.intp, types.intp, types.intp, types.intp), generate


def _at(context: Any, builder: Any, array_type: Any, array: Any, index: Any, vector: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), vector.as_pointer())


def _load(builder: Any, pointer: Any, align: int) -> Any:
    value = builder.load(pointer)
    value.align = align  # elements, not vectors, are aligned
    return value


def _splat(builder: Any, scalar: Any, vector: Any) -> Any:
    undefined = ir.Constant(vector, ir.Undefined)
    single = builder.insert_element(undefined, scalar, ir.Constant(_WORD, 0))
    return builder.shuffle_vector(single, undefined, ir.Constant(_WORDS, [0] * LANES))


def _minimum(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.icmp_unsigned("<", a, b), a, b)


def _call(builder: Any, name: str, result: Any, argument: Any) -> Any:
    declare: Any = cgutils.get_or_insert_function
    function = declare(builder.module, ir.FunctionType(result, [argument.type]), name)
    return builder.call(function, [argument])
