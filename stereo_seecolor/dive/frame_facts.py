"""Numbers of a frame for frames.csv."""

from collections.abc import Mapping

import numpy as np

from stereo_seecolor.records import Capture, Correction, RangeMap

MEDIAN_STEP_PX = 4
"""The median range is that of every fourth pixel of every fourth row: of all it takes ten times as long, and is no truer."""


def range_facts(range_map: RangeMap) -> dict[str, float]:
    """coverage: fraction of the frame with a measured range. median_range_m: of those pixels. vertical_px: of the rectified rows.

    What is unknown is absent.
    """
    measured_m = range_map.measured_m
    facts = {"coverage": float(np.isfinite(measured_m).mean())}
    sample_m = measured_m[::MEDIAN_STEP_PX, ::MEDIAN_STEP_PX]
    known_m = sample_m[np.isfinite(sample_m)]
    facts |= {"median_range_m": float(np.median(known_m))} if known_m.size else {}
    return facts | ({"vertical_px": range_map.vertical_px} if np.isfinite(range_map.vertical_px) else {})


def color_facts(correction: Correction) -> dict[str, float]:
    """exposure: the gain to display. clipped_fraction, unrecoverable_fraction: of the frame."""
    return {
        "exposure": correction.exposure,
        "clipped_fraction": correction.clipped_fraction,
        "unrecoverable_fraction": float(correction.unrecoverable.mean()),
    }


def capture_facts(capture: Capture) -> dict[str, float]:
    """What the camera recorded of its exposure: seconds, gain as a factor (1 = ISO 100), f-number."""
    facts = {
        "camera_exposure_s": capture.exposure_s,
        "camera_gain": capture.gain,
        "camera_aperture": capture.aperture,
    }
    return {name: value for name, value in facts.items() if value is not None}


def recorded_capture(facts: Mapping[str, float]) -> Capture:
    """What ``capture_facts`` wrote down."""
    return Capture(facts.get("camera_exposure_s"), facts.get("camera_gain"), facts.get("camera_aperture"))
