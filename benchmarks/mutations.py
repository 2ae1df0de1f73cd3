"""Whether the tests notice a mistake: the product code is broken on purpose in places of all rooms,
one at a time, in a copy of the repository, and the tests of that room run.

    python benchmarks/mutations.py [--all] [--only WORD]

Prints a row for each break: the first test that failed, or SURVIVED. Exit code 1 where a break
survives, where its old text is not found once in its file, or where its tests fail without it: then
they tell nothing.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from arguments import parser_of

REPOSITORY = Path(__file__).resolve().parents[1]
LEFT_OUT = shutil.ignore_patterns(".git", ".venv", "node_modules", ".*_cache", "__pycache__", "out")
FAILED = re.compile(r"^(?:FAILED|ERROR) (\S+)", re.MULTILINE)


class Break(NamedTuple):
    """A deliberate mistake. tests: files that cover the room, relative to ``tests``."""

    what: str
    file: str
    old: str
    new: str
    tests: str


BREAKS = (
    Break(
        "matching: half of each sub-pixel step",
        "stereo_seecolor/matching/refine.py",
        "step = ge * weight / information",
        "step = np.float32(0.5) * ge * weight / information",
        "matching/test_matching.py",
    ),
    Break(
        "rectification: the cameras turned the wrong way round",
        "calibration/rectification.py",
        "return turn @ half, turn @ half.T",
        "return turn @ half.T, turn @ half",
        "calibration/test_calibration_rectification.py",
    ),
    Break(
        "range: depth along the axis given as range along the ray",
        "calibration/geometry.py",
        "return depth_m * self.ray_length",
        "return depth_m",
        "calibration/test_calibration_rectification.py geometry",
    ),
    Break(
        "water physics: the second term of backscatter subtracted",
        "stereo_seecolor/water/physics.py",
        "cged(beta * z) + eta * ged(alpha * z)",
        "cged(beta * z) - eta * ged(alpha * z)",
        "color/test_water_physics.py",
    ),
    Break(
        "light solver: outliers weigh as much as the others",
        "stereo_seecolor/color/photometry/light_solver.py",
        "part.seen / (1.0 + (own / (SETTINGS.outlier * scale)) ** 2)",
        "part.seen",
        "color/test_color_light.py",
    ),
    Break(
        "response: light without the pedestal not scaled back to full scale",
        "stereo_seecolor/color/response/response.py",
        "(light[:, None] - pedestal) / (1 - pedestal)",
        "(light[:, None] - pedestal)",
        "color/test_response.py",
    ),
    Break(
        "tone: exposure without a limit by highlights",
        "stereo_seecolor/color/render/tone.py",
        "exposure = min(wanted, unclipped * REACH)",
        "exposure = wanted",
        "color/test_color_tone.py",
    ),
    Break(
        "tables: the ranges of a frame that is taken out are added",
        "stereo_seecolor/color/table/moment_table.py",
        "a.offset_sum - b.offset_sum",
        "a.offset_sum + b.offset_sum",
        "color/test_color_engine_tables.py",
    ),
    Break(
        "pairing: the nearest in time need not be mutual",
        "stereo_seecolor/inputs/pairing.py",
        "and nearest(left_times, right_times[j]) == i",
        "",
        "inputs/test_inputs_pairing.py",
    ),
    Break(
        "trajectories: north and east exchanged",
        "stereo_seecolor/earth.py",
        "[[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]",
        "[[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]",
        "inputs/test_trajectories.py",
    ),
    Break(
        "calibration reading: Kalibr's poses to an IMU composed the wrong way round",
        "calibration/formats/kalibr.py",
        "return right @ inverse(left)",
        "return left @ inverse(right)",
        "calibration/test_calibration_formats.py calibration/test_calibration_notations.py",
    ),
    Break(
        "causes of wrong rows: rivals that make ranges wrong ignored",
        "calibration/verification/explanations.py",
        "return [one for one in self._all if one.is_wrong]",
        "return [one for one in (self.best,) if one and one.is_wrong]",
        "calibration/test_calibration_causes.py",
    ),
    Break(
        "fusion: voxels far behind the surface updated",
        "stereo_seecolor/mapping/surface/kernels.py",
        "if signed < -reach_m:",
        "if signed < -10 * reach_m:",
        "mapping/test_mapping_fusion.py",
    ),
    Break(
        "track: errors of one of two frames left out",
        "stereo_seecolor/mapping/track/relative_pose.py",
        "+= a.std**2",
        "+= 1e-12",
        "mapping/test_mapping_relative_pose.py",
    ),
    Break(
        "mosaic: hidden cells painted",
        "stereo_seecolor/mapping/raster/mosaic_kernels.py",
        "<= hidden_m + hidden_fraction * distance",
        "<= 100 * hidden_m + hidden_fraction * distance",
        "mapping/test_mapping_products.py",
    ),
    Break(
        "metrics: aspect points uphill",
        "stereo_seecolor/mapping/raster/reef_metrics.py",
        "np.arctan2(-east, -north)",
        "np.arctan2(east, north)",
        "mapping/test_mapping_products.py",
    ),
    Break(
        "measuring: an area takes the calibration's error once, not twice",
        "stereo_seecolor/extras/reef/lengths_and_areas.py",
        "self.power * calibration_std * self.value",
        "calibration_std * self.value",
        "extras/reef",
    ),
    Break(
        "run folder: another machine's lease taken over",
        "stereo_seecolor/run_folder/lease.py",
        "not (other.here and (locked or not other.alive))",
        "not (locked or not other.alive)",
        "extras/fleet/test_fleet_lease.py",
    ),
    Break(
        "run folder: a user's edit of the same size and time overwritten",
        "stereo_seecolor/run_folder/owned_files.py",
        "stamp.is_of(root / path)",
        "stamp.matches(root / path)",
        "run_folder/test_user_data.py attack/test_edited_in_place.py",
    ),
    Break(
        "resume: stages that depend on a new one kept as finished",
        "stereo_seecolor/run_folder/manifest.py",
        " if stage not in DEPENDS_ON[name]}",
        "}",
        "run_folder/test_resume.py",
    ),
    Break(
        "page: near ranges do not fit into 16 bits",
        "stereo_seecolor/report/range_code.py",
        "step = max(RANGE_CODE.step_per_m, allowed, 1 / (65535 * nearest_m))",
        "step = max(RANGE_CODE.step_per_m, allowed)",
        "report/test_page.py",
    ),
    Break(
        "command line: a run with failed pairs ends as one that is all done",
        "stereo_seecolor/cli/results.py",
        "return EXIT_DONE if summary.all_done else EXIT_SOME_FAILED",
        "return EXIT_DONE",
        "cli/test_cli.py commands/test_bad_inputs.py",
    ),
)


def missing(each: Break) -> str:
    """What is wrong with a break's old text; "" where it is found once."""
    found = (REPOSITORY / each.file).read_text(encoding="utf-8").count(each.old)
    return "" if found == 1 else f"{each.file}: {each.old!r} is found {found} times"


