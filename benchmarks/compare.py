"""How long each command takes against another revision of the program, measured in turn (A B A B
...) on this machine, now.

    python benchmarks/compare.py REV [--same-environment] [--measures run help ...] [--dives sample
    large] [--rounds 5]

REV: a revision of this repository, or the folder of a checkout. Both it and the work tree get an
environment of their own, with the libraries that each one's constraints name; --same-environment
runs both with the Python that runs this script, which takes no minutes to prepare. Each measurement
is a whole process, as a user starts it; before the rounds each is run once, so that compiled code
is there. Prints medians of elapsed and processor seconds, the ratio of the processor times with the
smallest and the largest of the rounds, and the peak memory. Only the ratios can be compared between
machines.

What is measured: color (``correct``), match (``range``), run, rerun (nothing to do), fuse,
fuse-poses, oblique (a map from cameras tilted by 55 degrees), cold (``run`` where nothing is
compiled yet), help. Dives: the sample dive, and 20 synthesized pairs of 1280x1024.
"""

import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from arguments import parser_of, sides

REPOSITORY = Path(__file__).resolve().parents[1]
SAMPLE = REPOSITORY / "data_samples" / "reef"
LARGE_PAIRS, LARGE_SIZE = 20, "1280x1024"
OBLIQUE = """
from pathlib import Path
from stereo_seecolor.extras.synthetic import dive
from stereo_seecolor.extras.synthetic.survey import SurveySpec
dive.synthesize(SurveySpec(pairs=8, lines=1, tilt_deg=55.0), Path({out!r}))
"""
MEASURES = ("color", "match", "run", "rerun", "fuse", "fuse-poses", "oblique", "cold", "help")
ALLOWED_RATIO = 1.1
"""More is marked in the table."""


@dataclass(frozen=True)
class Timing:
    """elapsed_s: by the clock. processor_s: user and system, all threads. peak_mib: resident
    memory.
    """

    elapsed_s: float
    processor_s: float
    peak_mib: float


@dataclass(frozen=True)
class Tree:
    """A checkout, the Python that runs it, and where it may keep byte code."""

    folder: Path
    python: Path
    kept: Path

    def command(self, *words: object, cache: Path | None = None) -> Timing:
        """Run a command of the program to its end; exits with what it said where it fails."""
        return self.python_code("from stereo_seecolor.cli import main; main()", *words, cache=cache)

    def python_code(self, code: str, *words: object, cache: Path | None = None) -> Timing:
        """Run Python with the checkout's package. cache: folder for compiled code, where not the
        usual one.
        """
        line = [str(self.python), "-c", code, *map(str, words)]
        with tempfile.TemporaryFile("w+") as said:
            start = time.perf_counter()
            process = subprocess.Popen(
                line, cwd=self.folder, env=self._environment(cache), stdout=said, stderr=said
            )
            _, status, used = os.wait4(process.pid, 0)
            elapsed_s = time.perf_counter() - start
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode:
                said.seek(0)
                sys.exit(
                    f"{self.folder}: {' '.join(line[3:])}: exit code "
                    f"{process.returncode}\n{said.read()}"
                )
        return Timing(elapsed_s, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)

    def _environment(self, cache: Path | None) -> dict[str, str]:
        """Byte code is kept, as an installed program's is."""
        kept = {
            name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"
        }
        kept |= {
            "PYTHONPATH": str(self.folder),
            "PYTHONPYCACHEPREFIX": str(self.kept / "byte_code"),
        }
        return kept | ({"NUMBA_CACHE_DIR": str(cache)} if cache else {})


@dataclass(frozen=True)
class Bench:
    """One checkout on one dive. work: where its outputs lie."""

    tree: Tree
    dive: Path
    work: Path

    def measure(self, name: str) -> Timing:
        """Measure once, in a new output folder but for a rerun."""
        out = self.work / "out"
        shutil.rmtree(out, ignore_errors=True)
        if name == "help":
            return self.tree.command("--help")
        if name == "rerun":
            return self.tree.command("run", *sides(self.dive), "--out", self._finished())
        if name.startswith("fuse") or name == "oblique":
            shutil.copytree(self._finished(), out)
            poses = ["--poses", self.dive / "trajectory.tum"] if name == "fuse-poses" else []
            return self.tree.command("fuse", out, *poses)
        if name == "color":
            return self.tree.command("correct", *self._rectified(), "--out", out)
        if name == "cold":
            with tempfile.TemporaryDirectory() as empty:
                return self.tree.command("run", *sides(self.dive), "--out", out, cache=Path(empty))
        return self.tree.command(
            "range" if name == "match" else "run", *sides(self.dive), "--out", out
        )

    def _finished(self) -> Path:
        """A finished run, made where it is missing."""
        out = self.work / "finished"
        if not out.is_dir():
            self.tree.command("run", *sides(self.dive), "--out", out)
        return out

    def _rectified(self) -> list[object]:
        out = self.work / "rectified"
        if not out.is_dir():
            self.tree.command("rectify", *sides(self.dive), "--out", out)
        return ["--images", out / "rectified_left", "--range", self._finished() / "range"]


