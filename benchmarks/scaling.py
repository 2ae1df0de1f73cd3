"""How `run` would scale to more cores than this machine has: its parts measured with one worker,
their schedule simulated.

    python benchmarks/scaling.py DIVE --long 2000

DIVE: a folder with left, right and cam.yaml, of more than 60 pairs (the light of fewer is looked
for while they are measured).
Real, with one worker and one core for each image: the processor time of every pass over the pairs
and of what the main thread does alone, and how long each held Python's global lock, looked at some
3,000 times a second. Simulated: as many workers as cores and two pairs a worker under way, taken by
the main thread in their order; pairs and main thread take turns with the lock and without it, for
random times of the measured means. Taken as fast enough: disks, memory, and handing over the lock.
--long: so many pairs instead, each pass as long in proportion; what the main thread does alone
stays as it is.
"""

import ctypes
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from pathlib import Path
from typing import Any

import numpy as np
from arguments import parser_of
from compare import machine
from growth import sides

from stereo_seecolor import cli
from stereo_seecolor.compute import threads

CORES = (1, 2, 4, 8, 16, 32, 64)
LOOK = "FrameMatcher."
"""Begins the names of the passes that look for the light, which run inside each other: they are one
part, named as the first.
"""
SECONDS = ("pairs_s", "main_s", "pairs_locked_s", "main_locked_s")
CLOCKS = time.CLOCK_PROCESS_CPUTIME_ID, time.CLOCK_MONOTONIC
NOTHING_S = 0.005
TURNS = 20
"""With the lock and without it, of each pair in each pass."""


@dataclass(frozen=True)
class Part:
    """A pass over ``items``, or what the main thread does alone (items = 0).

    pairs_s: processor time of all items. main_s: of the main thread meanwhile. pairs_locked_s,
    main_locked_s: with Python's lock.
    """

    name: str
    items: int = 0
    pairs_s: float = 0.0
    main_s: float = 0.0
    pairs_locked_s: float = 0.0
    main_locked_s: float = 0.0


class LockWatch:
    """Looks at who holds Python's global lock, from a thread that never needs it.

    held_s: (2,) processor time of this process while it was held by the thread that made this, and
    by others: of a thread that holds it and has to wait for a core, nothing.
    """

    def __init__(self) -> None:
        import numba

        library, state = ctypes.CDLL(None), ctypes.pythonapi.PyThreadState_Get
        sleep, clock, state.restype = library.usleep, library.clock_gettime, ctypes.c_size_t
        sleep.argtypes, clock.argtypes = [ctypes.c_uint], [ctypes.c_int, ctypes.c_void_p]
        start = ctypes.addressof(ctypes.c_char.in_dll(ctypes.pythonapi, "_PyRuntime"))
        words = np.ctypeslib.as_array((ctypes.c_uint64 * 400).from_address(start))
        self.held_s = np.zeros(2)

        @numba.njit(nogil=True)
        def unlocked(words: Any) -> Any:
            return words.copy()

        @numba.njit(nogil=True)
        def watch(word: Any, mine: Any, held_s: Any, now: Any) -> None:
            while True:
                before = now.copy()
                sleep(200)
                clock(CLOCKS[0], now[0].ctypes)
                clock(CLOCKS[1], now[1].ctypes)
                spent = now - before
                if word[0] != 0:
                    seconds = spent[:, 0] + 1e-9 * spent[:, 1]
                    held_s[0 if word[0] == mine else 1] += min(seconds[0], seconds[1])

        mine = np.uint64(state())
        unlocked(words)
        holder = np.flatnonzero((words == mine) & (unlocked(words) == 0))
        assert holder.size, "this Python does not show who holds its lock"
        word, now = words[holder[0] :][:1], np.zeros((2, 2), np.int64)
        threading.Thread(target=watch, args=(word, mine, self.held_s, now), daemon=True).start()
        time.sleep(1)  # compiles


class Recorder:
    """Cuts a run into its parts, at the passes that threads take items through. parts: in their
    order.
    """

    def __init__(self) -> None:
        self.watch = LockWatch()
        self.parts: list[Part] = []
        self._mark = self._now()

    def begin(self) -> None:
        """What has been used until now counts for nothing."""
        self._mark = self._now()

    def each(
        self, threads: Any, work: Callable[[Any], Any], items: Iterable[Any], plain: Any
    ) -> Iterator[Any]:
        """As ``Threads.each``, recorded."""
        done = 0
        self.close("alone")
        for result in plain(threads, work, items):
            done += 1
            yield result
        name = getattr(work, "work", work)
        self.close(getattr(name, "__qualname__", type(name).__name__), done)

    def close(self, name: str, items: int = 0) -> None:
        """End a part."""
        before, self._mark = self._mark, self._now()
        all_s, main_s, (main_locked_s, pairs_locked_s) = (
            b - a for a, b in zip(before, self._mark, strict=True)
        )
        part = Part(
            name, items, all_s - main_s, main_s, float(pairs_locked_s), float(main_locked_s)
        )
        last = self.parts[-1] if self.parts else part
        inside = last.name.startswith(LOOK) and name.startswith(LOOK) and name != last.name
        if inside or (last.name.startswith(LOOK) and all_s < NOTHING_S):
            self.parts[-1] = replace(
                last, **{key: getattr(last, key) + getattr(part, key) for key in SECONDS}
            )
        elif all_s >= NOTHING_S:
            self.parts.append(part)

    def _now(self) -> tuple[float, float, Any]:
        return time.process_time(), time.thread_time(), self.watch.held_s.copy()


