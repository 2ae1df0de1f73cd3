"""When a run will end, from the progress that it keeps in OUT."""

from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.files.json_records import as_record, load_object
from stereo_seecolor.run_folder.layout import PROGRESS, state
from stereo_seecolor.run_folder.run_progress import RunProgress


@dataclass(frozen=True)
class Forecast(RunProgress):
    """The progress of a pass over a dive, and what follows from it."""

    @property
    def ends_s(self) -> float | None:
        """When the pass ends at its rate so far, seconds since 1970; None before its first pair."""
        if not self.done:
            return None
        return self.began_s + (self.updated_s - self.began_s) * self.total / self.done

    @property
    def to_come(self) -> list[str]:
        """The passes after this one."""
        names = list(self.expected.seconds)
        return names[names.index(self.stage) + 1 :] if self.stage in names else []

    @property
    def run_ends_s(self) -> float | None:
        """The time at which the run will end, seconds since 1970, if the passes go on at the pace
        so far relative to what was expected of them.

        None where no pair was done that tells how fast it goes.
        """
        each = self.expected.seconds
        so_far = [*self.earlier, (self.stage, self.new, self.updated_s - self.began_s)]
        timed = [
            (new * each[name], seconds) for name, new, seconds in so_far if new and name in each
        ]
        expected_s = sum(seconds for seconds, _ in timed)
        if self.stage not in each or not expected_s:
            return None
        pace = sum(seconds for _, seconds in timed) / expected_s
        ends_s = self.ends_s or self.began_s + pace * each[self.stage] * self.total
        return ends_s + pace * self.total * sum(each[name] for name in self.to_come)

    @classmethod
    def load(cls, root: Path) -> "Forecast | None":
        """Read the latest progress; None where there is none, or it is damaged."""
        try:
            return as_record(cls, load_object(state(root, PROGRESS)))
        except (OSError, ValueError):
            return None
