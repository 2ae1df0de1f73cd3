"""Numbers of a frame for frames.csv, by column."""

from collections.abc import Mapping

import numpy as np

from stereo_seecolor.records import Capture, Correction, RangeMap

MEDIAN_STEP_PX = 4
"""The median range is taken over every fourth pixel of every fourth row: over all it takes ten
times as long and is as accurate.
"""


def range_facts(range_map: RangeMap) -> dict[str, float]:
    """Numbers of a range map; unknown ones are left out.

    coverage: fraction of pixels with a measured range. median_range_m: of those pixels.
    vertical_px, right_sharpness: as in RangeMap.
    """
    measured_m = range_map.measured_m
    facts = {"coverage": float(np.isfinite(measured_m).mean())}
    sample_m = measured_m[::MEDIAN_STEP_PX, ::MEDIAN_STEP_PX]
    known_m = sample_m[np.isfinite(sample_m)]
    facts |= {"median_range_m": float(np.median(known_m))} if known_m.size else {}
    of_sides = {"vertical_px": range_map.vertical_px, "right_sharpness": range_map.right_sharpness}
    return facts | {name: value for name, value in of_sides.items() if np.isfinite(value)}


def color_facts(correction: Correction) -> dict[str, float]:
    """Numbers of a correction. exposure: gain to display. clipped_fraction, unrecoverable_fraction:
    of the frame's pixels.
    """
    return {
        "exposure": correction.exposure,
        "clipped_fraction": correction.clipped_fraction,
        "unrecoverable_fraction": float(correction.unrecoverable.mean()),
    }


def capture_facts(capture: Capture) -> dict[str, float]:
    """The exposure that the camera recorded: seconds, gain (1 = ISO 100), f-number, if known."""
    facts = {
        "camera_exposure_s": capture.exposure_s,
        "camera_gain": capture.gain,
        "camera_aperture": capture.aperture,
    }
    return {name: value for name, value in facts.items() if value is not None}


def recorded_capture(facts: Mapping[str, float]) -> Capture:
    """The exposure that ``capture_facts`` took from a Capture."""
    return Capture(
        facts.get("camera_exposure_s"), facts.get("camera_gain"), facts.get("camera_aperture")
    )
