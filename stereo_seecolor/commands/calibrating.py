"""What the commands around a calibration do: make one from folders, and check one against a dive's own images."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibration import Rectification, StereoRig
from calibration.calibrate import calibrate
from calibration.checks import RowCheck, check_rows, suspicions
from calibration.formats import load_rig
from calibration.port import FlatPort
from calibration.port_error import port_error
from calibration.report import CalibrationReport
from calibration.rig import Medium
from calibration.targets import parse_target
from calibration.views import detect_views
from stereo_seecolor.config import InputConfig
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.inputs.pairing import pair_folders
from stereo_seecolor.progress import Listener
from stereo_seecolor.run_folder.frames_table import FrameRow

Pixels = NDArray[np.generic]
PORT_RANGES = (0.5, 0.75, 1.5, 2.0, 3.0)  # of the working range


def calibrate_folders(
    left: Path, right: Path, target: str, medium: Medium, workers: int, listener: Listener
) -> tuple[StereoRig, CalibrationReport]:
    """Calibrate from two folders of images of ``target``.

    Raises CalibrationError where the images do not show it; InputError for folders and images that cannot be read.
    """
    board = parse_target(target)
    pairs = {pair.name: pair for pair in pair_folders(left, right, InputConfig()).pairs}

    def read(name: str) -> tuple[Pixels, Pixels]:
        return read_image(pairs[name].left), read_image(pairs[name].right)

    listener.begin("target", len(pairs))
    views = detect_views(list(pairs), read, board, workers, lambda name: listener.advance(FrameRow(name)))
    return calibrate(views, board, medium)


def check_folders(left: Path, right: Path, calib: str, most_pairs: int) -> tuple[StereoRig, RowCheck, tuple[str, ...]]:
    """Hold a calibration against ``most_pairs`` pairs spread over a dive: the rig, how its rows agree, what looks suspicious.

    Raises CalibrationError, InputError.
    """
    pairs = pair_folders(left, right, InputConfig()).pairs
    chosen = [pairs[i] for i in np.unique(np.linspace(0, len(pairs) - 1, min(most_pairs, len(pairs))).round().astype(int))]
    height, width = read_image(chosen[0].left).shape[:2]
    rig = load_rig(calib, (width, height))
    rows = check_rows(rig, ((read_image(pair.left), read_image(pair.right)) for pair in chosen))
    return rig, rows, suspicions(rig)


def describe_rig(rig: StereoRig) -> list[str]:
    """A rig in a few lines: what a person holds against what they know of it."""
    pair = Rectification.from_rig(rig).pair
    width, height = rig.left.image_size
    field_deg = np.degrees(2 * np.arctan(width / 2 / pair.focal_px))
    lines = [
        f"{rig.left.model} cameras of {width}x{height} px, baseline {rig.baseline_m * 1000:.1f} mm, calibrated in {rig.medium}",
        f"rectified: focal length {pair.focal_px:.1f} px, {field_deg:.0f} degrees across; a point at 1 m has a disparity of "
        f"{pair.focal_px * pair.baseline_m:.1f} px",
    ]
    if isinstance(rig.port, FlatPort):
        depths = np.array(PORT_RANGES) * rig.port.working_range_m
        errors = port_error(rig, depths).range_error
        listed = ", ".join(f"{error:.2%} at {depth:.2g} m" for depth, error in zip(depths, errors, strict=True))
        lines.append(f"flat port, exact at {rig.port.working_range_m:g} m; range error left elsewhere: {listed}")
    elif rig.port is not None:
        lines.append("dome port, taken to be centered on the cameras: nothing is corrected")
    return lines
