"""What ``plan`` foretold of a dive, kept in OUT, and what the run then took."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from stereo_seecolor.config import RunConfig
from stereo_seecolor.files.atomic import files_below, write_atomic
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.run_folder.layout import plan_file


@dataclass(frozen=True)
class Cost:
    """What a run takes. memory_bytes: of one process, the most at once."""

    core_hours: float
    wall_hours: float
    disk_bytes: int
    memory_bytes: int


@dataclass(frozen=True)
class Compared:
    """A plan, and what happened, on so many cores. The planned memory is that of a process that does one pair at a time."""

    cores: int
    planned: Cost
    measured: Cost


@dataclass(frozen=True)
class KeptPlan:
    """pairs, settings: what it is of, the latter hashed. Time in seconds of one core: of each pair, and of what is done once.

    pass_seconds: of each pair, by pass.
    """

    pairs: int
    settings: str
    core_seconds_per_pair: float
    fit_s: float
    disk_bytes: int
    memory_bytes: int
    pass_seconds: dict[str, float]

    def save(self, root: Path) -> None:
        """Write it. Raises OutputError."""
        write_atomic(plan_file(root), json.dumps(asdict(self)).encode())

    @classmethod
    def load(cls, root: Path, pairs: int, config: RunConfig) -> "KeptPlan | None":
        """The plan of a dive of so many pairs with these settings; None where there is none, or it is damaged."""
        try:
            plan = cls(**json.loads(plan_file(root).read_bytes()))
        except (OSError, ValueError, TypeError):
            return None
        return plan if (plan.pairs, plan.settings) == (pairs, settings_key(config)) else None

    def cost(self, cores: int) -> Cost:
        """On so many cores: what is done once runs on one of them."""
        work_s = self.pairs * self.core_seconds_per_pair
        return Cost((work_s + self.fit_s) / 3600, (work_s / cores + self.fit_s) / 3600, self.disk_bytes, self.memory_bytes)


def settings_key(config: RunConfig) -> str:
    """Hash of all settings."""
    return content_key(config.model_dump(mode="json"))


def used_bytes(root: Path) -> int:
    """Of all files of OUT."""
    return sum(path.stat().st_size for path in files_below(root))
