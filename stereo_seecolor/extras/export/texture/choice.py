"""Choice of one view for each triangle: a good one, and the same as its neighbors' where that costs little."""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.export.texture.views import Candidates

SEAM = 0.4
"""Cost of an edge between two views, as a fraction of a view's value (Potts model): patches of some hundred triangles."""
SWEEPS = 30
"""Iterated conditional modes (Besag 1986) change next to nothing after some twenty."""


def choose(found: Candidates, across: NDArray[np.int64]) -> NDArray[np.int32]:
    """Choose the view of each triangle: (F,), -1 where none shows it. across: (F, 3), neighbors or -1."""
    with np.errstate(divide="ignore"):
        cost = np.where(found.view >= 0, -np.log(np.maximum(found.value, 1e-9)), np.inf)
    faces = np.arange(len(cost))
    label = np.where(np.isfinite(cost).any(axis=1), found.view[faces, cost.argmin(axis=1)], -1).astype(np.int32)
    rng = np.random.default_rng(0)
    for _ in range(SWEEPS):
        turn = np.flatnonzero(rng.random(len(cost)) < 0.5)  # half at a time: two neighbors must not swap for ever
        beside = np.where(across[turn] >= 0, label[across[turn]], -1)
        differ = (beside[:, None, :] != found.view[turn, :, None]) & (beside[:, None, :] >= 0)
        total = cost[turn] + SEAM * differ.sum(axis=2)
        best = total.argmin(axis=1)
        label[turn] = np.where(np.isfinite(total[np.arange(len(turn)), best]), found.view[turn, best], -1)
    return label
