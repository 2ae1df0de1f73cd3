"""How fast a whole dive goes through, everything written, and in how much memory: `run` against the
plain sequential loop.

    python benchmarks/throughput.py --pairs 200 --size 1280 1024

Six pairs are rendered and used over and over under other names. Each measurement is a process of
its own, so that its peak memory is its own; the two ways take turns. Prints pairs a second, peak
resident memory, and seconds a stage.
"""

import argparse
import json
import os
import platform
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from stereo_seecolor.extras.synthetic.dive import synthesize
from stereo_seecolor.extras.synthetic.survey import SurveySpec

RENDERED = 6


def make_dive(root: Path, pairs: int, size: tuple[int, int]) -> None:
    """A dive of hard links to a few rendered pairs."""
    synthesize(SurveySpec(pairs=RENDERED, lines=1, image_size=size), root / "rendered")
    for side in ("left", "right"):
        (root / side).mkdir(parents=True)
        files = sorted((root / "rendered" / side).iterdir())
        for i in range(pairs):
            (root / side / f"{i:06d}.png").hardlink_to(files[i % RENDERED])


def plain_loop(dive: Path, out: Path) -> None:
    """What one would write in an afternoon: one pair after the other through the same stages, and
    everything written.
    """
    from calibration.formats import load_rig
    from stereo_seecolor.config.file import load_config
    from stereo_seecolor.files.atomic import write_atomic
    from stereo_seecolor.inputs.images import read_image
    from stereo_seecolor.pipeline import Pipeline
    from stereo_seecolor.records import StereoFrame
    from stereo_seecolor.run_folder.pair_files import correction_files, range_files

    pipeline = Pipeline(
        load_rig(dive / "rendered/cam.yaml"), load_config(None, ["color.lock=frame"])
    )
    output, geometry = pipeline.config.output, pipeline.rectification.pair
    for left in sorted((dive / "left").iterdir()):
        frame = StereoFrame(left.stem, read_image(left), read_image(dive / "right" / left.name))
        result = pipeline.process(frame)
        files = range_files(left.stem, result.range_map, output)
        files |= correction_files(
            left.stem, result.correction, result.range_map, geometry, output, b""
        )
        for path, content in files.values():
            write_atomic(out / path, content)


def whole_run(dive: Path, out: Path, workers: int) -> None:
    from stereo_seecolor.commands.run import run
    from stereo_seecolor.compute.process import tune_malloc
    from stereo_seecolor.config.file import load_config
    from stereo_seecolor.dive.run_options import RunOptions

    tune_malloc()  # as the command does
    config = load_config(None, ["color.lock=survey"])
    summary = run(
        dive / "left",
        dive / "right",
        dive / "rendered/cam.yaml",
        out,
        config,
        RunOptions(workers=workers),
    )
    print(json.dumps(summary.stage_seconds()), file=sys.stderr)


def measure(way: str, dive: Path, workers: int) -> tuple[float, float, float, str]:
    """(seconds, peak MiB, processor seconds, stage seconds as JSON) of one way, in a process of its
    own.
    """
    out = dive / "out"
    shutil.rmtree(out, ignore_errors=True)
    words = [sys.executable, __file__, "--one", way, "--dive", str(dive), "--workers", str(workers)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    seconds, peak, processor = (float(word) for word in done.stdout.split())
    return seconds, peak, processor, done.stderr.strip()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--pairs", type=int, default=60)
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 1024))
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--one", choices=("run", "plain"))
    parser.add_argument("--dive", type=Path)
    options = parser.parse_args()
    if options.one:
        start = time.perf_counter()
        if options.one == "run":
            whole_run(options.dive, options.dive / "out", options.workers)
        else:
            plain_loop(options.dive, options.dive / "out")
        # ru_maxrss would count the parent's
        high_water = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
        assert high_water
        print(time.perf_counter() - start, int(high_water[1]) / 1024, time.process_time())
        return
    with tempfile.TemporaryDirectory() as folder:
        dive = Path(folder)
        make_dive(dive / "small", 1, (320, 256))
        for way in ("run", "plain"):
            # compiles what is compiled once on a machine
            measure(way, dive / "small", options.workers)
        make_dive(dive, options.pairs, tuple(options.size))
        runs = [
            (measure("run", dive, options.workers), measure("plain", dive, 1))
            for _ in range(options.rounds)
        ]
    print(
        f"{platform.machine()}, {os.cpu_count()} cores; {options.pairs} pairs of "
        f"{options.size[0]}x{options.size[1]}"
    )
    for name, results in (
        ("run, survey water", [a for a, _ in runs]),
        ("plain loop, frame water", [b for _, b in runs]),
    ):
        seconds = statistics.median(r[0] for r in results)
        processor = statistics.median(r[2] for r in results) / options.pairs
        peak = max(r[1] for r in results)
        rate, stages = options.pairs / seconds, results[0][3]
        print(
            f"{name:24s} {rate:6.2f} pairs/s   {processor:.3f} processor s a pair   peak "
            f"{peak:5.0f} MiB   {stages}"
        )
    ratio = statistics.median(b[0] / a[0] for a, b in runs)
    print(
        f"run is {ratio:.2f} times as fast; 2,000 pairs would take "
        f"{2000 / options.pairs * runs[0][0][0] / 60:.1f} minutes"
    )


if __name__ == "__main__":
    main()
