"""The file that says what jobs of a batch system workers run in: ``slurm:cluster.yaml``."""

from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from stereo_seecolor.errors import ClusterError


class JobFile(BaseModel):
    """Jobs, each of which is one worker. Every other key (queue, walltime, interface, ...) goes to dask-jobqueue."""

    model_config = ConfigDict(extra="allow", frozen=True)

    jobs: int = Field(ge=1, description="Jobs to submit.")
    cores: int = Field(ge=1, description="Cores of each; one batch of pairs runs on each core.")
    memory: str = Field(description="Memory of each, such as 16GB.")
    wait_s: float = Field(3600.0, gt=0, description="Seconds to wait for the first job to start.")

    @classmethod
    def read(cls, path: Path) -> "JobFile":
        """Raises ClusterError."""
        try:
            return cls.model_validate(yaml.safe_load(path.read_text(encoding="utf-8")) or {})
        except OSError as error:
            raise ClusterError(f"{path}: cannot be read: {error.strerror or error}") from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise ClusterError(f"{path}: is no YAML: {' '.join(str(error).split())}") from error
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(map(str, first["loc"])) or "the file"
            raise ClusterError(f"{path}: {key}: {first['msg']}: give at least jobs, cores and memory") from error

    def arguments(self) -> dict[str, Any]:
        """For a class of dask-jobqueue: one process a job, with a thread a core."""
        return {"cores": self.cores, "memory": self.memory, "processes": 1, **(self.model_extra or {})}
