"""Options of a command that do not change its results: workers, folders, listeners."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from stereo_seecolor.compute.free_memory import at_once
from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.shard import WHOLE, Shard
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.progress import Listener, LoggingListener

log = logging.getLogger(__name__)
PageTime = Literal["none", "end", "live"]


@dataclass(frozen=True)
class RunOptions:
    """Options of a command that do not change its results, except ``shard`` and ``water``.

    Settings that change the results are in the configuration.

    Attributes:
        workers: Number of pairs processed at the same time.
        overwrite: Delete the results of an earlier run in the folder first.
        strict: Stop at the first pair that fails.
        verify: Read and hash every input again, also those with the size and time that an earlier
            run noted.
        config_file: The file of the settings, protected from deletion.
        command_line: For run.json.
        listener: Receives progress events; by default the log.
        shard: The part of the pairs to process.
        cluster: Runs the work instead of the threads of this machine.
        water: A water.json whose parameters are used instead of a fit.
        also_read: Files that a later step of the same command reads, such as the poses for its map;
            a run must not delete or replace its inputs.
        page: When OUT/index.html is written: never, at the end, or also during the run.
        notice: Called with each line that a user should read before the work begins; by default it
            goes to the log.
    """

    workers: int = 2
    overwrite: bool = False
    strict: bool = False
    verify: bool = False
    config_file: Path | None = None
    command_line: tuple[str, ...] = ()
    listener: Listener = field(default_factory=LoggingListener)
    shard: Shard = WHOLE
    cluster: Compute | None = None
    water: Path | None = None
    also_read: tuple[Path, ...] = ()
    page: PageTime = "end"
    notice: Callable[[str], None] = log.info

    def within_memory(self, pair_bytes: float) -> "RunOptions":
        """The options with at most as many workers as free memory allows, with a notice if fewer.

        Args:
            pair_bytes: Memory that a pair takes. Workers of a cluster are not limited: they have
                their own memory.

        Returns:
            The options.
        """
        fitting = self.workers if self.cluster else at_once(self.workers, pair_bytes)
        if fitting == self.workers:
            return self
        size = f"a pair takes about {pair_bytes / 1e9:.1f} GB during processing"
        self.notice(
            f"memory: {size}: {fitting} at once instead of {self.workers}, because more memory "
            "is not free"
        )
        return replace(self, workers=fitting)

    @property
    def compute(self) -> Compute:
        """Where the work on pairs and tiles runs."""
        return self.cluster or Threads(self.workers)
