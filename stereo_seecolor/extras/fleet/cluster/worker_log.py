"""The log of a worker: a file for each process, in the folder that it works on."""

import faulthandler
import logging
import os
import platform
from contextlib import suppress
from pathlib import Path

FOLDER = "logs"
FORM = "%(asctime)s %(levelname)s %(name)s: %(message)s"

log = logging.getLogger("stereo_seecolor")


def log_below(folder: Path) -> None:
    """Write this process's log to ``folder``/logs/HOST-PROCESS.log from now on, with the traceback
    of a crash.

    Writes none where the file cannot be written: the work itself will fail with the reason.
    """
    for handler in [handler for handler in log.handlers if isinstance(handler, WorkerLog)]:
        faulthandler.disable()
        log.removeHandler(handler)
        handler.close()
    with suppress(OSError):
        (folder / FOLDER).mkdir(exist_ok=True)
        handler = WorkerLog(
            folder / FOLDER / f"{platform.node()}-{os.getpid()}.log", encoding="utf-8"
        )
        handler.setFormatter(logging.Formatter(FORM))
        log.addHandler(handler)
        log.setLevel(logging.INFO)
        faulthandler.enable(handler.stream.fileno() if handler.stream else 2)
        log.info("worker begins: process %d on %s", os.getpid(), platform.node())


class WorkerLog(logging.FileHandler):
    """The log file of a worker."""