def execute(tree: Path, *words: object) -> Timing:
    """Run a command of a checkout to its end, with the Python that runs this."""
    return Tree(
        tree, Path(sys.executable), Path(tempfile.gettempdir()) / "compare_kept" / tree.name
    ).command(*words)


def make_tree(source: str, work: Path, same_environment: bool) -> Tree:
    """The checkout of a revision, or of a folder, with the Python that is to run it."""
    folder = Path(source).resolve()
    if not folder.is_dir():
        folder = work / source
        folder.mkdir(parents=True)
        archive = subprocess.run(
            ["git", "-C", REPOSITORY, "archive", source], check=True, capture_output=True
        ).stdout
        subprocess.run(["tar", "-x", "-C", folder], input=archive, check=True)
    kept = work / f"kept-{len(list(work.iterdir()))}"
    if same_environment:
        return Tree(folder, Path(sys.executable), kept)
    subprocess.run([sys.executable, "-m", "venv", kept / "environment"], check=True)
    python = kept / "environment" / ("Scripts" if os.name == "nt" else "bin") / "python"
    subprocess.run(
        [python, "-m", "pip", "install", "-q", "-c", folder / "constraints.txt", folder], check=True
    )
    return Tree(folder, python, kept)


def make_dive(kind: str, tree: Tree, dive: Path) -> Path:
    """The folder of a dive, rendered where it is missing."""
    if kind == "sample":
        return SAMPLE
    if kind == "large" and not dive.is_dir():
        tree.command("synthesize", "--pairs", LARGE_PAIRS, "--size", LARGE_SIZE, "--out", dive)
    elif not dive.is_dir():
        tree.python_code(OBLIQUE.format(out=str(dive)))
    return dive


def compare(benches: list[Bench], name: str, rounds: int) -> str:
    """A row of the table: the two checkouts in turn."""
    if name != "cold":
        for bench in benches:
            bench.measure(name)
    old, new = [], []
    for _ in range(1 if name == "cold" else rounds):
        old.append(benches[0].measure(name))
        new.append(benches[1].measure(name))
    cells = [f"{statistics.median(t.elapsed_s for t in timings):.2f}" for timings in (old, new)]
    cells += [f"{statistics.median(t.processor_s for t in timings):.2f}" for timings in (old, new)]
    ratios = sorted(b.processor_s / a.processor_s for a, b in zip(old, new, strict=True))
    ratio = statistics.median(ratios)
    cells.append(
        f"{ratio:.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f}){' !' if ratio > ALLOWED_RATIO else ''}"
    )
    cells += [f"{max(t.peak_mib for t in timings):.0f}" for timings in (old, new)]
    return " | ".join(cells)


def machine() -> str:
    """What the numbers hold for."""
    names = [
        line.partition(":")[2].strip()
        for line in _lines(Path("/proc/cpuinfo"))
        if line.startswith("model name")
    ]
    busy = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return (
        f"{names[0] if names else platform.processor()}, {os.cpu_count()} cores, "
        f"{platform.platform()}{busy}"
    )


def _lines(path: Path) -> list[str]:
    return path.read_text().splitlines() if path.is_file() else []


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("base", metavar="REV", help="revision or checkout to compare with")
    parser.add_argument("--new", default=str(REPOSITORY), help="checkout to judge")
    parser.add_argument("--same-environment", action="store_true")
    parser.add_argument("--measures", nargs="+", choices=MEASURES, default=MEASURES)
    parser.add_argument(
        "--dives", nargs="+", choices=("sample", "large"), default=("sample", "large")
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument(
        "--large-dive", type=Path, help="where the large dive lies, or is to be rendered and kept"
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        trees = [
            make_tree(source, work, options.same_environment)
            for source in (options.base, options.new)
        ]
        print(f"{machine()}\n")
        print(
            "| dive | what | base, s | new, s | base, processor s | new | ratio | base, peak MiB "
            "| new |",
            flush=True,
        )
        print("|---|---|---|---|---|---|---|---|---|", flush=True)
        kinds = [*options.dives, *(["oblique"] if "oblique" in options.measures else [])]
        for kind in kinds:
            dive = make_dive(
                kind,
                trees[1],
                options.large_dive if kind == "large" and options.large_dive else work / kind,
            )
            benches = [
                Bench(tree, dive.resolve(), work / kind / f"by_{n}") for n, tree in enumerate(trees)
            ]
            for name in options.measures:
                if (name == "oblique") == (kind == "oblique") and (
                    name not in ("cold", "help") or kind == options.dives[0]
                ):
                    print(
                        f"| {kind} | {name} | {compare(benches, name, options.rounds)} |",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
