"""How time and memory of a map grow with the number of pairs: 640x512, given poses, default
settings, all products.

    python benchmarks/mapping_speed.py [pairs ...]

24 frames of a synthetic reef, read from disk as a run leaves them, are laid end to end until there
are as many as asked for, each time over other ground. Each map is made by a process of its own:
processor seconds (user and system) and peak resident memory.
"""

import os
import platform
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from arguments import words_of

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from mapping_scene import ReefFrames, write_run

from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.mapping.survey_map import Workspace, build_map
from stereo_seecolor.records import SurveyFrame, Trajectory
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.survey_frames import SurveyFrames

SPEC = SurveySpec(pairs=24, lines=2, image_size=(640, 512), altitude_m=(2.0, 2.0))
SPACING_M = 8.0
PAIRS = (30, 60, 120, 240)


class Repeated(Sequence[SurveyFrame]):
    """The frames of a run folder over and over, each time under other names."""

    def __init__(self, frames: SurveyFrames, count: int) -> None:
        self._frames, self._count = frames, count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, i: int) -> SurveyFrame:  # type: ignore[override]
        frame = self._frames[i % len(self._frames)]
        return SurveyFrame(
            f"{i:06d}", float(i), frame.color, frame.range_m, frame.range_std_m, frame.confidence
        )


def measured(run: Path, trajectory: Trajectory, folder: Path) -> str:
    """A row of the table: the map of as many pairs as the trajectory has."""
    started, pairs = time.perf_counter(), len(trajectory.names)
    finished, workspace = SurveyFrames(open_run(run)), Workspace(compute=Threads(cores()))
    frames, config = Repeated(finished, pairs), MappingConfig()
    summary = build_map(frames, finished.geometry, folder, config, trajectory, workspace)
    used, peak_kib = os.times(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    seconds, elapsed = used.user + used.system, time.perf_counter() - started
    return (
        f"| {pairs} | {summary.points:,} | {elapsed:.1f} | {seconds:.1f} | "
        f"{1000 * seconds / pairs:.0f} | {peak_kib / 1024:.0f} |"
    )


def main(numbers: Sequence[int], folder: Path) -> None:
    """Render the frames and print the table; the first map, of few pairs, compiles and is not
    listed.
    """
    reef = ReefFrames(SPEC)
    write_run(folder / "run", reef, reef.pair)
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    print(
        "| pairs | points | elapsed s | processor s | processor ms a pair | peak MiB "
        "|\n|---|---|---|---|---|---|"
    )
    for turn, pairs in enumerate([SPEC.pairs, *numbers]):
        number = np.arange(pairs)
        T = reef.trajectory.T_world_camera[number % SPEC.pairs].copy()
        T[:, 1, 3] += number // SPEC.pairs * SPACING_M
        trajectory = Trajectory(tuple(f"{i:06d}" for i in number), number * 1.0, T)
        with get_context("spawn").Pool(1) as process:
            row = process.apply(
                measured, (folder / "run", trajectory, folder / f"map_{pairs}_{turn}")
            )
        if turn:
            print(row, flush=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        main([int(number) for number in words_of(__doc__, "PAIRS")] or PAIRS, Path(temporary))
