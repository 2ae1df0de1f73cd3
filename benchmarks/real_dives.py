"""Real dives and real calibrations as they were published: one command, which writes
docs/lab/real-dives.md.

    python benchmarks/real_dives.py DATA [--out docs/lab/real-dives.md] [--work FOLDER]

DATA: a folder with ``acfr`` (a reef dive: left/, right/, stereo_calib.mat, poses_left_raw.tum) and
``calibrations``. Takes some minutes on two cores. The images may not be shown, so that there are
numbers only.
"""

import csv
import os
import platform
import random
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np
from arguments import parser_of, sides
from compare import execute

from calibration import CalibrationError, Rectification
from calibration.checks import vertical_disparity
from calibration.formats import format_name, load_rig
from calibration.transforms import rigid_alignment, rotation_from_vector, transform_points
from stereo_seecolor.checks.sample import evenly_spaced, read_both
from stereo_seecolor.color.render.carried import carry_ranges
from stereo_seecolor.commands.rig_loading import REFINING_PAIRS
from stereo_seecolor.config import InputConfig
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.inputs.pairing import pair_folders
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.records import Trajectory
from stereo_seecolor.run_folder.finished_run import FinishedFrame, FinishedRun, open_run

TREE = Path(__file__).resolve().parents[1]
RIGS = {
    "calibrations/caltech1.mat": ((2448, 2048), 152.7),
    "calibrations/viame_mm.npz": ((2448, 2048), 209.7),
    "calibrations/mcos_150.mat": ((1920, 1080), 129.4),
    "acfr/stereo_calib.mat": ((1360, 1024), 80.35),
}
"""Size of the images, for files that do not state it, and the stored baseline in mm; of viame its
offset along x.
"""
MALFORMED = 100
NOISE = ((0.1, 0.1, 0.03), 2.0)
"""Standard errors of disturbed navigation: meters east, north, and of depth; degrees."""
DRAWS = 3

Row = tuple[str, str, str]
"""What, on what it was measured, the number."""


@dataclass(frozen=True)
class Dive:
    """The reef dive as published, and where results lie."""

    data: Path
    work: Path

    @property
    def out(self) -> Path:
        return self.work / "acfr"

    def words(self, out: Path, *more: object) -> list[object]:
        given = sides(self.data, self.data / "stereo_calib.mat")
        return ["run", *given, "--out", out, *more]


def the_dive(dive: Dive) -> Iterator[Row]:
    """One command, from the pairs to the map."""
    load = os.getloadavg()[0]
    used = execute(TREE, *dive.words(dive.out, "--refine", "--fuse"))
    run = open_run(dive.out)
    yield (
        "`run --refine --fuse`",
        "20 pairs, 1360x1024",
        f"{len(run.frames)} of {run.totals['pairs']} done",
    )
    yield (
        "elapsed, processor time, memory",
        f"{os.cpu_count()} cores, load {load:.0f} at the start",
        (f"{used.elapsed_s:.0f} s, {used.processor_s:.0f} s, {used.peak_mib / 1024:.1f} GiB"),
    )
    yield from _rows(dive, run)
    yield from _track(dive)
    known = np.array([_known_fractions(run, frame) for frame in run.frames])
    yield (
        "fraction with a range, of the pixels that both cameras see",
        "mean of 20 frames",
        f"{known[:, 0].mean():.1%}",
    )
    yield "fraction with a range, of the frame", "mean of 20 frames", f"{known[:, 1].mean():.1%}"


def _rows(dive: Dive, run: FinishedRun) -> Iterator[Row]:
    found = run.rig.refinement
    if found is None:
        yield "vertical disparity", "", "not refined"
        return
    yield "vertical disparity as published", f"{found.pairs} pairs", f"{found.before_px:.2f} px"
    yield "the same, refined", "each pair left out in turn", f"{found.after_px:.2f} px"
    images = InputConfig()
    pairs = pair_folders(dive.data / "left", dive.data / "right", images).pairs
    others = [pair for pair in pairs if pair not in evenly_spaced(pairs, REFINING_PAIRS)]
    check = vertical_disparity(run.rig, (read_both(pair, images) for pair in others))
    yield (
        "the same, refined",
        f"{check.pairs} pairs that took no part",
        f"{check.row_error_px:.2f} px",
    )


