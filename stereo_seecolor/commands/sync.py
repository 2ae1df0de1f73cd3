"""``sync``: how the clocks of two videos run against each other."""

from dataclasses import dataclass
from pathlib import Path

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
    false_disparity: of the median motion over rest_s, as a fraction of the image's width.
    """

    left: Path
    right: Path
    offset_s: float
    std_s: float
    drift: float
    drift_std: float
    center_s: float
    pairs: int
    rest_s: float
    false_disparity: float
    evidence: tuple[EvidenceFacts, ...]
    text: str


def sync(left: Path, right: Path) -> SyncResult:
    """Compare sound, a flash and motion of two videos; nothing is written.

    Raises InputError where nothing tells the offset, or the evidence disagrees; DeviceError if PyAV is missing.
    """
    found = synchronize(left, right)
    lag, rest_s = found.lag, float((found.rest_s**2).mean() ** 0.5)
    evidence = tuple(EvidenceFacts(item.kind, item.lag.offset_s, item.lag.std_s) for item in found.evidence)
    return SyncResult(
        left,
        right,
        lag.offset_s,
        lag.std_s,
        lag.drift,
        lag.drift_std,
        lag.center_s,
        len(found.pairs),
        rest_s,
        found.false_disparity,
        evidence,
        found.text,
    )
