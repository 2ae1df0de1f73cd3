"""What a run cost, beside the plan that lies in OUT."""

import time
from dataclasses import replace
from pathlib import Path

from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.process import core_seconds, peak_bytes
from stereo_seecolor.run_folder.cache import Compared, Cost, KeptPlan, used_bytes
from stereo_seecolor.run_folder.frame_table import RunSummary


class Meter:
    """Measures a run from its beginning: processor time of this process and of its workers, elapsed
    time, memory, disk.
    """

    def __init__(self, compute: Compute) -> None:
        self._compute = compute
        self._began_s, self._core_s = time.perf_counter(), self._used_s()

    def _used_s(self) -> float:
        return core_seconds() + self._compute.usage.core_seconds

    def compared(self, summary: RunSummary, root: Path, plan: KeptPlan | None) -> RunSummary:
        """The summary with the planned and the measured cost.

        Unchanged where OUT holds no plan for this dive, the run was stopped, or an earlier run had
        done a part.
        """
        if plan is None or summary.kept or summary.stopped:
            return summary
        usage, wall_s = self._compute.usage, time.perf_counter() - self._began_s
        memory = usage.memory_bytes or peak_bytes()
        measured = Cost(
            (self._used_s() - self._core_s) / 3600, wall_s / 3600, used_bytes(root), memory
        )
        return replace(summary, plan=Compared(usage.cores, plan.cost(usage.cores), measured))
