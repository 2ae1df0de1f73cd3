"""The inner steps of the search: vector code where numba is a version that it was tested with,
plain loops elsewhere.

``vectors.py`` builds on internal interfaces of numba and llvmlite, which may change with any
version. The loops give the same results and take about twenty times as long.
"""

from importlib.metadata import version

FIRST_NUMBA, NEXT_NUMBA = (0, 61), (0, 69)
"""``vectors.py`` was tested with 0.61.2 and 0.68.1: the first minor version, and the first after
them (as in pyproject.toml).
"""

if FIRST_NUMBA <= tuple(int(part) for part in version("numba").split(".")[:2]) < NEXT_NUMBA:
    from stereo_seecolor.matching.sgm import vectors as steps
else:
    from stereo_seecolor.matching.sgm import loops as steps  # type: ignore[no-redef]

__all__ = ["steps"]
