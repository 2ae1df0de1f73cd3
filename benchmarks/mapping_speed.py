"""How fast, and in how much memory, a long survey is fused: 1280x1024, voxels of 1 cm, frames read from disk as a run leaves them.

    python benchmarks/mapping_speed.py [pairs]

24 frames of a synthetic reef are laid end to end until there are as many as asked for, so that disk and memory see a long dive.
"""

import platform
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from mapping_scene import ReefFrames, write_run

from stereo_seecolor.config import MappingConfig
from stereo_seecolor.mapping.survey_map import build_map
from stereo_seecolor.records import SurveyFrame, Trajectory
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.survey_frames import SurveyFrames
from stereo_seecolor.synthetic.survey import SurveySpec

SPEC = SurveySpec(pairs=24, lines=2, image_size=(1280, 1024), altitude_m=(2.0, 2.0))
SPACING_M = 8.0


class Repeated(Sequence[SurveyFrame]):
    """The frames of a run folder over and over, each time under other names."""

    def __init__(self, frames: SurveyFrames, count: int) -> None:
        self._frames, self._count = frames, count
        self.reads = 0

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, i: int) -> SurveyFrame:  # type: ignore[override]
        self.reads += 1
        frame = self._frames[i % len(self._frames)]
        return SurveyFrame(f"{i:06d}", float(i), frame.color, frame.range_m, frame.range_std_m, frame.confidence)


def main(pairs: int, folder: Path) -> None:
    run = folder / "run"
    if not (run / "run.json").exists():
        reef = ReefFrames(SPEC)
        write_run(run, reef, reef.pair)
    base = ReefFrames(SPEC).trajectory
    number = np.arange(pairs)
    T = base.T_world_camera[number % SPEC.pairs].copy()
    T[:, 1, 3] += number // SPEC.pairs * SPACING_M
    trajectory = Trajectory(tuple(f"{i:06d}" for i in number), number * 1.0, T)
    finished = SurveyFrames(open_run(run))
    frames = Repeated(finished, pairs)
    marks: dict[str, tuple[float, float, int]] = {}

    def watch(what: str, done: int, total: int) -> None:
        marks[what] = time.perf_counter(), time.process_time(), frames.reads

    config = MappingConfig(max_speed_m_s=100.0)
    wall, cpu = time.perf_counter(), time.process_time()
    summary = build_map(frames, finished.geometry, folder / "map", config, trajectory, watch)
    print(
        f"{platform.machine()}, {platform.processor()}, Python {platform.python_version()}; {pairs} pairs, {summary.points} points"
    )
    print("| stage | wall s | CPU s | pairs/s (wall) | pairs/s if both cores were ours | frame reads |\n|---|---|---|---|---|---|")
    reads = 0
    marks["terrain, metrics, files"] = time.perf_counter(), time.process_time(), frames.reads
    for what, (at, used, read) in marks.items():
        spent_s, cpu_s = at - wall, used - cpu
        speeds = f"{pairs / spent_s:.1f} | {2 * pairs / cpu_s:.1f}"
        print(f"| {what} | {spent_s:.0f} | {cpu_s:.0f} | {speeds} | {read - reads} |")
        wall, cpu, reads = at, used, read
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GiB")


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    if len(sys.argv) > 2:
        main(count, Path(sys.argv[2]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(count, Path(temporary))