def outcome(copy: Path, each: Break, every: bool) -> str:
    """The first test that fails with the break, in a copy of the repository; "" where none does.

    Raises RuntimeError where pytest does not end as tests do.
    """
    file = copy / each.file
    whole = file.read_text(encoding="utf-8")
    tests = [] if every else [f"tests/{path}" for path in each.tests.split()]
    file.write_text(whole.replace(each.old, each.new), encoding="utf-8")
    try:
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-x", "-n", "0", "-rfE", "--tb=no", *tests],
            capture_output=True,
            text=True,
            cwd=copy,
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join((str(copy), str(copy / "tests" / "support"))),
                "NUMBA_CACHE_DIR": str(copy / ".numba_cache"),  # not in the place of a user's own
                "COLUMNS": "300",
            },
        )
    finally:
        file.write_text(whole, encoding="utf-8")
    if done.returncode not in (0, 1):
        end = done.stdout[-500:]
        raise RuntimeError(f"{each.what}: pytest ended with {done.returncode}: {end}")
    failed = FAILED.search(done.stdout)
    return failed[1] if failed else "" if done.returncode == 0 else "a test"


def main() -> int:
    """Print the table; returns the exit code."""
    parser = parser_of(__doc__)
    parser.add_argument("--all", action="store_true", help="run the whole suite for each break")
    parser.add_argument("--only", default="", help="breaks whose description holds this word")
    arguments = parser.parse_args()
    chosen = [each for each in BREAKS if arguments.only in each.what]
    if stale := [what for each in chosen if (what := missing(each))]:
        print(*stale, sep="\n", file=sys.stderr)
        return 1
    caught = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "repository"
        shutil.copytree(REPOSITORY, copy, ignore=LEFT_OUT)
        for each in chosen:
            if test := outcome(copy, each._replace(new=each.old), arguments.all):
                print(f"{each.what} | {test} FAILS WITHOUT IT", flush=True)
                continue
            test = outcome(copy, each, arguments.all)
            caught += bool(test)
            print(f"{each.what} | {test or 'SURVIVED'}", flush=True)
    print(f"{caught} of {len(chosen)} caught")
    return int(caught < len(chosen))


if __name__ == "__main__":
    sys.exit(main())
