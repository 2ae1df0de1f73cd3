"""How a command does its work: workers, folders, listeners."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from stereo_seecolor.compute.interface import WHOLE, Compute, Shard
from stereo_seecolor.compute.process import at_once
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.progress import Listener, LoggingListener

log = logging.getLogger(__name__)
PageTime = Literal["none", "end", "live"]


@dataclass(frozen=True)
class RunOptions:
    """How a command does its work.

    What changes its results is in the configuration, but for ``shard`` and ``water``.

    Attributes:
        workers: Pairs worked on at once.
        overwrite: Start over in a used folder.
        strict: Stop at the first bad pair.
        verify: Read and hash every input again, also those with the size and time that an earlier
            run noted.
        config_file: The file of the settings, protected from deletion.
        command_line: For run.json.
        listener: Receives progress events; by default the log.
        shard: The part of the dive's pairs to work on.
        cluster: Runs the work in place of this machine's threads.
        water: A water.json whose waters are used in place of a fit.
        also_read: Files that a later step of the same command reads, such as the poses for its map;
            no input may lie in what a run deletes or replaces.
        page: When OUT/index.html is written: never, at the end, or also while the run works.
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
        """The options with at most as many workers as free memory allows, with a notice if that is
        fewer.

        Args:
            pair_bytes: Memory that a pair takes. Workers of a cluster are not limited: they have
                memory of their own.

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
