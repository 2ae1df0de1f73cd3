"""Compiles kernels before a first run in several processes: in one process numba compiles one function at a time."""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed

from stereo_seecolor.compute.sources import ROOT
from stereo_seecolor.compute.threads import cores


def call_in_processes(functions: Sequence[str]) -> Iterator[Sequence[str]]:
    """Call each ``module:function``, in one process for each core; yields the functions of a process when it has ended.

    Compiled code is kept on disk. Errors are ignored: missing code is compiled when it is needed.
    """
    groups = [functions[first :: cores()] for first in range(min(cores(), len(functions)))]
    with ThreadPoolExecutor(len(groups)) as pool:
        calls = {pool.submit(_call, group): group for group in groups}
        for done in as_completed(calls):
            yield calls[done]


def _call(functions: Sequence[str]) -> None:
    """Call the functions in a new process, with the modules of this installation.

    -P leaves the current folder out of the search path, which may be another copy of the package. Garbage collection is off: it
    takes a tenth of numba's time.
    """
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    calls = [f"from {module} import {function}; {function}()" for module, function in (name.split(":") for name in functions)]
    lines = "\n".join(["import gc; gc.disable()", *calls])
    subprocess.run([sys.executable, "-P", "-c", lines], env={**os.environ, "PYTHONPATH": path}, capture_output=True, check=False)
