"""The paths of ``sgm.along`` as a Triton kernel: a program follows one line of pixels, all its
disparities at once.

Imported only where Triton is installed and the device is a CUDA device; Triton's interpreter runs
it on the processor for tests.
"""

import triton
import triton.language as tl
from torch import Tensor

from stereo_seecolor.matching.sgm import search as compiled

_FAR, _P1_SHIFT = tl.constexpr(compiled.FAR), tl.constexpr(compiled.P1_SHIFT)


def along(cost: Tensor, p2: Tensor, total: Tensor, kept: slice) -> None:
    """``sgm.along`` with the same results; one direction after the other, for common sums."""
    strips, steps, lines, number = cost.shape
    block = triton.next_power_of_2(number)
    for forward in (True, False):
        _path[(strips * lines,)](
            cost, p2, total, lines, steps, number, kept.start, kept.stop, *cost.stride()[:3],
            *p2.stride(), *total.stride()[:3],
            forward=forward, block=block, num_warps=min(max(block // 64, 1), 8),
        )  # fmt: skip


@triton.jit  # type: ignore[untyped-decorator]
def _path(  # type: ignore[no-untyped-def]  # Triton reads annotations as types of its own
    cost, p2, total, lines, steps, number, first, end,
    cost_s, cost_l, cost_m, p2_s, p2_l, p2_m, total_s, total_l, total_m,
    forward: tl.constexpr, block: tl.constexpr,
):  # fmt: skip
    """One line's path (Hirschmueller 2008, eq. 13). block: a power of 2, ``number`` or more."""
    strip, line = (tl.program_id(0) // lines).to(tl.int64), (tl.program_id(0) % lines).to(tl.int64)
    d = tl.arange(0, block)
    held = d < number
    below, above = tl.maximum(d - 1, 0), tl.minimum(d + 1, block - 1)
    before = tl.zeros([block], tl.int32)
    for i in range(steps):
        place = i if forward else steps - 1 - i
        here = tl.load(
            cost + strip * cost_s + place * cost_l + line * cost_m + d, mask=held, other=_FAR
        ).to(tl.int32)
        penalty = tl.load(
            p2 + strip * p2_s + (place if forward else place + 1) * p2_l + line * p2_m
        ).to(tl.int32)
        before = tl.where(here == _FAR, _FAR, before)
        least = tl.min(before, axis=0)
        lower = tl.where(d > 0, tl.gather(before, below, axis=0), _FAR)
        upper = tl.where(d < block - 1, tl.gather(before, above, axis=0), _FAR)
        best = tl.minimum(
            tl.minimum(before, tl.minimum(lower, upper) + (penalty >> _P1_SHIFT)), least + penalty
        )
        before = tl.minimum(best - least + here, _FAR)
        if (place >= first) & (place < end):
            sums = total + strip * total_s + place * total_l + line * total_m + d
            tl.store(sums, tl.load(sums, mask=held, other=0) + before.to(tl.int16), mask=held)
