"""What a first run on a machine costs: processor time of `run --fuse` of the sample dive with
nothing compiled, against a run with everything compiled; and which functions take it.

    python benchmarks/cold_start.py [--rounds 3]

Each run is a process of its own; a first one has an empty folder for machine code. Then one more
first run counts, for each function that numba compiles, its own seconds of processor time, without
those of functions that it calls, and how many times it was compiled.
"""

import argparse
import contextlib
import os
import runpy
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

from arguments import parser_of, sides
from compare import REPOSITORY, SAMPLE, machine

SHOWN = 40
"""Functions in the table."""


def main() -> None:
    """Print the ratio and the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--record", type=Path, help=argparse.SUPPRESS)  # in the process it starts
    arguments = parser.parse_args()
    if arguments.record:
        record(arguments.record)
        return
    print(machine())
    with tempfile.TemporaryDirectory() as folder:
        rounds = [
            (processor_s(Path(folder), f"{k}"), processor_s(Path(folder), f"{k}"))
            for k in range(arguments.rounds)
        ]
        for cold_s, warm_s in rounds:
            print(f"first {cold_s:.1f} s, later {warm_s:.1f} s, ratio {cold_s / warm_s:.2f}")
        print(f"median ratio {statistics.median(cold / warm for cold, warm in rounds):.2f}")
        processor_s(Path(folder), "record", __file__, "--record")


def processor_s(folder: Path, kept: str, *script: str) -> float:
    """Run the sample dive in a process, machine code kept in folder/kept; its processor seconds."""
    out = folder / f"out-{len(list(folder.iterdir()))}"
    words = [*script, str(out)] if script else ["-m", "stereo_seecolor", *run_words(out)]
    before = os.times()
    subprocess.run(
        [sys.executable, *words],
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder / kept), "PYTHONPATH": f"{REPOSITORY}"},
        stdout=None if script else subprocess.DEVNULL,
        stderr=None if script else subprocess.DEVNULL,
        check=True,
    )
    after = os.times()
    return sum(after[2:4]) - sum(before[2:4])  # of children, user and system


def run_words(out: Path) -> list[str]:
    """The command, as in the README."""
    return ["run", *sides(SAMPLE), "--out", str(out), "--fuse"]


def record(out: Path) -> None:
    """Run the sample dive in this process, and print what was compiled."""
    from numba.core import event

    own_s: dict[str, list[float]] = defaultdict(list)
    inner_s: list[list[float]] = []

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            inner_s.append([time.thread_time(), 0.0])

        def on_end(self, event: Any) -> None:
            began_s, within_s = inner_s.pop()
            taken_s = time.thread_time() - began_s
            if inner_s:
                inner_s[-1][1] += taken_s
            function = event.data["dispatcher"].py_func
            own_s[f"{function.__module__}.{function.__qualname__}"].append(taken_s - within_s)

    event.register("numba:compile", Listener())
    sys.argv = ["stereo-seecolor", *run_words(out)]
    with contextlib.suppress(SystemExit):
        runpy.run_module("stereo_seecolor", run_name="__main__")
    every = [(sum(times), len(times), name) for name, times in own_s.items()]
    print(f"compiled: {sum(e[1] for e in every)} times {len(every)} functions, "
          f"{sum(e[0] for e in every):.1f} s")  # fmt: skip
    for taken_s, times, name in sorted(every, reverse=True)[:SHOWN]:
        print(f"{taken_s:6.2f} s {times:3d} {name}")


if __name__ == "__main__":
    main()
