"""The steps that the search is made of: vector code where numba is a version that it was tested with, plain loops elsewhere.

``vectors.py`` builds on numba's and llvmlite's internal interfaces, which may change with any version. The loops give the same
results and take about twenty times as long.
"""

from importlib.metadata import version

TESTED_NUMBA = ((0, 61), (0, 69))
"""The first version that ``vectors.py`` was tested with, and the first after them (pyproject.toml has the same)."""

_installed = tuple(int(part) for part in version("numba").split(".")[:2])

if TESTED_NUMBA[0] <= _installed < TESTED_NUMBA[1]:
    from stereo_seecolor.matching.sgm.vectors import (
        add,
        add_wide,
        claim,
        fold,
        hamming,
        scatter,
        slide,
        smallest,
        smallest_but,
        step,
        step_of_many,
        steps,
        winners,
    )
else:
    from stereo_seecolor.matching.sgm.loops import (
        add,
        add_wide,
        claim,
        fold,
        hamming,
        scatter,
        slide,
        smallest,
        smallest_but,
        step,
        step_of_many,
        steps,
        winners,
    )

__all__ = [
    "add",
    "add_wide",
    "claim",
    "fold",
    "hamming",
    "scatter",
    "slide",
    "smallest",
    "smallest_but",
    "step",
    "step_of_many",
    "steps",
    "winners",
]