def record(words: list[object]) -> list[Part]:
    """One command in this process, with one thread for the parts of an image; what it consists
    of.
    """
    recorder = Recorder()
    plain = threads.Threads.each
    threads.Threads.each = lambda self, work, items: recorder.each(self, work, items, plain)  # type: ignore[method-assign]
    threads.limit_cores(1)
    sys.argv = ["stereo-seecolor", *map(str, words)]
    recorder.begin()
    try:
        cli.main()
    except SystemExit as end:
        assert not end.code, end.code
    recorder.close("alone")
    return recorder.parts


class Schedule:
    """One pass on so many cores, by as many workers."""

    def __init__(self, part: Part, cores: int) -> None:
        self._part, self._cores, self._lock_free_s = part, cores, 0.0
        self._random = np.random.default_rng(0)

    @property
    def elapsed_s(self) -> float:
        """Until the main thread has taken the last item."""
        part, window = self._part, 2 * self._cores
        events: list[tuple[float, int, int]] = []  # when, item, turns it has had
        ended: dict[int, float] = {}
        taken: list[float] = []
        begun, idle = 0, self._cores

        def begin(now: float) -> None:
            nonlocal begun, idle
            while idle and begun < min(part.items, len(taken) + window):
                heappush(
                    events, (max(now, taken[begun - window]) if begun >= window else now, begun, 0)
                )
                begun, idle = begun + 1, idle - 1

        begin(0.0)
        while events:
            now, item, turns = heappop(events)
            if turns < TURNS:
                heappush(
                    events, (self._turn(now, part.pairs_s, part.pairs_locked_s), item, turns + 1)
                )
                continue
            ended[item], idle = now, idle + 1
            while len(taken) in ended:
                ready = max(ended[len(taken)], taken[-1] if taken else 0.0)
                taken.append(self._turn(ready, TURNS * part.main_s, TURNS * part.main_locked_s))
            begin(now)
        # the main thread runs on one of the cores
        return max(taken[-1], (part.pairs_s + part.main_s) / self._cores)

    def _turn(self, now: float, all_s: float, locked_s: float) -> float:
        """When a turn of an item ends. all_s, locked_s: of all turns of all items."""
        locked, free = (
            seconds / TURNS / self._part.items for seconds in (locked_s, max(all_s - locked_s, 0.0))
        )
        self._lock_free_s = max(now, self._lock_free_s) + self._random.exponential(locked)
        return self._lock_free_s + self._random.exponential(free)


def longer(parts: list[Part], long: int) -> list[Part]:
    """The parts of a run of ``long`` pairs: of the light more segments, and passes over all pairs
    so much longer.
    """
    pairs = max(part.items for part in parts)
    looks, grown = 0, list[Part]()
    for part in parts:
        looks += part.name.startswith(LOOK)
        if part.name.startswith(LOOK) and looks > 1:  # the first is a sample's
            grown += [part] * (round(long / part.items) if looks == 2 else 0)
        elif part.items == pairs:
            grown.append(
                replace(
                    part,
                    items=long,
                    **{name: getattr(part, name) * long / pairs for name in SECONDS},
                )
            )
        else:
            grown.append(part)
    return grown


def report(parts: list[Part]) -> None:
    """The parts of a run, those of one name together, and its simulated schedules."""
    total_s = sum(part.pairs_s + part.main_s for part in parts)
    print(
        "| part | items | s of pairs | with the lock | s of the main thread | with the lock | of "
        "all |\n|" + 7 * "---|"
    )
    for name in dict.fromkeys(part.name for part in parts):
        same = [part for part in parts if part.name == name]
        pairs_s, main_s, pairs_locked_s, main_locked_s = (
            sum(getattr(part, key) for part in same) for key in SECONDS
        )
        seconds = f"{pairs_s:.2f} | {pairs_locked_s:.2f} | {main_s:.2f} | {main_locked_s:.2f}"
        print(
            f"| {name} | {sum(part.items for part in same)} | {seconds} | {main_s / total_s:.1%} |"
        )
    locked_s = sum(part.pairs_locked_s + part.main_locked_s for part in parts)
    print(f"\nwith the lock {locked_s:.1f} of {total_s:.1f} s: {locked_s / total_s:.1%}\n")
    print("| cores | s | times one core |\n|---|---|---|")
    for cores in CORES:
        elapsed_s = sum(
            Schedule(part, cores).elapsed_s if part.items else part.main_s for part in parts
        )
        print(f"| {cores} | {elapsed_s:.1f} | {total_s / elapsed_s:.1f} |", flush=True)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("dive", type=Path)
    parser.add_argument("--long", type=int, default=2000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        parts = record(
            [
                "run",
                *sides(options.dive, options.dive / "cam.yaml"),
                "--out",
                Path(folder) / "out",
                "--workers",
                1,
            ]
        )
    print(f"\n{machine()}\n")
    report(parts)
    print(f"\n{options.long} pairs:\n")
    report(longer(parts, options.long))


if __name__ == "__main__":
    main()
