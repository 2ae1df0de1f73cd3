"""How long the commands of two checkouts take, in turn (A B A B ...), so that a machine that changes its speed changes both alike.

    python benchmarks/side_by_side.py BASE_TREE NEW_TREE [--dives sample large] [--commands run rerun range ...] [--rounds 5]

Each measurement is a whole process, as a user starts it: byte code is kept, as an installed program's is. Before the rounds both
checkouts run the command once, which compiles what is compiled once on a machine. rerun: a run that finds nothing to do.
Dives: the sample dive, and 20 synthesized pairs of 1280x1024. Prints the median seconds of both (elapsed, and processor time,
which other programs on the machine disturb less), and the median of the ratios round by round.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

SAMPLE = Path(__file__).resolve().parents[1] / "data_samples" / "reef"
LARGE_PAIRS, LARGE_SIZE = 20, "1280x1024"
COMMANDS = ("run", "rerun", "range", "correct", "fuse")
ALLOWED_RATIO = 1.1
"""More is marked in the table."""


@dataclass(frozen=True)
class Timing:
    """elapsed_s: by the clock. processor_s: user and system, all threads. peak_mib: resident memory."""

    elapsed_s: float
    processor_s: float
    peak_mib: float


def environment(tree: Path) -> dict[str, str]:
    """Imports from the checkout, whose byte code is kept in the folder for temporary files."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"PYTHONPATH": str(tree), "PYTHONPYCACHEPREFIX": str(Path(tempfile.gettempdir()) / "side_by_side_byte_code")}


def execute(tree: Path, *words: object) -> Timing:
    """Run a command of a checkout to its end; exits with what it said where it fails."""
    line = [sys.executable, "-c", "from stereo_seecolor.cli import main; main()", *map(str, words)]
    with tempfile.TemporaryFile("w+") as said:
        start = time.perf_counter()
        process = subprocess.Popen(line, cwd=tree, env=environment(tree), stdout=said, stderr=said)
        _, status, used = os.wait4(process.pid, 0)
        elapsed_s = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            said.seek(0)
            sys.exit(f"{tree}: {' '.join(line[3:])}: exit code {process.returncode}\n{said.read()}")
    return Timing(elapsed_s, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


@dataclass(frozen=True)
class Bench:
    """One checkout on one dive. work: where its outputs lie."""

    tree: Path
    dive: Path
    work: Path

    def prepare(self) -> None:
        """A finished run to fuse, and rectified images with range maps to correct."""
        execute(self.tree, "run", *self._sides(), "--out", self.work / "finished")
        execute(self.tree, "rectify", *self._sides(), "--out", self.work / "rectified")

    def measure(self, command: str) -> Timing:
        """Run a command once, in a new output folder but for a rerun."""
        if command == "rerun":
            return execute(self.tree, "run", *self._sides(), "--out", self.work / "finished")
        out = self.work / "out"
        shutil.rmtree(out, ignore_errors=True)
        if command == "fuse":
            shutil.copytree(self.work / "finished", out)
            return execute(self.tree, "fuse", out)
        inputs = self._rectified() if command == "correct" else self._sides()
        return execute(self.tree, command, *inputs, "--out", out)

    def _sides(self) -> list[object]:
        return ["--left", self.dive / "left", "--right", self.dive / "right", "--calib", self.dive / "cam.yaml"]

    def _rectified(self) -> list[object]:
        return ["--images", self.work / "rectified" / "rectified_left", "--range", self.work / "finished" / "range"]


def make_dive(kind: str, tree: Path, dive: Path) -> Path:
    if kind == "sample":
        return SAMPLE
    if not dive.is_dir():
        execute(tree, "synthesize", "--pairs", LARGE_PAIRS, "--size", LARGE_SIZE, "--out", dive)
    return dive


def compare(benches: list[Bench], command: str, rounds: int) -> str:
    """A row of the table: the two checkouts in turn."""
    for bench in benches:
        bench.measure(command)
    old, new = [], []
    for _ in range(rounds):
        old.append(benches[0].measure(command))
        new.append(benches[1].measure(command))
    cells = []
    for key in ("elapsed_s", "processor_s"):
        medians = [statistics.median(getattr(timing, key) for timing in timings) for timings in (old, new)]
        ratio = statistics.median(getattr(b, key) / getattr(a, key) for a, b in zip(old, new, strict=True))
        cells.append(f"{medians[0]:8.2f} | {medians[1]:8.2f} | {ratio:5.2f}{' !' if ratio > ALLOWED_RATIO else '  '}")
    peaks = [max(timing.peak_mib for timing in timings) for timings in (old, new)]
    return f"{' | '.join(cells)} | {peaks[0]:5.0f} | {peaks[1]:5.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", type=Path, help="checkout to compare with")
    parser.add_argument("new", type=Path, help="checkout to judge")
    parser.add_argument("--dives", nargs="+", choices=("sample", "large"), default=("sample", "large"))
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=COMMANDS)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--large-dive", type=Path, help="where the large dive lies, or is to be rendered and kept")
    options = parser.parse_args()
    trees = [tree.resolve() for tree in (options.base, options.new)]
    print("| dive | command | base, s | new, s | ratio | base, processor s | new | ratio | base, peak MiB | new |", flush=True)
    print("|---|---|---|---|---|---|---|---|---|---|", flush=True)
    for kind in options.dives:
        with tempfile.TemporaryDirectory() as folder:
            dive = make_dive(kind, trees[0], (options.large_dive or Path(folder) / "dive").resolve())
            benches = [Bench(tree, dive, Path(folder) / name) for name, tree in zip(("base", "new"), trees, strict=True)]
            for bench in benches:
                bench.prepare()
            for command in options.commands:
                print(f"| {kind} | {command} | {compare(benches, command, options.rounds)} |", flush=True)


if __name__ == "__main__":
    main()
