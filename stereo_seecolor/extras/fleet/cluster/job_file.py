"""The file of a batch system's jobs that workers run in: ``slurm:cluster.yaml``."""

from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from stereo_seecolor.errors import ClusterError, InputError
from stereo_seecolor.files.text_documents import read_yaml


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
    """Jobs, each with one worker. Other keys (queue, walltime, ...) are passed to dask-jobqueue."""

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
        """Arguments for dask-jobqueue: one process a job, with a thread for each core."""
        own = {
            "cores": self.cores,
            "memory": self.memory,
            "log_directory": self.log_directory,
            "processes": 1,
        }
        return {**own, **(self.model_extra or {})}