def _track(dive: Dive) -> Iterator[Row]:
    """The own track's positions against the survey's, which both are of the left camera's
    center.
    """
    own, given = (
        read_trajectory(dive.out / "map" / "trajectory.tum"),
        read_trajectory(dive.data / "poses_left_raw.tum"),
    )
    order = [int(np.abs(given.timestamps_s - time_s).argmin()) for time_s in own.timestamps_s]
    a, b = own.T_world_camera[:, :3, 3], given.T_world_camera[order, :3, 3]
    off_m = transform_points(rigid_alignment(a, b), a) - b
    path_m = float(np.linalg.norm(np.diff(b, axis=0), axis=1).sum())
    rms_m = float(np.sqrt((off_m**2).sum(axis=1).mean()))
    scale = np.linalg.norm(a - a.mean(axis=0)) / np.linalg.norm(b - b.mean(axis=0))
    against = f"the survey's SLAM, {path_m:.2f} m"
    yield (
        "own track: rms error, rigid alignment",
        against,
        f"{rms_m * 1000:.1f} mm, {rms_m / path_m:.2%} of the path",
    )
    yield "own track: scale", against, f"{scale - 1:+.2%}"


def _known_fractions(run: FinishedRun, frame: FinishedFrame) -> tuple[float, float]:
    """Of the pixels that both cameras see, by ranges carried over where none was measured; and of
    the frame.
    """
    assert run.geometry
    range_m = frame.measured_range_m()
    everywhere_m = carry_ranges(frame.read("corrected"), range_m)
    turns = run.geometry.quarter_turns
    pair = run.geometry.turned(-turns)
    disparity = np.rot90(
        run.geometry.disparity_from_depth(everywhere_m / run.geometry.ray_length), -turns
    )
    columns = np.arange(pair.image_size[0], dtype=np.float32) - disparity
    both = (columns >= 0) & (columns <= pair.image_size[0] - 1)
    known = np.isfinite(np.rot90(range_m, -turns))
    return float(known[both].mean()), float(known.mean())


def navigation(dive: Dive) -> Iterator[Row]:
    """The survey's poses as navigation: as they are, and disturbed; the map's rugosity must
    stay.
    """
    own = _last_rugosity(dive)
    true = read_trajectory(dive.data / "poses_left_raw.tum")
    rugosity = [_rugosity(dive, true.timestamps_s, true.T_world_camera)]
    for seed in range(1, DRAWS + 1):
        rng = np.random.default_rng(seed)
        T = true.T_world_camera.copy()
        T[:, :3, 3] += rng.normal(0, NOISE[0], (len(T), 3))
        T[:, :3, :3] = T[:, :3, :3] @ rotation_from_vector(
            rng.normal(0, np.radians(NOISE[1]), (len(T), 3))
        )
        rugosity.append(_rugosity(dive, true.timestamps_s, T))
    yield "linear rugosity, poses of the survey as navigation", "20 pairs", f"{rugosity[0]:.3f}"
    yield "without navigation, by the own track", "20 pairs", f"{own / rugosity[0] - 1:+.1%}"
    changes = ", ".join(f"{value / rugosity[0] - 1:+.1%}" for value in rugosity[1:])
    noise = "poses of the survey with 10 cm, 3 cm and 2 degrees of noise"
    yield noise, f"{DRAWS} random sets", changes


def _rugosity(dive: Dive, times_s: np.ndarray, T: np.ndarray) -> float:
    poses = dive.work / "poses.tum"
    write_tum(poses, Trajectory(("",) * len(T), times_s, T))
    execute(TREE, "fuse", dive.out, "--poses", poses, "--set", "mapping.poses_of=raw")
    return _last_rugosity(dive)


def _last_rugosity(dive: Dive) -> float:
    with (dive.out / "map" / "reef_metrics.csv").open(encoding="utf-8") as file:
        return float(next(csv.DictReader(file))["linear_rugosity"])


def calibrations(data: Path) -> Iterator[Row]:
    """Every calibration, and its baseline."""
    for name, (size, expected_mm) in RIGS.items():
        rig = load_rig(data / name, size)
        along_mm = 1000 * (
            abs(float(rig.T_right_left[0, 3])) if "viame" in name else rig.baseline_m
        )
        Rectification.from_rig(rig)
        yield (
            f"`{name}`, {format_name(data / name)}",
            f"{expected_mm:g} mm stored",
            f"{along_mm:.2f} mm",
        )


