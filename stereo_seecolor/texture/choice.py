"""Choice of a view for each triangle: a good one, and its neighbors' at little cost."""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.compute.compiled import compiled
from stereo_seecolor.texture.views import Candidates

SEAM = 0.8
"""Cost of an edge between two views, as a fraction of a view's value (Potts model): patches of some
hundred triangles.
"""
SWEEPS = 10
"""Iterated conditional modes (Besag 1986) change next to nothing after some five."""
SMALL = 300
"""Triangles of a patch that may take a neighbor's view as a whole, where none of them would
alone.
"""
ROUNDS = 2
"""Of both: patches that became larger can be left by others again."""


def choose(candidates: Candidates, across: NDArray[np.int64]) -> NDArray[np.int32]:
    """The view of each triangle: (F,), -1 without one. across: (F, 3), neighbors or -1."""
    with np.errstate(divide="ignore"):
        cost = np.where(candidates.view >= 0, -np.log(np.maximum(candidates.value, 1e-9)), np.inf)
    faces = np.arange(len(cost))
    label = np.where(
        np.isfinite(cost).any(axis=1), candidates.view[faces, cost.argmin(axis=1)], -1
    ).astype(np.int32)
    for _ in range(ROUNDS):
        settle(label, candidates.view, cost, across, SEAM, SWEEPS)
        of_patch, moved = np.full((2, len(label)), -1, np.int64)
        patch, around = np.empty(len(label), np.int64), np.empty(3 * SMALL, np.int32)
        absorb(label, candidates.view, cost, across, SEAM, SMALL, (of_patch, moved, patch, around))
    return label


@compiled
def settle(label, view, cost, across, seam, sweeps):  # type: ignore[no-untyped-def]
    """Give each triangle the view that costs least beside its neighbors, in place."""
    for _ in range(sweeps):
        changed = False
        for f in range(len(label)):
            best, least = -1, np.inf
            for k in range(view.shape[1]):
                if view[f, k] < 0:
                    continue
                total = cost[f, k]
                for side in range(3):
                    beside = across[f, side]
                    if beside >= 0 and label[beside] >= 0 and label[beside] != view[f, k]:
                        total += seam
                if total < least:
                    best, least = view[f, k], total
            if best != label[f]:
                label[f], changed = best, True
        if not changed:
            break


@compiled
def absorb(label, view, cost, across, seam, small, scratch):  # type: ignore[no-untyped-def]
    """Give all triangles of a small patch that a neighboring patch's view shows that view, in
    place, where it costs less. scratch: two (F,) of -1, room for (F,) triangles and (3 small,)
    views.
    """
    (of_patch, moved, patch, around), turn = scratch, 0
    for start in range(len(label)):
        if label[start] < 0 or of_patch[start] >= 0:
            continue
        count = fill(start, label, across, of_patch, patch)
        if count > small:
            continue
        to, least = label[start], 0.0
        of_one = patch[:count]
        for k in range(views_around(of_one, label, across, around)):
            turn += 1
            more = moved_cost(of_one, around[k], turn, (label, view, cost, across, moved), seam)
            if more < least:
                to, least = around[k], more
        for f in of_one:
            if place_of(to, view, f) >= 0:
                label[f] = to


@compiled
def fill(start, label, across, of_patch, patch):  # type: ignore[no-untyped-def]
    """The triangles of the patch of one of them, into ``patch``; returns how many."""
    patch[0], of_patch[start], count, done = start, start, 1, 0
    while done < count:
        for side in range(3):
            f = across[patch[done], side]
            if f >= 0 and of_patch[f] < 0 and label[f] == label[start]:
                patch[count], of_patch[f] = f, start
                count += 1
        done += 1
    return count


@compiled
def views_around(patch, label, across, around):  # type: ignore[no-untyped-def]
    """The views of the neighbors of a patch, each once, into ``around``; returns how many."""
    count = 0
    for f in patch:
        for side in range(3):
            beside = across[f, side]
            if beside < 0 or label[beside] < 0 or label[beside] == label[f]:
                continue
            k = 0
            while k < count and around[k] != label[beside]:
                k += 1
            if k == count:
                around[count] = label[beside]
                count += 1
    return count


@compiled
def place_of(number, view, f):  # type: ignore[no-untyped-def]
    """Where a view stands among those of a triangle; -1 if it does not show it."""
    for k in range(view.shape[1]):
        if view[f, k] == number:
            return k
    return -1


@compiled
def moved_cost(patch, to, turn, state, seam):  # type: ignore[no-untyped-def]
    """How much more it costs if the triangles of a patch that another view shows take that view.
    turn: another number at each call.
    """
    label, view, cost, across, moved = state
    total = 0.0
    for f in patch:
        k = place_of(to, view, f)
        if k >= 0:
            moved[f] = turn
            total += cost[f, k] - cost[f, place_of(label[f], view, f)]
    for f in patch:
        for side in range(3):
            beside = across[f, side]
            if moved[f] == turn and beside >= 0 and label[beside] >= 0 and moved[beside] != turn:
                total += seam * ((label[beside] != to) - (label[beside] != label[f]))
    return total
