"""Compute metric range maps, true-color images and colored 3-D maps from stereo pairs of a reef.

>>> from stereo_seecolor import Pipeline, open_run, run  # doctest: +SKIP
"""

import logging
from importlib import import_module
from typing import TYPE_CHECKING, Any

import calibration
from stereo_seecolor.version import __version__

if TYPE_CHECKING:
    from stereo_seecolor.color.corrector import Corrector
    from stereo_seecolor.commands.fuse import fuse
    from stereo_seecolor.commands.run import correct, range_maps, rectify, run
    from stereo_seecolor.config import RunConfig
    from stereo_seecolor.config.file import load_config
    from stereo_seecolor.dive.run_options import RunOptions
    from stereo_seecolor.errors import SeeColorError
    from stereo_seecolor.matching.matcher import Matcher
    from stereo_seecolor.pipeline import Pipeline, Stream
    from stereo_seecolor.records import Correction, FrameResult, RangeMap, StereoFrame, Water
    from stereo_seecolor.run_folder.finished_run import FinishedRun, open_run

_PLACES = {
    "Corrector": "color.corrector",
    "Correction": "records",
    "FinishedRun": "run_folder.finished_run",
    "FrameResult": "records",
    "Matcher": "matching.matcher",
    "Pipeline": "pipeline",
    "RangeMap": "records",
    "RunConfig": "config",
    "RunOptions": "dive.run_options",
    "SeeColorError": "errors",
    "StereoFrame": "records",
    "Stream": "pipeline",
    "Water": "records",
    "correct": "commands.run",
    "fuse": "commands.fuse",
    "load_config": "config.file",
    "open_run": "run_folder.finished_run",
    "range_maps": "commands.run",
    "rectify": "commands.run",
    "run": "commands.run",
}
"""Where each public name is defined; OpenCV, torch and numba are loaded when they are used."""

__all__ = [
    "Correction",
    "Corrector",
    "FinishedRun",
    "FrameResult",
    "Matcher",
    "Pipeline",
    "RangeMap",
    "RunConfig",
    "RunOptions",
    "SeeColorError",
    "StereoFrame",
    "Stream",
    "Water",
    "__version__",
    "correct",
    "fuse",
    "load_config",
    "open_run",
    "range_maps",
    "rectify",
    "run",
]

if "StereoRig" not in getattr(calibration, "__all__", ()):
    place = getattr(calibration, "__file__", None) or next(iter(calibration.__path__))
    raise ImportError(
        f"another package called calibration ({place}) hides that of stereo-seecolor: take its "
        "folder off PYTHONPATH, or start python elsewhere"
    )

# quiet until a program configures logging
logging.getLogger(__name__).addHandler(logging.NullHandler())


def __getattr__(name: str) -> Any:
    """Load a public name when it is used, so that ``--help`` answers at once."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
