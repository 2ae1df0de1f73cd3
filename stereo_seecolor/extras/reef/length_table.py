"""``measure --lengths``: lengths in frames as a table like EventMeasure's (SeaGIS)."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.reef.measure import measured, read_wanted, surface_of
from stereo_seecolor.extras.reef.picking import FrameSurface
from stereo_seecolor.report.calibration_std import calibration_std
from stereo_seecolor.run_folder.finished_run import open_run

ABOUT = ("OpCode", "Frame", "Time (mins)", "Family", "Genus", "Species", "Number", "Comment")
NUMBERS = (
    *(
        "Length (mm)",
        "Precision (mm)",
        "RMS (mm)",
        "Range (mm)",
        "Direction (deg)",
        "Horz. Dir. (deg)",
        "Vert. Dir. (deg)",
    ),
    *("Mid X (mm)", "Mid Y (mm)", "Mid Z (mm)"),
)
"""Columns of numbers, empty where unknown. Precision is one standard error. Range: from the
rectified left camera to the middle of the length. Direction: angle of the middle from the optical
axis, and its components to the right and down. Mid: x right, y down, z forward. RMS is always
empty: range maps have no residual of two rays.
"""


def length_table(out: Path, points: Path) -> str:
    """Tab-separated text with a row for each length in a frame; points, areas and lengths on the
    map are left out.

    A label of three words is family, genus and species, one of two words genus and species; any
    other is a comment.
    Raises InputError as ``measure``.
    """
    run, rows = open_run(out), ["\t".join((*ABOUT, *NUMBERS))]
    calibration, stamps = (
        calibration_std(run).total,
        [frame.timestamp_s for frame in run.frames if frame.timestamp_s is not None],
    )
    for wanted in read_wanted(points):
        if wanted.kind != "length" or not wanted.frame:
            continue
        surface = surface_of(run, wanted.frame)
        found = measured(surface, wanted, calibration)
        stamp = run.frame(wanted.frame).timestamp_s
        time = "" if stamp is None else f"{(stamp - min(stamps)) / 60:.5f}"
        numbers: tuple[str, ...] = ("",) * len(NUMBERS)
        if found.value is not None and found.std is not None:
            numbers = _numbers(surface, wanted.places, found.value, found.std)
        rows.append(
            "\t".join((out.resolve().name, wanted.frame, time, *_label(wanted.label), *numbers))
        )
    return "\n".join(rows) + "\n"


def _label(label: str) -> tuple[str, str, str, str, str]:
    """Family, genus, species, number, comment."""
    words = label.split()
    if len(words) in (2, 3):
        family, genus, species = ["", *words][-3:]
        return family, genus, species, "1", ""
    return "", "", "", "1", " ".join(words)


def _numbers(
    surface: FrameSurface, places: tuple[tuple[float, float], ...], length_m: float, std_m: float
) -> tuple[str, ...]:
    """The columns of NUMBERS for a length between the first and the last place. length_m, std_m:
    with its standard error.
    """
    ends = [surface.pick(*places[number]) for number in (0, -1)]
    middle_m: NDArray[np.float64] = np.mean([end.point_m for end in ends if end], axis=0)
    x, y, z = middle_m
    direction_deg = np.degrees(np.arctan2([np.hypot(x, y), x, y], z))
    rms = ""  # not known
    return (
        _millimeters(length_m),
        _millimeters(std_m),
        rms,
        _millimeters(float(np.linalg.norm(middle_m))),
        *(f"{angle:.3f}" for angle in direction_deg),
        *(_millimeters(value) for value in middle_m),
    )


def _millimeters(value_m: float) -> str:
    return "" if np.isnan(value_m) else f"{1000 * value_m:.2f}"
