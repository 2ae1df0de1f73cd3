"""Asks a batch system for the state of the jobs that workers run in, the reasons, and their
logs.
"""

import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from stereo_seecolor.errors import ClusterError, InputError
from stereo_seecolor.files.text_documents import read_yaml

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
        """Number -> state and reason of the jobs in the queue. Raises OSError where the queue
        cannot be asked.
        """
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
        """Where all jobs have left the queue: their numbers, with log and its last line; else, or
        where it is unknown, "".
        """
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


# The file of a batch system's jobs that workers run in: ``slurm:cluster.yaml``.


class Adaptive(BaseModel):
    """A number of jobs that follows the amount of work."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    minimum: int = Field(1, ge=1, description="Number of jobs during the run.")
    maximum: int = Field(ge=1, description="Jobs at most.")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.minimum > self.maximum:
            raise ValueError("minimum is more than maximum")
        return self


class JobFile(BaseModel):
    """Jobs, each with one worker. All other keys (queue, walltime, interface, ...) are passed to
    dask-jobqueue.
    """

    model_config = ConfigDict(extra="allow", frozen=True)

    jobs: int | None = Field(None, ge=1, description="Jobs to submit.")
    adaptive: Adaptive | None = Field(
        None, description="Instead of jobs: the number of jobs follows the amount of work."
    )
    cores: int = Field(
        ge=1, description=("Cores of each job; one batch of pairs runs on each core.")
    )
    memory: str = Field(description="Memory of each job, for example 16GB.")
    log_directory: str = Field("cluster-logs", description="Folder for the log files of the jobs.")
    wait_s: float = Field(3600.0, gt=0, description="Seconds to wait for the first job to start.")

    @model_validator(mode="after")
    def _one_of_both(self) -> Self:
        if (self.jobs is None) == (self.adaptive is None):
            raise ValueError("either jobs or adaptive is needed")
        return self

    @classmethod
    def read(cls, path: Path) -> "JobFile":
        """Read a YAML file. Raises ClusterError where it cannot be read or is wrong."""
        try:
            return cls.model_validate(read_yaml(path) or {})
        except InputError as error:
            raise ClusterError(str(error)) from error
        except ValidationError as error:
            first = error.errors()[0]
            where = "".join(f"{part}: " for part in first["loc"])
            raise ClusterError(
                f"{path}: {where}{first['msg'].removeprefix('Value error, ')}: give at least "
                "jobs, cores and memory"
            ) from error

    def arguments(self) -> dict[str, Any]:
        """Arguments for a class of dask-jobqueue: one process for each job, with a thread for each
        core.
        """
        own = {
            "cores": self.cores,
            "memory": self.memory,
            "log_directory": self.log_directory,
            "processes": 1,
        }
        return {**own, **(self.model_extra or {})}