def malformed(data: Path, work: Path) -> Iterator[Row]:
    """Damaged copies of the binary files, each read in a process of its own."""
    seeds = [data / name for name in RIGS]
    results = [
        _read_damaged(path, size)
        for path, (size, _) in zip(_damaged(seeds, work), cycle(RIGS.values()), strict=False)
    ]
    lines = sum(kind == "refused" for kind, *_ in results)
    wrong = [said for kind, _, _, said in results if kind == "error"]
    yield (
        "malformed binary files",
        f"{len(results)} of {len(seeds)} files",
        (
            f"{lines} refused in one line, {sum(kind == 'read' for kind, *_ in results)} still "
            f"whole, {len(wrong)} other errors"
        ),
    )
    yield (
        "longest time, and most memory above the program's own",
        "the same",
        (
            f"{max(seconds for _, seconds, *_ in results):.2f} s, "
            f"{max(mib for _, _, mib, _ in results):.0f} MiB"
        ),
    )
    for said in wrong[:5]:
        print("not refused:", said, file=sys.stderr)


def _damaged(seeds: list[Path], work: Path) -> Iterator[Path]:
    """Cut short, bytes changed, lengths made huge, blocks repeated or left out; the same on every
    run.
    """
    rng = random.Random(1)
    for number in range(MALFORMED):
        seed = seeds[number % len(seeds)]
        content = bytearray(seed.read_bytes())
        at = rng.randrange(4 if number % 5 else 128, len(content))
        kind = number % 5
        if kind == 0:
            del content[at:]
        elif kind == 1:
            for place in rng.sample(range(len(content)), 20):
                content[place] = rng.randrange(256)
        elif kind == 2:
            content[at : at + 4] = b"\xff\xff\xff\x7f"
        elif kind == 3:
            del content[at : at + rng.randrange(1, 500)]
        else:
            content[at:at] = content[at : at + 2000]
        path = work / f"damaged_{number}{seed.suffix}"
        path.write_bytes(bytes(content))
        yield path


def _read_damaged(path: Path, size: tuple[int, int]) -> tuple[str, float, float, str]:
    """(read, refused or error; seconds; MiB that the process grew by; what was said)."""
    receiver, sender = os.pipe()
    before_mib = (
        int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20
    )
    started = time.perf_counter()
    child = os.fork()
    if not child:
        os.write(sender, _read_one(path, size).encode()[:2000])
        os._exit(0)
    os.close(sender)
    _, _, used = os.wait4(child, 0)
    with os.fdopen(receiver, encoding="utf-8", errors="replace") as said:
        kind, _, text = said.read().partition(":")
    return (
        kind or "error",
        time.perf_counter() - started,
        max(used.ru_maxrss / 1024 - before_mib, 0.0),
        text or f"{path}: crashed",
    )


def _read_one(path: Path, size: tuple[int, int]) -> str:
    try:
        load_rig(path, size)
    except CalibrationError as error:
        return (
            f"refused:{error}"
            if "\n" not in str(error)
            else f"error:{path}: several lines: {error}"
        )
    except BaseException as error:  # whatever else comes is a fault
        return f"error:{path}: {type(error).__name__}: {error}"
    return "read:"


def table(title: str, rows: list[Row]) -> str:
    """A heading and a table."""
    lines = [f"## {title}", "", "| what | measured on | result |", "| --- | --- | --- |"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows), ""])


INTRODUCTION = """# Real dives

```bash
python benchmarks/real_dives.py DATA
```

![The map of the sample dive, seen obliquely, and its orthomosaic](../images/map_sample.jpg)

*The map of the synthetic sample dive, since these dives may not be shown.*

**Data.** Real, as published: a reef dive (20 consecutive pairs at 2 Hz, 1360x1024, a vertical pair with color on the left and monochrome on the right, strobe-lit, calibrated in water with MATLAB; Australian Centre for Field Robotics), and calibration files of four real underwater rigs. Track and poses are compared with the survey's own SLAM of the same images: a consistency check, not independent ground truth.
"""  # noqa: E501
END = """`tests/mapping/test_real_navigation.py` tests on this dive that wrong axes, units, norths and clocks, and poses on wrong frames, are named, and that the published poses are not.
"""  # noqa: E501


def page(data: Path, work: Path) -> str:
    """The page with all tables."""
    dive = Dive(data / "acfr", work)
    parts = [
        INTRODUCTION,
        table("A reef dive", list(the_dive(dive))),
        table("Navigation on the reef dive", list(navigation(dive))),
        END,
        table("Calibration files", [*calibrations(data), *malformed(data, work)]),
        f"Python {platform.python_version()}, {platform.machine()}.\n",
    ]
    return "\n".join(parts)


def main() -> None:
    """Measure all, and write the page."""
    parser = parser_of(__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--out", type=Path, default=TREE / "docs" / "lab" / "real-dives.md")
    parser.add_argument("--work", type=Path)
    words = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        work = words.work or Path(temporary)
        work.mkdir(parents=True, exist_ok=True)
        words.out.write_text(page(words.data.resolve(), work), encoding="utf-8")
    print(words.out.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
