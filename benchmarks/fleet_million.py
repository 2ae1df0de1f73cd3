"""A million pairs on 200 workers, simulated: the program's own batches and sums, a measured
scheduler, workers that only wait.

What is real: ``DaskCompute`` with its batches, order and window; what rows, tables and batches
cost, which is measured apart.
What stands in for something else: time, which is counted and not waited for, the scheduler, and the
work of a worker.
"""

import pickle
import time
from collections.abc import Callable
from dataclasses import dataclass
from heapq import heappush, heapreplace
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.sharing.survey import CountedFrames
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.dive.dive_run import Outcome
from stereo_seecolor.dive.pair_sequences import GROUP
from stereo_seecolor.extras.fleet.cluster.dask_compute import DaskCompute
from stereo_seecolor.extras.fleet.cluster.worker import Done
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.frame_table import FrameTable


@dataclass(frozen=True)
class Costs:
    """Seconds, measured on one core of the machine of docs/fleets.md."""

    ranges_s: float = 0.19
    """First pass of a pair of 1280x1024: decode, rectify, match, count, write (docs/performance.md,
    stage by stage).
    """
    light_s: float = 0.07
    """Search for the dive's light: read again, features, and poses against three frames before (60
    pairs of docs/fleets.md).
    """
    waters_s: float = 0.01
    """Pass for the water once the light is known: the frame's table, kept by the first pass, read
    and added.
    """
    colors_s: float = 0.14
    """Second pass: decode and rectify again, correct, write."""
    spread: float = 0.1
    """Standard deviation of a pair's time, as a fraction."""
    row_s: float = 0.04e-3
    """Client, each pair and pass: unpickle the row, table of frames, progress."""
    table_s: float = 0.06e-3
    """Client, each pair of the pass for the water: a 32nd of unpickling and adding the table of its
    group, and its brightness.
    """
    difference_s: float = 0.02e-3
    """Client, each pair of the search for light: how it differs from frames before it."""
    serial_s: float = 0.15e-3
    """Client, each pair, while no worker has anything to do: pairing, gains, waters, water.json,
    records, frames.csv, run.json (``fleet.py client``).
    """
    batch_s: float = 8e-3
    """Scheduler and client, each batch."""
    lost_every_s: float = 20 * 3600.0
    """Each worker is lost once in so many seconds, and its batch done again."""


LARGE = Costs(ranges_s=4 * Costs.ranges_s, light_s=2 * Costs.light_s, colors_s=4 * Costs.colors_s)
"""Pairs of 5 megapixels: four times the pixels, of which the search for light reads all and looks
at as many as of small ones.
"""


@dataclass
class Clock:
    """Time that passes without anybody waiting."""

    now_s: float = 0.0


class SimulatedWorkers:
    """Batches go to the worker that is free first, through a scheduler that takes one at a time."""

    def __init__(self, clock: Clock, workers: int, pair_s: float, costs: Costs) -> None:
        self.clock, self.costs, self._pair_s = clock, costs, pair_s
        self._free: list[float] = []
        for _ in range(workers):
            heappush(self._free, clock.now_s)
        self._scheduler_s = clock.now_s
        self._random = np.random.default_rng(0)
        self.batches, self.worked_s = 0, 0.0

    def nthreads(self) -> dict[str, int]:
        return {str(number): 1 for number in range(len(self._free))}

    def cancel(self, futures: list[Any], force: bool) -> None:
        """Nothing is under way at the end."""

    def send(self, batch: list[int]) -> "SimulatedFuture":
        self._scheduler_s = max(self._scheduler_s, self.clock.now_s) + self.costs.batch_s
        needed = (
            len(batch)
            * self._pair_s
            * (1 + self.costs.spread * self._random.standard_normal() / len(batch) ** 0.5)
        )
        self.worked_s += needed
        self.batches += 1
        taken = needed
        if self._random.random() < needed / self.costs.lost_every_s:
            taken += needed * self._random.random()
        end_s = max(self._free[0], self._scheduler_s) + taken
        heapreplace(self._free, end_s)
        return SimulatedFuture(self.clock, end_s, needed, len(batch))


@dataclass(frozen=True)
class SimulatedFuture:
    clock: Clock
    end_s: float
    seconds: float
    number: int

    def result(self, timeout: float) -> Any:
        self.clock.now_s = max(self.clock.now_s, self.end_s)
        return SimulatedDone(self.seconds, range(self.number))


@dataclass(frozen=True)
class SimulatedDone:
    seconds: float
    results: range
    process: str = ""
    used_core_seconds: float = 0.0
    peak_bytes: int = 0


class SimulatedCompute(DaskCompute):
    """The program's own, whose batches are sent to workers that are simulated."""

    def _sender(self, do: Any, work: Any) -> Callable[[list[Any]], Any]:
        workers: SimulatedWorkers = self._client
        return workers.send


@dataclass(frozen=True)
class Simulated:
    """efficiency: work divided by workers and time. client: fraction of the time that the client
    works.
    """

    pairs: int
    workers: int
    hours: float
    core_hours: float
    efficiency: float
    client: float
    batches: int


