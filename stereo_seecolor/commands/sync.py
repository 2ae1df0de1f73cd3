"""``sync``: how the clocks of two videos run against each other."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.formats import load_rig
from stereo_seecolor.inputs.video_sync import synchronize


@dataclass(frozen=True)
class EvidenceFacts:
    """What one kind of evidence says: offset and its standard error, seconds."""

    kind: str
    offset_s: float
    std_s: float


@dataclass(frozen=True)
class SyncResult:
    """An event at t on the left clock is at t + offset_s + drift (t - center_s) on the right one.

    std_s, drift_std: standard errors. pairs: frames that have a partner; rest_s: root mean square of how far apart they are.
    left_out: pairs that the picture's motion spoils. false_disparity: what it moves in a pair's rest, median, image widths.
    """

    left: Path
    right: Path
    offset_s: float
    std_s: float
    drift: float
    drift_std: float
    center_s: float
    pairs: int
    left_out: int
    rest_s: float
    false_disparity: float
    evidence: tuple[EvidenceFacts, ...]
    text: str


def sync(left: Path, right: Path, calib: str = "") -> SyncResult:
    """Compare sound, a flash, motion, and with a calibration the rows of two videos; nothing is written.

    Raises InputError where evidence for the offset is missing or disagrees, or the picture moves too fast; CalibrationError for
    the rig; DeviceError if PyAV is missing.
    """
    found = synchronize(left, right, load_rig(calib) if calib else None)
    lag, rest_s = found.lag, float((found.rest_s**2).mean() ** 0.5)
    evidence = tuple(EvidenceFacts(item.kind, item.lag.offset_s, item.lag.std_s) for item in found.evidence)
    clocks = (lag.offset_s, lag.std_s, lag.drift, lag.drift_std, lag.center_s)
    frames = (len(found.pairs), found.left_out, rest_s, float(np.median(found.false_disparity)))
    return SyncResult(left, right, *clocks, *frames, evidence, found.text)
