"""The process that workers of this machine are forked from."""

import os
import subprocess
import sys

import pytest

from stereo_seecolor.compute.library_threads import VARIABLES

LEFT_RUNNING = """
import threading, time
from stereo_seecolor.extras.fleet.cluster import local_workers
local_workers.LOADED_ONCE = ()
threading.Thread(target=time.sleep, args=(0.3,)).start()
local_workers._load()
assert local_workers._one_thread()
"""


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux", reason="only Linux says how many threads a process has"
)
def test_no_thread_is_under_way_when_workers_are_forked() -> None:
    """One that ends may hold a lock of OpenCV's, which a worker would find held for ever."""
    environment = {**os.environ, **dict.fromkeys(VARIABLES, "1")}
    subprocess.run([sys.executable, "-c", LEFT_RUNNING], check=True, env=environment)