def simulate(pairs: int, workers: int, costs: Costs = Costs()) -> Simulated:
    """All passes of a dive, and what the client does between and after them."""
    clock, worked_s, batches, client_s = (
        Clock(costs.serial_s * pairs),
        0.0,
        0,
        costs.serial_s * pairs,
    )
    passes = (
        (costs.ranges_s, costs.row_s),
        (costs.light_s, costs.difference_s),
        (costs.waters_s, costs.row_s / 2 + costs.table_s),
        (costs.colors_s, costs.row_s),
    )
    for pair_s, row_s in passes:
        found = SimulatedWorkers(clock, workers, pair_s, costs)
        for _ in SimulatedCompute(found, "simulated", lambda: None).each(abs, range(pairs)):
            clock.now_s += row_s
            client_s += row_s
        worked_s, batches = worked_s + found.worked_s, batches + found.batches
    efficiency = worked_s / (workers * clock.now_s)
    return Simulated(
        pairs,
        workers,
        clock.now_s / 3600,
        worked_s / 3600,
        efficiency,
        client_s / clock.now_s,
        batches,
    )


# What is measured for it


def measure_sums(tables: list[MomentTable], frames: int) -> None:
    """Processor time of the client for each pair: rows and tables as workers send them, unpickled
    and added.
    """
    facts = {"coverage": 0.9, "median_range_m": 1.8, "camera_exposure_s": 0.01}
    hashes, seconds = (
        {"left": "0" * 64, "right": "0" * 64},
        {"read": 0.05, "match": 0.06, "write": 0.02, "rectify": 0.01},
    )
    config, sent = ColorConfig(), []
    for start in range(0, frames, GROUP):
        rows = []
        for number in range(start, start + GROUP):
            name = f"reef_{number:07d}"
            left, right = f"/data/dive/left/{name}.png", f"/data/dive/right/{name}.png"
            row = FrameRow(
                name,
                "ok",
                left,
                right,
                1.79e9 + number,
                hashes=hashes,
                facts=facts,
                seconds=seconds,
            )
            rows.append(Outcome(row, True, None, ("range",), ()))
        counted = CountedFrames.of(
            ((one.row.name, tables[k % len(tables)]) for k, one in enumerate(rows)), config
        )
        sent.append(pickle.dumps([(rows, counted)]))
    fitter, table, begun_s = Corrector().survey_fitter(), FrameTable(), time.process_time()
    for one in sent:
        for outcomes, counted in Done(one, 0.0).results:
            for outcome in outcomes:
                table.add(outcome.row)
            fitter.join(counted)
    cost_ms = 1000 * (time.process_time() - begun_s) / frames
    print(
        f"sums: {cost_ms:.2f} ms of the client for each of {frames} pairs, groups of "
        f"{len(sent[0]) / 1e3:.0f} kB"
    )


def measure_rows(frames: int) -> None:
    """Memory of the client for the rows of a dive."""
    before, table = psutil.Process().memory_info().rss, FrameTable()
    for number in range(frames):
        name, seconds = (
            f"reef_{number:07d}",
            {"read": 0.05 + number, "match": 0.06, "write": 0.02, "rectify": 0.01},
        )
        row = FrameRow(
            name,
            "ok",
            f"/data/dive/left/{name}.png",
            f"/data/dive/right/{name}.png",
            1.0,
            seconds=seconds,
        )
        table.add(pickle.loads(pickle.dumps(row)))
    print(
        f"rows: {(psutil.Process().memory_info().rss - before) / frames / 1e3:.2f} kB of the "
        "client for each pair"
    )


def million(pairs: int, workers: int, tables: Path | None) -> None:
    """All that docs/fleets.md says of a million pairs."""
    begun_s, memory = time.process_time(), psutil.Process().memory_info().rss
    found = simulate(pairs, workers)
    used_s, grown = time.process_time() - begun_s, psutil.Process().memory_info().rss - memory
    print(found)
    print(
        f"cutting and ordering {found.batches} batches: {used_s:.1f} s of the client, "
        f"{grown / 1e6:.0f} MB"
    )
    for others in ((10_000, workers), (100_000, workers), (pairs, 100), (pairs, 150), (pairs, 400)):
        print(simulate(*others))
    for number in (workers, 800):
        print("of 5 megapixels:", simulate(pairs, number, LARGE))
    measure_rows(20_000)
    if tables:
        measure_sums(kept_tables(tables), 32 * GROUP)


def kept_tables(out: Path) -> list[MomentTable]:
    """Of the frames of a run."""
    import zlib

    found = sorted((out / ".state" / "tables").rglob("*.kept"))
    return [MomentTable.unpacked(zlib.decompress(path.read_bytes()[64:])) for path in found]


def growth(file: Path) -> None:
    """Draw time and efficiency over workers, for a million pairs of two sizes and for a dive of
    10,000.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    mpl.rcParams |= {
        "font.size": 9,
        "savefig.bbox": "tight",
        "svg.hashsalt": "seecolor",
        "svg.fonttype": "none",
    }
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    numbers = (1, 2, 5, 10, 20, 50, 100, 200, 400, 800)
    for pairs, costs, label in (
        (1_000_000, LARGE, "1,000,000 pairs of 5 MP"),
        (1_000_000, Costs(), "1,000,000 pairs of 1.3 MP"),
        (10_000, LARGE, "10,000 pairs of 5 MP"),
    ):
        found = [simulate(pairs, number, costs) for number in numbers]
        axes[0].loglog(numbers, [one.hours for one in found], "o-", ms=3, label=label)
        axes[1].semilogx(numbers, [100 * one.efficiency for one in found], "o-", ms=3, label=label)
    axes[0].set(xlabel="workers of one core", ylabel="hours")
    axes[1].set(xlabel="workers of one core", ylabel="efficiency, %", ylim=(0, 105))
    axes[0].legend(frameon=False)
    for axis in axes:
        axis.grid(alpha=0.3)
    figure.savefig(file, metadata={"Date": None})
    plt.close(figure)
