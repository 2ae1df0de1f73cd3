"""Kalibr's ``NAME-results-cam.txt``: the standard errors that the camchain does not contain."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration.rig_errors import RigErrors

CAMCHAIN, RESULTS = "camchain", "results-cam"
SAME = 1e-3
"""Of focal lengths in both files, relative: numbers of another calibration differ by more."""
_FIGURES = re.compile(r"^[ \t]*(projection|t): +\[([^][]*)\] +\+- +\[([^][]*)\]", re.M)


def stated_errors(camchain: Path, focal_px: NDArray[np.float64]) -> RigErrors | None:
    """Read the standard errors of a camchain's two cameras; None where the file is not there, or is
    of another calibration.

    focal_px: (2, 2) fx, fy of cam0 and cam1. Each line reads ``projection: [fx fy cx cy] +-
    [...]``, and the baseline's ``t: [x y z] +- [...]``.
    """
    path = camchain.with_name(camchain.name.replace(CAMCHAIN, RESULTS)).with_suffix(".txt")
    if CAMCHAIN not in camchain.name or not path.is_file():
        return None
    found = [
        (kind, _numbers(value), _numbers(std))
        for kind, value, std in _FIGURES.findall(path.read_text("utf-8", "replace"))
    ]
    lenses = [
        (value[:2], std[:2])
        for kind, value, std in found
        if kind == "projection" and value.size == std.size == 4
    ]
    ways = [
        (value, std) for kind, value, std in found if kind == "t" and value.size == std.size == 3
    ]
    if (
        len(lenses) != 2
        or len(ways) != 1
        or not np.allclose([value for value, _ in lenses], focal_px, rtol=SAME)
    ):
        return None
    focal = max(float((std / value).mean()) for value, std in lenses)
    t, t_std = ways[0]
    baseline = float(np.linalg.norm(t * t_std) / (t @ t))
    return RigErrors(focal, baseline, "Kalibr") if np.isfinite([focal, baseline]).all() else None


def _numbers(text: str) -> NDArray[np.float64]:
    try:
        return np.array([float(word) for word in text.replace(",", " ").split()])
    except ValueError:
        return np.zeros(0)
