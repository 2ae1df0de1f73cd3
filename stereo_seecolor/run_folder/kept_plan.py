"""The predicted cost of a run, which ``plan`` keeps in OUT, and its comparison with what the run took."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.atomic import files_below, write_atomic
from stereo_seecolor.files.json_records import as_record, load_object
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.run_folder.layout import plan_file


@dataclass(frozen=True)
class Cost:
    """The cost of a run. memory_bytes: largest memory of one process."""

    core_hours: float
    wall_hours: float
    disk_bytes: int
    memory_bytes: int


@dataclass(frozen=True)
class Compared:
    """A predicted cost and the measured one, on so many cores. The predicted memory is that of a process that does one pair at a
    time.
    """

    cores: int
    planned: Cost
    measured: Cost


@dataclass(frozen=True)
class KeptPlan:
    """A prediction.

    pairs, settings: number of pairs, and hash of the settings, that it holds for. core_seconds_per_pair: of one core. fit_s:
    seconds of one core for what is done once. disk_bytes: of the output. memory_bytes: of one process. pass_seconds: of one core
    for each pair, by pass.
    """

    pairs: int
    settings: str
    core_seconds_per_pair: float
    fit_s: float
    disk_bytes: int
    memory_bytes: int
    pass_seconds: dict[str, float]

    def save(self, root: Path) -> None:
        """Write the prediction. Raises OutputError."""
        write_atomic(plan_file(root), json.dumps(asdict(self)).encode())

    @staticmethod
    def check_place(root: Path) -> None:
        """Raise OutputError where something else lies in the place of the prediction."""
        file = plan_file(root)
        try:
            as_record(KeptPlan, load_object(file))
        except FileNotFoundError:
            pass
        except (OSError, ValueError) as error:
            raise OutputError(f"{file}: is not a plan of this program: move it elsewhere, or give another --out") from error

    @classmethod
    def load(cls, root: Path, pairs: int, config: RunConfig) -> "KeptPlan | None":
        """Read the prediction for a dive of so many pairs with these settings; None where there is none, or it is damaged."""
        try:
            plan = as_record(cls, load_object(plan_file(root)))
        except (OSError, ValueError):
            return None
        return plan if (plan.pairs, plan.settings) == (pairs, settings_key(config)) else None

    def cost(self, cores: int) -> Cost:
        """Compute the cost on so many cores; what is done once runs on one of them."""
        work_s = self.pairs * self.core_seconds_per_pair
        return Cost((work_s + self.fit_s) / 3600, (work_s / cores + self.fit_s) / 3600, self.disk_bytes, self.memory_bytes)


def settings_key(config: RunConfig) -> str:
    """Hash all settings."""
    return content_key(config.model_dump(mode="json"))


def used_bytes(root: Path) -> int:
    """Sum the sizes of all files of OUT."""
    return sum(path.stat().st_size for path in files_below(root))
