"""How a command goes about its work."""

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
    """How a command goes about it; what it makes of its inputs is in the configuration.

    workers: pairs under way at once. overwrite: begin again in a used folder. strict: stop at the first bad pair.
    verify: read and hash every input again, also those whose size and time are those of an earlier run.
    config_file: where the settings came from, so that it is never deleted. command_line: for run.json.
    listener: hears how far the job is; by default the log does. notice: is given what a person should know before
    the work begins, a line each; by default to the log. shard: which part of the dive's pairs is done.
    cluster: where the work runs instead of on this machine's threads.
    water: the water.json of an earlier dive, used instead of a fit.
    page: when OUT/index.html is written: never, at the end, or while the run works as well.
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
    page: PageTime = "end"
    notice: Callable[[str], None] = log.info

    def within_memory(self, pair_bytes: float) -> "RunOptions":
        """With no more pairs under way at once than fit into the free memory; says so. A cluster's workers look after their own."""
        fitting = self.workers if self.cluster else at_once(self.workers, pair_bytes)
        if fitting == self.workers:
            return self
        size = f"a pair takes about {pair_bytes / 1e9:.1f} GB while it is worked on"
        self.notice(f"memory: {size}: {fitting} at once instead of {self.workers}, for more are not free")
        return replace(self, workers=fitting)

    @property
    def compute(self) -> Compute:
        """Where the work on pairs and tiles runs."""
        return self.cluster or Threads(self.workers)
