"""Quasi-Newton search for the least loss of four raw weights, compiled."""

from typing import NamedTuple

import numpy as np

from stereo_seecolor.color.fitting.table_losses import attenuation_loss, backscatter_loss
from stereo_seecolor.compute.compiled import compiled


class Search(NamedTuple):
    """BFGS with a weak Wolfe line search on four raw weights. A tuple, since compiled code cannot read a dataclass."""

    cold_steps: int = 120
    """Most steps from an initial guess."""
    warm_steps: int = 25
    """Most steps from the water of the frame before, which is close to the minimum."""
    most_restarts: int = 4
    """Searches without what was learned of the curvature: a kink of the loss can hold one."""
    least_gain: float = 1e-4
    """Fraction of the loss by which a restart must lower it to be worth another."""
    longest_step: float = 2.0
    """No raw weight moves farther at once: beyond, a sigmoid or softplus is flat and a weight may not come back."""
    first_step: float = 0.2
    """Length of the first step, of raw weights."""
    most_trials: int = 25
    """Steps of a line search: halves to 3e-8 of the first."""
    armijo: float = 1e-4
    """Fraction of the slope by which a step must lower the loss (Nocedal and Wright, Numerical Optimization, 3.1)."""
    wolfe: float = 0.9
    """Fraction of the slope that may be left after a step (the same, for quasi-Newton)."""
    converged: float = 1e-7
    """Fraction of the loss by which two steps in a row lower it at most: the end."""
    least_curvature: float = 1e-14
    """Cosine of a step and the change of the gradient below which the inverse Hessian is not updated."""
    least_gradient: float = 1e-12
    """Least norm of the gradient that is divided by: avoids division by zero at a stationary point."""


SEARCH = Search()
DIFFERENCE = 0.05
"""Step of raw weights for second derivatives: the backscatter loss has a kink at each value, and must be sampled over many."""


@compiled
def loss_of(which, raw, channel, direct, penalty, slopes, gradient):  # type: ignore[no-untyped-def]
    """The loss of backscatter (which = 0) or attenuation (1). Writes its gradient to ``gradient``, by range bin to ``slopes``."""
    loss = backscatter_loss(raw, channel, penalty, slopes) if which == 0 else attenuation_loss(raw, channel, direct, slopes)
    gradient[:] = 0.0
    for range_bin in range(slopes.shape[0]):
        for i in range(4):
            gradient[i] += slopes[range_bin, i]
    return loss


@compiled
def curvature(which, raw, channel, direct, penalty, slopes, hessian):  # type: ignore[no-untyped-def]
    """Write the Hessian at ``raw``, by central differences of the gradient, and the gradient by range bin into ``slopes``."""
    forward, back = np.empty(4), np.empty(4)
    for i in range(4):
        moved = raw.copy()
        moved[i] = raw[i] + DIFFERENCE
        loss_of(which, moved, channel, direct, penalty, slopes, forward)
        moved[i] = raw[i] - DIFFERENCE
        loss_of(which, moved, channel, direct, penalty, slopes, back)
        for j in range(4):
            hessian[i, j] = (forward[j] - back[j]) / (2.0 * DIFFERENCE)
    loss_of(which, raw, channel, direct, penalty, slopes, forward)


@compiled
def minimize(which, raw, channel, direct, penalty, most_steps):  # type: ignore[no-untyped-def]
    """Minimize by BFGS with a weak Wolfe line search, which suits losses with kinks (Lewis and Overton 2013).

    Returns the loss and the raw weights.
    """
    n = raw.size
    x, gradient, slopes = raw.copy(), np.empty(n), np.empty((channel.z.size, n))
    loss = loss_of(which, x, channel, direct, penalty, slopes, gradient)
    inverse = np.eye(n) * (SEARCH.first_step / max(np.sqrt(np.sum(gradient * gradient)), SEARCH.least_gradient))
    trial_gradient, small = np.empty(n), 0
    for _ in range(most_steps):
        direction = -_times(inverse, gradient)
        longest = np.max(np.abs(direction))
        if longest > SEARCH.longest_step:
            direction *= SEARCH.longest_step / longest
        slope = np.sum(direction * gradient)
        if not slope < 0.0:
            break
        step, low, high = 1.0, 0.0, np.inf
        trial, trial_loss = x, loss
        for _ in range(SEARCH.most_trials):
            trial = x + step * direction
            trial_loss = loss_of(which, trial, channel, direct, penalty, slopes, trial_gradient)
            if trial_loss > loss + SEARCH.armijo * step * slope:
                high = step
            elif np.sum(trial_gradient * direction) < SEARCH.wolfe * slope and step * longest < 10 * SEARCH.longest_step:
                low = step
            else:
                break
            step = 0.5 * (low + high) if high < np.inf else 2.0 * step
        if not trial_loss < loss:
            break
        small = small + 1 if loss - trial_loss <= SEARCH.converged * abs(loss) else 0
        _update(inverse, trial - x, trial_gradient - gradient)
        x, loss = trial, trial_loss
        gradient[:] = trial_gradient
        if small == 2:
            break
    return loss, x


@compiled
def _times(matrix, vector):  # type: ignore[no-untyped-def]
    out = np.zeros(vector.size)
    for i in range(vector.size):
        for j in range(vector.size):
            out[i] += matrix[i, j] * vector[j]
    return out


@compiled
def _update(inverse, step, change):  # type: ignore[no-untyped-def]
    """The BFGS update of the inverse Hessian, left out where the curvature is not positive."""
    curvature = np.sum(step * change)
    if curvature <= SEARCH.least_curvature * np.sqrt(np.sum(step * step) * np.sum(change * change)):
        return
    across = _times(inverse, change)
    weight = (1.0 + np.sum(change * across) / curvature) / curvature
    for i in range(step.size):
        for j in range(step.size):
            inverse[i, j] += weight * step[i] * step[j] - (across[i] * step[j] + step[i] * across[j]) / curvature
