"""Machine code for ``run``: compiled before the first run on a machine, and loaded in later runs.

One process compiles: each more would import the compiler and compile numba's own functions again,
which takes it a quarter as long as all kernels.
"""

from functools import cache, partial
from importlib import import_module

import cv2
import numpy as np

from calibration import RectifiedPair
from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.compute.background import Alongside
from stereo_seecolor.compute.compiled import STAGE
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.config import RunConfig
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.files.ply import encode_cloud
from stereo_seecolor.files.png_decoding import quickly_decoded
from stereo_seecolor.matching.sgm.search import is_first_run
from stereo_seecolor.records import FrameRow, Water

WORKS = (
    "stereo_seecolor.matching.warm_up:warm_up_matching",
    "stereo_seecolor.matching.warm_up:warm_up_quality",
    "stereo_seecolor.commands.warm_up:warm_up_fit",
    "stereo_seecolor.commands.warm_up:warm_up_correction",
)
"""Functions that compile the kernels by calling them."""


def load_in_background(config: RunConfig, options: RunOptions) -> None:
    """Begin to load machine code and modules for a run, in a thread, while the caller opens its
    inputs; not before a first run.
    """
    if _runs_here(config, options) and not is_first_run():
        Alongside().put(partial(_load, options.page != "none"))


@cache
def _load(page: bool) -> None:
    for name in WORKS:
        _call(name)
    for module in ("dive.light_search", *["report.page"] * page):
        import_module(f"stereo_seecolor.{module}")


def _runs_here(config: RunConfig, options: RunOptions) -> bool:
    """Whether this process works on pairs; workers of a cluster compile and load themselves."""
    return config.matching.engine == "sgm" and isinstance(options.compute, Threads) and cores() > 1


def compile_for(config: RunConfig, options: RunOptions) -> None:
    """Compile for a run with these settings, unless this machine has the machine code."""
    if not _runs_here(config, options) or not is_first_run():
        return
    options.listener.begin(STAGE, len(WORKS))
    for name in WORKS:
        _call(name)
        options.listener.advance(FrameRow(name.partition(":")[2]))


def _call(name: str) -> None:
    module, _, function = name.partition(":")
    getattr(import_module(module), function)()


def warm_up_fit() -> None:
    """Compile the kernels of decoding, counting and cloud; load those of fitting."""
    image, range_m = _noise()
    quickly_decoded(cv2.imencode(".png", image)[1].tobytes())
    corrector = Corrector()
    table = corrector.measure(image, range_m)
    corrector.fit(table)
    height, width = range_m.shape
    encode_cloud(
        range_m,
        RectifiedPair(100, width / 2, width / 2, height / 2, 0.1, (width, height)).rays,
        image,
    )


def warm_up_correction() -> None:
    """Compile the kernels that correct a frame."""
    image, range_m = _noise()
    some = np.full(3, 0.2)
    Corrector().apply(
        image, range_m, Water(some, some, some, some, some, some, some, some), exposure=1.0
    )


def _noise() -> tuple[np.ndarray, np.ndarray]:
    """A random image (96, 128, 3) uint8 that gets darker and bluer with range, and its ranges (96,
    128) float32, meters.
    """
    range_m = np.linspace(0.5, 4, 96 * 128, dtype=np.float32).reshape(96, 128)
    seen = np.exp(-range_m[..., None] * np.array([0.6, 0.2, 0.1])) * np.random.default_rng(
        0
    ).uniform(60, 220, (96, 128, 3))
    return (seen + 20 * (1 - np.exp(-range_m[..., None]))).astype(np.uint8), range_m
