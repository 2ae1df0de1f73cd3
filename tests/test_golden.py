"""Numbers of whole runs from the command line stay what they were: the sample dive, its map, and
real frames.

Where a change of method moves them on purpose, see what moved and store the new numbers, naming the
change in CHANGELOG.md:

    export PYTHONPATH=.:tests/support
    python tests/test_golden.py           # prints what differs
    python tests/test_golden.py --write   # and stores it in tests/golden/
"""

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest
from conftest import GIVEN_POSES, REAL_DATA, SampleRun, command
from golden_numbers import (
    OWN_TRACK,
    SAME_FILES,
    Numbers,
    Tolerances,
    color_run_numbers,
    differences,
    map_numbers,
    range_numbers,
    range_run_numbers,
    read_image,
    run_numbers,
    write_numbers,
)
from small_dives import write_half_of_the_real_dive

ROOT = Path(__file__).resolve().parents[1]
REEF = ROOT / "data_samples" / "reef"
GOLDEN = ROOT / "tests" / "golden"

SAMPLE_DIVE = (
    "--left",
    str(REEF / "left"),
    "--right",
    str(REEF / "right"),
    "--calib",
    str(REEF / "cam.yaml"),
)
REAL_FRAMES = (
    "--images",
    str(REAL_DATA / "flsea" / "rgb"),
    "--range",
    str(REAL_DATA / "flsea" / "range"),
)


def half_of_the_real_dive(folder: Path) -> tuple[str, ...]:
    """Its water and map differ little from those of the whole one: half the time."""
    write_half_of_the_real_dive(REAL_DATA, folder)
    words = ("--left", folder / "left", "--right", folder / "right", "--calib", folder / "cam.yaml")
    return tuple(map(str, words))


INPUTS: dict[str, Callable[[Path], tuple[str, ...]]] = {
    "sample_dive": lambda _: SAMPLE_DIVE,
    "flsea": lambda _: REAL_FRAMES,
    "acfr": half_of_the_real_dive,
}
"""By the file of the numbers: the options that name the inputs; they may be written into an empty
folder.
"""
RUNS: dict[str, dict[str, tuple[tuple[str, ...], Callable[[Path], Numbers]]]] = {
    "sample_dive": {
        "run": (("run",), run_numbers),
        "run, a water a frame": (("run", "--set", "color.lock=frame"), color_run_numbers),
        "range, filled": (("range", "--set", "matching.fill=true"), range_run_numbers),
    },
    "flsea": {
        "correct": (("correct",), color_run_numbers),
        "correct, one water": (("correct", "--set", "color.lock=survey"), color_run_numbers),
    },
    "acfr": {"run": (("run", "--refine"), run_numbers)},
}
"""By the file of the numbers, then by a name in it: the command without inputs and --out, and what
is kept of its folder.
"""
MAPS: dict[str, dict[str, tuple[tuple[str, ...], Tolerances]]] = {
    "sample_dive": {
        "map, own track": ((), OWN_TRACK),
        "map, given poses": (GIVEN_POSES, SAME_FILES),
    },
    "acfr": {"map, own track": ((), OWN_TRACK)},
}
"""Of the run that a file of numbers names "run": by that file, then by a name in it, what is typed
after ``fuse OUT``, and the tolerances.
"""


def golden(file: str) -> Numbers:
    return json.loads((GOLDEN / f"{file}.json").read_text())


def run(file: str, name: str, out: Path) -> Numbers:
    words, numbers = RUNS[file][name]
    inputs = INPUTS[file](out.parent / "inputs")
    code, said = command(*words, *inputs, "--out", str(out))
    assert code == 0, said
    return numbers(out)


def fuse(file: str, name: str, out: Path) -> Numbers:
    """Of a finished run in out."""
    code, said = command("fuse", str(out), *MAPS[file][name][0])
    assert code == 0, said
    return map_numbers(out)


@pytest.fixture
def dive(sample_run: SampleRun) -> Path:
    """The output folder of the first run over the sample dive, with its map."""
    return sample_run.out


@pytest.mark.slow
def test_the_sample_dive(dive: Path) -> None:
    assert not differences(golden("sample_dive")["run"], run_numbers(dive))


@pytest.mark.slow
def test_the_sample_dive_with_a_water_a_frame(waters_a_frame: Path) -> None:
    assert not differences(
        golden("sample_dive")["run, a water a frame"], color_run_numbers(waters_a_frame)
    )


