"""Asks a batch system for the state of its jobs, the reasons, and their logs."""

import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

QUERY_TIMEOUT_S = 20.0
"""Seconds after which a batch system that does not answer counts as busy; it is asked again."""
NAMED = 3
"""Most jobs that a message names: the others wait for the same reason."""


@dataclass(frozen=True, eq=False)
class BatchJobs:
    """The jobs of a cluster of dask-jobqueue. kind: slurm, pbs, ...: only SLURM is asked."""

    kind: str
    started: Any
    logs: Path

    @property
    def numbers(self) -> list[str]:
        """Numbers of the jobs that were submitted."""
        return [
            str(job.job_id) for job in self.started.workers.values() if getattr(job, "job_id", None)
        ]

    def states(self) -> dict[str, str]:
        """Number -> state and reason of queued jobs. Raises OSError where that cannot be asked."""
        numbers = self.numbers
        if self.kind != "slurm" or not numbers:
            return {}
        words = ["squeue", "-h", "-o", "%i %T (%r)", "-j", ",".join(numbers)]
        try:
            found = subprocess.run(words, capture_output=True, text=True, timeout=QUERY_TIMEOUT_S)
        except subprocess.TimeoutExpired as error:
            raise OSError("squeue does not answer") from error
        if found.returncode and "Invalid job id" not in found.stderr:
            raise OSError(" ".join(found.stderr.split()))
        return dict(line.split(" ", 1) for line in found.stdout.splitlines())

    def ended(self) -> str:
        """Where all jobs have left the queue: numbers, log and last line; else ""."""
        try:
            if self.kind != "slurm" or not self.numbers or self.states():
                return ""
        except OSError:
            return ""
        return "; ".join(
            f"job {number} has ended: {self._log(number)}" for number in self.numbers[:NAMED]
        )

    def text(self) -> str:
        """Text for a message: jobs with their states, and the folder of their logs."""
        try:
            states = self.states()
        except OSError as error:
            return f"the queue gives no reason ({error}); logs are in {self.logs}"
        named = [f"job {number} is {state}" for number, state in list(states.items())[:NAMED]]
        queue = "; ".join(named) or "look at the queue"
        return f"{queue}; logs are in {self.logs}"

    def _log(self, number: str) -> str:
        for path in filter(Path.is_file, sorted(self.logs.glob(f"*{number}*"))):
            lines = [line for line in path.read_text(errors="replace").splitlines() if line.strip()]
            if lines:
                return f"{path} ends with {lines[-1].strip()!r}"
        return f"it has no log in {self.logs}"
