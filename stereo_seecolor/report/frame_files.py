"""The page's files of one frame: thumbnail, image before and after correction, and ranges to
measure in; made of a finished run's files, or while the run has its pixels in memory.
"""

import contextlib
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration import CalibrationError, Rectification, RectifiedPair
from stereo_seecolor.color.response.response import Response
from stereo_seecolor.errors import FrameError, InputError
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.previews import SCREEN, THUMBNAIL, preview
from stereo_seecolor.files.whole_files import read_bytes
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.records import Image, Map
from stereo_seecolor.report.number_code import coded
from stereo_seecolor.report.range_code import range_codes, std_codes
from stereo_seecolor.report.templates import script
from stereo_seecolor.run_folder.finished_run import FinishedFrame, FinishedRun
from stereo_seecolor.run_folder.layout import RIG, page_path
from stereo_seecolor.run_folder.manifest import StageRecord
from stereo_seecolor.run_folder.pair_files import Files

FORMAT = "7"
"""Version of the files of a frame; increased when their content changes."""
OVERLAY_STEP_PX = 2
"""Confidence and mask are only shown, so that every second pixel of every second row suffices."""


@dataclass(frozen=True, eq=False)
class Pixels:
    """The pixels of a frame. products: by name. read: the array of a product; raises InputError."""

    name: str
    products: Mapping[str, object]
    read: Callable[[str], NDArray[Any]]


@dataclass(frozen=True, eq=False)
class FrameFiles:
    """Makes the page's files of a run's frames. rectification: None for an unknown rig."""

    run: FinishedRun
    rectification: Rectification | None

    @classmethod
    def of(cls, run: FinishedRun) -> "FrameFiles":
        """The maker of a run's files; without a readable rig, none before correction."""
        try:
            return cls.rectifying(run)
        except (InputError, CalibrationError, OSError):
            return cls(run, None)

    @classmethod
    def rectifying(cls, run: FinishedRun) -> "FrameFiles":
        """``of``; raises InputError or CalibrationError where the rig cannot be read."""
        return cls(run, Rectification.from_rig(run.rig))

    def make(self, frame: FinishedFrame) -> Files:
        """The page's files of a frame, without ``page/before`` where the input image is missing.

        Raises FrameError if one of the frame's files is missing or damaged.
        """
        before, pixels = None, Pixels(frame.name, frame.products, frame.read)
        with contextlib.suppress(InputError, CalibrationError):  # the input is gone
            before = self.raw(frame)
        try:
            return page_files(pixels, before, self.run.geometry)
        except InputError as error:
            raise FrameError(frame.name, str(error)) from error

    def raw(self, frame: FinishedFrame) -> Image:
        """(H, W, 3) the frame's left image, rectified and upright, as sRGB values.

        Raises InputError, CalibrationError.

        Records of others may name any image of this machine: only what the run read is shown.
        """
        if hashlib.sha256(read_bytes(frame.left)).hexdigest() != frame.sha256:
            raise InputError(f"{frame.left}: is not the image that the run read")
        image = read_image(frame.left, self.run.config.input)
        response = Response.of(self.run.config.color).of_frame(image)
        if self.run.geometry is None:
            return response.standard(image)
        if self.rectification is None:
            raise InputError(
                f"{frame.name}: cannot be rectified: {self.run.root / RIG} is gone or damaged"
            )
        return response.standard(self.rectification.upright(self.rectification.apply_left(image)))


def early_files(
    geometry: RectifiedPair | None,
    corrected_key: str,
    name: str,
    before: Image,
    products: Mapping[str, NDArray[Any]],
) -> tuple[StageRecord, Files]:
    """The record of a frame's files on the page, and these, made while the run has its pixels.
    geometry: of the rectified images; the rest as in ``PageFiles``.
    """
    pixels = Pixels(name, products, products.__getitem__)
    return page_stage(corrected_key, with_before=True), page_files(pixels, before, geometry)


def page_stage(corrected_key: str, with_before: bool) -> StageRecord:
    """The record of a frame's files on the page, of that key. with_before: with its input image."""
    settings = content_key(FORMAT)
    return StageRecord(content_key(settings, corrected_key, with_before), settings)


def page_files(frame: Pixels, before: Image | None, geometry: RectifiedPair | None) -> Files:
    """The page's files of a frame. before: its rectified image, uncorrected; None where it is
    missing. A corrected image that browsers show at once is not written again.

    Raises InputError if one of the frame's files is missing or damaged.
    """
    color = frame.read("corrected")
    files = {"page/thumbnails": preview(color, THUMBNAIL)}
    if color.dtype == np.float32 or max(color.shape[:2]) > SCREEN.longer_px:
        files["page/after"] = preview(color, SCREEN)
    if before is not None:
        files["page/before"] = preview(before, SCREEN)
    if geometry is not None:
        files["page/ranges"] = _ranges(frame, geometry)
    return {name: (page_path(name, frame.name), content) for name, content in files.items()}


def _ranges(frame: Pixels, geometry: RectifiedPair) -> bytes:
    """The script with a frame's coded ranges, their standard errors, confidence and mask."""
    confidence = frame.read("confidence")
    range_m = np.where(confidence > 0, frame.read("range"), np.float32(np.nan))
    std_m = _std_m(frame, range_m, geometry)
    codes, step_per_m = range_codes(range_m, std_m)
    every = np.s_[::OVERLAY_STEP_PX, ::OVERLAY_STEP_PX]
    content = {
        "height": range_m.shape[0],
        "width": range_m.shape[1],
        "step_per_m": step_per_m,
        "ranges": coded(codes),
        "std": coded(std_codes(std_m)),
        "confidence": coded(_sixteenths(confidence[every])),
        "mask": coded(frame.read("mask")[every]),
    }
    return script("ranges", frame.name, content)


def _std_m(frame: Pixels, range_m: Map, geometry: RectifiedPair) -> Map:
    if "range_std" not in frame.products:
        return geometry.estimated_range_std_m(range_m)
    return np.where(np.isfinite(range_m), frame.read("range_std"), np.float32(np.nan))


def _sixteenths(confidence: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Confidence in 16 steps, which take few bytes; only unknown pixels become 0."""
    return np.where(confidence > 0, np.maximum(confidence >> 4, 1), 0).astype(np.uint8)
