"""Machine code made before a first run, by several processes at once: in one process numba compiles one function at a time."""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed

from stereo_seecolor.compute.sources import ROOT
from stereo_seecolor.compute.threads import cores


def call_in_processes(functions: Sequence[str]) -> Iterator[Sequence[str]]:
    """Call each ``module:function``, dealt to a process a core; those of a process when it has ended.

    What they compile is kept on disk. One that fails says nothing: what it leaves undone is compiled when it is needed.
    """
    shares = [functions[first :: cores()] for first in range(min(cores(), len(functions)))]
    with ThreadPoolExecutor(len(shares)) as pool:
        calls = {pool.submit(_call, share): share for share in shares}
        for done in as_completed(calls):
            yield calls[done]


def _call(functions: Sequence[str]) -> None:
    """By this installation's package: -P leaves out the present folder, which may be another copy of it, such as a clone.

    Without looking for garbage, which takes a tenth of the time that numba compiles in.
    """
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    calls = [f"from {module} import {function}; {function}()" for module, function in (name.split(":") for name in functions)]
    lines = "\n".join(["import gc; gc.disable()", *calls])
    subprocess.run([sys.executable, "-P", "-c", lines], env={**os.environ, "PYTHONPATH": path}, capture_output=True, check=False)
