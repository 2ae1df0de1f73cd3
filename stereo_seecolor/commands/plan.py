"""``plan``: what a dive will cost, from ten of its pairs: core-hours, wall time, disk and memory."""

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from stereo_seecolor.commands.dive_rig import spread
from stereo_seecolor.commands.over_pairs import Opened, StereoInputs, claim
from stereo_seecolor.commands.run import KIND, StereoCommand, color, stereo_job
from stereo_seecolor.compute.process_usage import peak_bytes
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.atomic import files_below
from stereo_seecolor.inputs.pairing import Pairing
from stereo_seecolor.progress import RunOptions
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frames_table import RunSummary
from stereo_seecolor.run_folder.kept_plan import KeptPlan, settings_key

MEASURED_PAIRS = 10
"""Spread over the dive: the times of its pairs differ by some 10 %."""
WORKERS = (1, 4, 16, 64)


@dataclass(frozen=True)
class Plan:
    """What a dive will cost. measured: pairs that this rests on. stage_seconds: core-seconds a pair, by stage.

    fit_s: seconds for what is done once, on one core. disk_bytes: of all results. memory_bytes: of one process with one thread.
    wall_hours: workers -> hours; each worker is one core.
    """

    pairs: int
    measured: int
    core_seconds_per_pair: float
    stage_seconds: dict[str, float]
    fit_s: float
    disk_bytes: int
    memory_bytes: int
    wall_hours: dict[int, float]

    @property
    def core_hours(self) -> float:
        """Of all pairs, and of what is done once."""
        return (self.pairs * self.core_seconds_per_pair + self.fit_s) / 3600


def plan(
    left: Path,
    right: Path,
    calib: str | Path,
    config: RunConfig | None = None,
    out: Path | None = None,
    workers: Sequence[int] = WORKERS,
) -> Plan:
    """Measure ten pairs in a folder for temporary files, after one that compiles and is not counted.

    out: where the plan is kept, so that the run into it says what it took against it; nothing else is written.
    Raises InputError where none of them goes through; SeeColorError, CalibrationError as ``run`` does.
    """
    inputs, config = StereoInputs(left, right, calib), config or RunConfig()
    opened = inputs.open(config)
    pairs = spread(opened.pairing.pairs, MEASURED_PAIRS)
    with tempfile.TemporaryDirectory(prefix="stereo-seecolor-plan-") as folder:
        warm = _measure(inputs, _only(opened, pairs[:1]), Path(folder) / "warm", LightClock())
        start_s = time.process_time()
        light = LightClock()
        summary = _measure(inputs, _only(opened, pairs), Path(folder) / "measured", light)
        core_s, ok = time.process_time() - start_s, summary.count("ok")
        if not ok:
            first = next(row.error for row in (*summary.rows, *warm.rows) if row.error)
            raise InputError(f"none of {len(pairs)} pairs spread over the dive goes through; the first: {first}")
        written = sum(path.stat().st_size for path in files_below(Path(folder) / "measured"))
    # By the clock, which runs on where the machine is busy with other things.
    seconds = summary.stage_seconds() | light.stage_seconds
    once = max(1 - sum(seconds.values()) / summary.wall_seconds, 0.0)
    number, fit_s, per_pair = len(opened.pairing.pairs), core_s * once, core_s * (1 - once) / ok
    stages = {stage: per_pair * value / sum(seconds.values()) for stage, value in seconds.items()}
    hours = {count: (number * per_pair / count + fit_s) / 3600 for count in workers}
    found = Plan(number, ok, per_pair, stages, fit_s, written * number // ok, peak_bytes(), hours)
    if out:
        kept = KeptPlan(number, settings_key(opened.pipeline.config), per_pair, fit_s, found.disk_bytes, found.memory_bytes)
        kept.save(out)
    return found


def _only(opened: Opened, pairs: Sequence[object]) -> Opened:
    return replace(opened, pairing=Pairing(tuple(pair for pair in opened.pairing.pairs if pair in pairs), ()))


class LightClock:
    """How long the search for the dive's light takes, between two passes: it grows with the pairs, as the passes do."""

    def __init__(self) -> None:
        self._passed_s = 0.0
        self.stage_seconds: dict[str, float] = {}

    def begin(self, stage: str, total: int) -> None:
        """A pass begins."""
        if stage == "waters":  # the second of a dive whose light was looked for
            self.stage_seconds = {"light": time.perf_counter() - self._passed_s}

    def advance(self, row: FrameRow) -> None:
        """A pair is through."""
        self._passed_s = time.perf_counter()


def _measure(inputs: StereoInputs, opened: Opened, out: Path, light: LightClock) -> RunSummary:
    options = RunOptions(workers=1, listener=light)
    command = StereoCommand(inputs, opened.pipeline.config, options, "corrected")
    with RunFolder(out, claim(inputs.owner(KIND, opened.pairing), options, inputs.paths)) as folder:
        passes = stereo_job(opened, command, lambda dive, held, pairing: color(dive, held, pairing, None))
        return passes.conduct(folder, options)
