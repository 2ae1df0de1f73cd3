"""``sync``: how the clocks of two videos run against each other."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.formats import load_rig_of_images
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.videos.synchronization import synchronize
from stereo_seecolor.inputs.video_frames import size_of_side


@dataclass(frozen=True)
class EvidenceFacts:
    """The offset by one kind of evidence, and its standard error, seconds."""

    kind: str
    offset_s: float
    std_s: float


@dataclass(frozen=True)
class SyncResult:
    """How the clocks of two videos run: time t of the left one is t + offset_s + drift (t -
    center_s) of the right one.

    std_s, drift_std: standard errors of offset_s and drift. pairs: number of frame pairs; rest_s:
    root mean square of the times between their two frames. left_out: pairs not used since the image
    moves too fast. false_disparity: motion of the image in the time between the frames of a pair,
    median, in image widths.
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
    """Find the offset of two videos from sound, a flash and motion, and with a calibration from
    rows; nothing is written.

    Raises InputError where evidence for the offset is missing or disagrees, or the image moves
    too fast; CalibrationError for the rig; DeviceError if PyAV is missing.
    """
    rig = load_rig_of_images(calib, size_of_side(left, right)) if calib else None
    found = synchronize(left, right, rig)
    if left.samefile(right):
        raise InputError(f"{left}: was given for both sides: give the videos of both cameras")
    lag = found.lag
    return SyncResult(
        left=left,
        right=right,
        offset_s=lag.offset_s,
        std_s=lag.std_s,
        drift=lag.drift,
        drift_std=lag.drift_std,
        center_s=lag.center_s,
        pairs=len(found.pairs),
        left_out=found.left_out,
        rest_s=float((found.rest_s**2).mean() ** 0.5),
        false_disparity=float(np.median(found.false_disparity)),
        evidence=tuple(
            EvidenceFacts(item.kind, item.lag.offset_s, item.lag.std_s) for item in found.evidence
        ),
        text=found.text,
    )
