"""Standard errors and model choice from fits that leave out parts of the data."""

import numpy as np

from calibration.geometry import Array

NEGLIGIBLE = 0.05  # of a squared error: 2.5 % of an error
TINY = 1e-12  # px^2: data without noise have no error to compare


def jackknife(estimates: Array) -> Array:
    """Compute standard errors (...) from estimates (groups, ...) without one group each (Efron
    1982, The Jackknife, ch. 3).

    Unlike those of least squares they hold where a group's errors are alike: a bent target.
    """
    groups = len(estimates)
    return np.asarray(np.sqrt((groups - 1) * estimates.var(axis=0)))


def jackknife_covariance(estimates: Array) -> Array:
    """Their covariance (k, k), from estimates (groups, k)."""
    return np.asarray((len(estimates) - 1) * np.cov(estimates.T, bias=True))


def no_worse(squares: Array, best: Array) -> bool:
    """Tell whether squared errors (n,) of parts left out are as good as the best model's: not
    significantly larger, or by too little to matter.

    As the rule of one standard error (Hastie et al. 2009, sec. 7.10), but with two: from ten parts,
    chance favors a needless coefficient often enough, and it costs more than it gives. Errors are
    compared as ratios, so that many parts that agree outweigh one that is large.
    """
    ratio = np.log(np.maximum(squares, TINY) / np.maximum(best, TINY))
    doubt = 2 * ratio.std(ddof=1) / np.sqrt(ratio.size)
    return bool(squares.mean() <= (1 + NEGLIGIBLE) * best.mean() or ratio.mean() <= doubt)
