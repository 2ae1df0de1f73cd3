"""Stereo pairs of a reef in, metric range maps, true-color images and colored 3-D maps out.

>>> from stereo_seecolor import Pipeline, run  # doctest: +SKIP
"""

import logging
from typing import Any

from stereo_seecolor.version import __version__

__all__ = ["Pipeline", "__version__", "run"]

logging.getLogger(__name__).addHandler(logging.NullHandler())  # quiet until a program configures logging


def __getattr__(name: str) -> Any:
    """Load the pipeline (OpenCV, torch, numba) only when it is used, so that ``--help`` answers at once."""
    if name == "Pipeline":
        from stereo_seecolor.pipeline import Pipeline

        return Pipeline
    if name == "run":
        from stereo_seecolor.commands.run import run

        return run
    raise AttributeError(name)