@pytest.mark.slow
def test_the_filled_ranges_of_the_sample_dive(tmp_path: Path) -> None:
    assert not differences(
        golden("sample_dive")["range, filled"],
        run("sample_dive", "range, filled", tmp_path / "out"),
    )


@pytest.mark.slow
def test_the_map_of_the_sample_dive_by_its_own_track(dive: Path) -> None:
    assert not differences(golden("sample_dive")["map, own track"], map_numbers(dive), OWN_TRACK)


@pytest.mark.slow
def test_the_map_of_the_sample_dive_by_given_poses(mapped_by_poses: Path) -> None:
    measured = map_numbers(mapped_by_poses)
    assert not differences(golden("sample_dive")["map, given poses"], measured, SAME_FILES)


@pytest.mark.slow
@pytest.mark.real_data
@pytest.mark.parametrize("name", RUNS["flsea"])
def test_real_frames(name: str, real_data: Path, tmp_path: Path) -> None:
    assert not differences(golden("flsea")[name], run("flsea", name, tmp_path / "out"))


@pytest.mark.slow
@pytest.mark.real_data
def test_a_real_dive_and_its_map(real_dive: SampleRun, tmp_path: Path) -> None:
    assert not differences(golden("acfr")["run"], run_numbers(real_dive.out))
    mapped = fuse("acfr", "map, own track", real_dive.copy(tmp_path / "out"))
    assert not differences(golden("acfr")["map, own track"], mapped, OWN_TRACK)


@pytest.mark.slow
@pytest.mark.parametrize(("product", "shift"), [("range/{}.tiff", 1e-4), ("corrected/{}.png", 2)])
def test_a_shift_of_one_frame_is_noticed(
    product: str, shift: float, dive: Path, tmp_path: Path
) -> None:
    expected = golden("sample_dive")["run"]
    name = list(expected["frames"])[5]
    moved = tmp_path / "out"
    shutil.copytree(
        dive, moved, copy_function=os.symlink, ignore=shutil.ignore_patterns(".*", "map")
    )
    path = moved / product.format(name)
    image = read_image(path)
    path.unlink()
    cv2.imwrite(str(path), cv2.add(image, (shift,) * 4))
    assert {line.split("/")[2] for line in differences(expected, run_numbers(moved))} == {name}


@pytest.mark.slow
def test_a_shift_of_one_block_is_noticed(dive: Path, tmp_path: Path) -> None:
    name = next(iter(golden("sample_dive")["run"]["frames"]))
    shutil.copytree(
        dive, tmp_path / "out", copy_function=os.symlink, ignore=shutil.ignore_patterns(".*", "map")
    )
    path = tmp_path / "out/range" / f"{name}.tiff"
    range_m = read_image(path)
    range_m[:149, :144] += 1e-4
    path.unlink()
    cv2.imwrite(str(path), range_m)
    assert differences(range_numbers(dive, name), range_numbers(tmp_path / "out", name))


def changes(file: str, measured: Numbers) -> list[str]:
    """A line for each number that is not as stored in the file."""
    if not (GOLDEN / f"{file}.json").exists():
        return ["new"]
    stored = golden(file)
    tolerances = {name: MAPS.get(file, {}).get(name, ((), SAME_FILES))[1] for name in measured}
    return [
        f"{name}: {line}"
        for name in measured
        for line in differences(stored.get(name, {}), measured[name], tolerances[name])
    ]


def renew(write: bool) -> None:
    """Print how the numbers of every run differ from those stored, beyond the tolerances; with
    write, store them all.
    """
    with tempfile.TemporaryDirectory() as folder:
        for file, runs in RUNS.items():
            if file != "sample_dive" and not REAL_DATA.is_dir():
                print(
                    f"{file}: STEREO_SEECOLOR_DATA names no folder of real frames "
                    "(tests/DATA.md): left as it is"
                )
                continue
            measured = {name: run(file, name, Path(folder) / file / name) for name in runs}
            measured |= {
                name: fuse(file, name, Path(folder) / file / "run") for name in MAPS.get(file, {})
            }
            print(f"{file}:", *(changes(file, measured) or ["nothing differs"]), sep="\n  ")
            if write:
                write_numbers(GOLDEN / f"{file}.json", measured)


if __name__ == "__main__":
    renew(write="--write" in sys.argv[1:])
