"""``evaluate``: compare a finished run with its dive's truth, or its frames with each other."""

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path

from calibration import Rectification, RectifiedPair
from calibration.formats import load_rig
from stereo_seecolor.color.response.response import standard_config
from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.evaluation.other_results import OtherResults
from stereo_seecolor.extras.evaluation.spread import ComparedFrame, SpreadReport, measure_spread
from stereo_seecolor.extras.evaluation.truth import (
    ResultFiles,
    TruthReport,
    evaluate_truth,
    true_frames,
)
from stereo_seecolor.report.frame_files import FrameFiles
from stereo_seecolor.run_folder.finished_run import FinishedFrame, FinishedRun, open_run
from stereo_seecolor.run_folder.survey_frames import SurveyFrames

GEOMETRY_TOLERANCE = 1e-6
"""Relative difference of focal length, center and baseline up to which two cameras are one:
rounding in files is far below it.
"""


def evaluate(out: Path, truth: Path) -> TruthReport:
    """Errors of the run in ``out`` against the folder ``truth``; left/ and cam.yaml of the dive lie
    beside it (docs/synthetic.md).

    Raises InputError if there is nothing to compare, or ``out`` was made from another dive or
    calibration, which names of images do not show.
    """
    run = open_run(out)
    # what is not a folder of truth is named as that, and not by what is missing beside it
    true_frames(truth)
    if run.geometry is not None:
        _check_geometry(run.geometry, out, truth)
    _check_images(run.frames, out, truth)
    return evaluate_truth(
        {
            frame.name: _files(frame)
            for frame in run.frames
            if {"range", "corrected"} <= frame.products.keys()
        },
        truth,
    )


def evaluate_spread(out: Path, others: Sequence[str | Path] = ()) -> SpreadReport:
    """How much the colors of the same spots of the reef differ between the frames of the run in
    ``out``; needs the dive's images.

    others: folders of the rectified images as other tools corrected them, named as the frames.
    Raises InputError where no two frames show the same spots, or images of the dive or of another
    tool are missing.
    """
    run = open_run(out)
    results = OtherResults.of(others)
    frames = _Compared(run, results)
    _refuse_missing(results, [frame.name for frame in run.frames])
    return measure_spread(frames, frames.geometry, standard_config(run.config.color).encoding)


class _Compared(Lazy[ComparedFrame]):
    """The frames of a run before and after correction, each read when asked for."""

    def __init__(self, run: FinishedRun, others: OtherResults) -> None:
        self._files, self._frames, self._others = (
            FrameFiles.rectifying(run),
            SurveyFrames(run),
            others,
        )
        self.geometry = self._frames.geometry

    def __len__(self) -> int:
        return len(self._frames)

    def item(self, number: int) -> ComparedFrame:
        """Read one frame."""
        shown = self._frames[number]
        others = self._others.images(shown.name, shown.color.shape)
        return ComparedFrame(self._files.raw(self._frames.finished[number]), shown, others)


def _refuse_missing(others: OtherResults, names: Sequence[str]) -> None:
    """Raise InputError where another tool's image is missing, before a long comparison begins."""
    others.refuse_other_names(names)
    for method, missing in others.missing(names).items():
        raise InputError(
            f"{method}: contains no image named {missing[0]}: give a folder with the rectified "
            "image of every frame"
        )


def _files(frame: FinishedFrame) -> ResultFiles:
    return ResultFiles(
        frame.products["range"], frame.products["corrected"], frame.products.get("mask")
    )


def _check_geometry(geometry: RectifiedPair, out: Path, truth: Path) -> None:
    dive = Rectification.from_rig(load_rig(truth.parent / "cam.yaml")).pair
    for name in ("focal_px", "baseline_m", "cx_left_px", "cx_right_px", "cy_px"):
        value, expected = float(getattr(geometry, name)), float(getattr(dive, name))
        if abs(value - expected) > GEOMETRY_TOLERANCE * abs(expected):
            raise InputError(
                f"{out}: was made with another calibration than {truth}: its {name} is "
                f"{value:.9g}, not {expected:.9g}: give the truth of this dive"
            )


def _check_images(frames: Iterable[FinishedFrame], out: Path, truth: Path) -> None:
    for frame in frames:
        image = truth.parent / "left" / f"{frame.name}.png"
        if (
            frame.sha256
            and image.is_file()
            and hashlib.sha256(image.read_bytes()).hexdigest() != frame.sha256
        ):
            raise InputError(
                f"{out}: was made from other images than those of {truth}: {image} is not the "
                f"image {frame.name} of the run: give the truth of this dive"
            )
