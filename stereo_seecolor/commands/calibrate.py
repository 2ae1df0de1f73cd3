"""Calibrate a stereo rig from two folders of images of a target, or print the target."""

from dataclasses import dataclass
from pathlib import Path
from shlex import quote

from calibration.boards import printing
from calibration.boards.mistaken_images import mistake_of
from calibration.boards.report import CalibrationReport
from calibration.boards.target_views import TargetView, detect_view
from calibration.boards.targets import parse_target
from calibration.calibrate import calibrate as fit_rig
from calibration.errors import CalibrationError
from calibration.formats import write_rig
from calibration.rig import Medium
from stereo_seecolor.checks.sample import evenly_spaced
from stereo_seecolor.commands.rig_loading import pairs_of
from stereo_seecolor.config import InputConfig
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.encode import encode_image
from stereo_seecolor.files.free_places import refuse_existing
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.inputs.video_frames import is_video
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.own_paths import refuse_own_place

MOST_FRAMES = 60
"""Most frames of videos, spread over them: neighbors show the target in nearly the same place."""

MOST_TESTED = 10
"""Most pairs searched for a mistake, where the pairs give no rig."""


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """A calibration and its files. coverage: a picture of where corners were found."""

    report: CalibrationReport
    calibration: Path
    coverage: Path


def calibrate(
    left: Path,
    right: Path,
    target: str,
    out: Path,
    medium: Medium = "water",
    options: RunOptions | None = None,
) -> CalibrationResult:
    """Calibrate from two folders or videos of ``target``; write ``out`` (native format) and
    ``<out>_coverage.png``, both new.

    target: chessboard:COLUMNSxROWS:SQUARE or charuco:DICTIONARY:COLUMNSxROWS:SQUARE:MARKER
    (docs/calibration.md).
    Raises CalibrationError where the images do not show it; InputError for folders and images that
    cannot be read; OutputError.
    """
    options = options or RunOptions()
    coverage = out.with_name(f"{out.stem}_coverage.png")
    refuse_own_place(out, coverage)
    refuse_existing(out, coverage)
    board = parse_target(target)
    pairs = pairs_of(left, right, InputConfig(video_skip_blurred=True)).pairs
    pairs = evenly_spaced(pairs, MOST_FRAMES) if is_video(left) else pairs

    def detect(pair: Pair) -> TargetView:
        return detect_view(pair.name, read_image(pair.left), read_image(pair.right), board)

    views = []
    options.listener.begin("target", len(pairs))
    for view in options.compute.each(detect, pairs):
        options.listener.advance(FrameRow(view.name))
        views.append(view)
    try:
        rig, report = fit_rig(views, board, medium)
    except CalibrationError as error:
        tested = evenly_spaced(pairs, MOST_TESTED)
        images = [(read_image(pair.left), read_image(pair.right)) for pair in tested]
        if mistake := mistake_of(images, board):
            raise CalibrationError(f"{mistake} ({error})") from error
        if left == right:
            raise CalibrationError(
                f"{error}; each image was cut in two, since {left} is given as both sides: if one "
                f"shows one side, stereo-seecolor inspect {quote(str(left))} finds a pattern for "
                "each side"
            ) from error
        raise
    write_rig(rig, out)
    write_atomic(coverage, encode_image(report.coverage_picture(), "png"))
    return CalibrationResult(report, out, coverage)


def print_target(target: str, out: Path, dpi: int = 300) -> Path:
    """Draw the target into ``out``, a new .pdf or .png (``dpi`` is for .png). Raises
    CalibrationError, OutputError.
    """
    refuse_own_place(out)
    refuse_existing(out)
    printing.print_target(parse_target(target), out, dpi)
    return out
