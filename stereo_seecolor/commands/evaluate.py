"""Compare a finished run with the known truth of the dive it was made from."""

import hashlib
import json
from pathlib import Path
from typing import Any

from calibration import Rectification, RectifiedPair
from calibration.formats import load_rig
from stereo_seecolor.errors import InputError
from stereo_seecolor.evaluation.truth import TruthReport, evaluate_truth

GEOMETRY_TOLERANCE = 1e-6
"""Relative difference of focal length, center and baseline up to which two cameras are one: rounding in files is far below it."""


def evaluate(out: Path, truth: Path) -> TruthReport:
    """Errors of the run in ``out`` against ``truth``, beside which the dive's left/ and cam.yaml lie (docs/synthetic.md).

    Raises InputError if there is nothing to compare, or ``out`` was made from another dive or another calibration.
    """
    run = _run_content(out)
    if run is not None:
        _check_same_geometry(run, out, truth)
        _check_same_images(run, out, truth)
    return evaluate_truth(out, truth)


def _run_content(out: Path) -> dict[str, Any] | None:
    """run.json of ``out``; None where results of another program lie without one."""
    try:
        content = json.loads((out / "run.json").read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise InputError(f"{out / 'run.json'}: cannot be read: {error}: run again") from error
    return content if isinstance(content, dict) else None


def _check_same_geometry(run: dict[str, Any], out: Path, truth: Path) -> None:
    found = run.get("geometry")
    if not isinstance(found, dict):
        return  # made by correct, which knows no camera
    dive = _numbers(Rectification.from_rig(load_rig(truth.parent / "cam.yaml")).pair)
    for name, expected in dive.items():
        value = found.get(name)
        if not isinstance(value, (int, float)) or abs(value - expected) > GEOMETRY_TOLERANCE * abs(expected):
            raise InputError(
                f"{out}: was made with another calibration than that of {truth}: its {name} is {value}, not {expected:.9g}: "
                "give the truth of the dive that was run"
            )


def _numbers(pair: RectifiedPair) -> dict[str, float]:
    names = ("focal_px", "baseline_m", "cx_left_px", "cx_right_px", "cy_px")
    return {name: float(getattr(pair, name)) for name in names}


def _check_same_images(run: dict[str, Any], out: Path, truth: Path) -> None:
    """Names say nothing: two dives number their images alike. The hashes that the run recorded tell."""
    inputs = run.get("inputs")
    recorded = inputs.get("files") if isinstance(inputs, dict) else None
    for name, sides in (recorded if isinstance(recorded, dict) else {}).items():
        image = truth.parent / "left" / f"{name}.png"
        known = sides.get("left", sides.get("image")) if isinstance(sides, dict) else None
        if known and image.is_file() and hashlib.sha256(image.read_bytes()).hexdigest() != known:
            raise InputError(
                f"{out}: was made from other images than those beside {truth}: {image} is not the image {name} of the run: "
                "give the truth of the dive that was run"
            )
