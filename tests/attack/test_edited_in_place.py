"""Results that a user edited in place, in the middle and at the same size: kept aside, never
deleted or overwritten.
"""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import CopyRun, Dive

from stereo_seecolor.commands.report import report
from stereo_seecolor.commands.run import run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.map_folder import building_map

PRODUCTS = ("range", "range_std", "confidence", "corrected", "mask", "clouds")
LARGE = bytes(range(256)) * 400


def edited(path: Path, *, same_time: bool) -> bytes:
    """Change a byte in the middle, as a program does that opens a file to update it."""
    status = path.stat()
    with path.open("r+b") as file:
        file.seek(status.st_size // 2)
        byte = file.read(1)[0]
        file.seek(status.st_size // 2)
        file.write(bytes([byte ^ 255]))
    os.utime(
        path,
        ns=(status.st_atime_ns, status.st_mtime_ns if same_time else status.st_mtime_ns + 10**9),
    )
    assert path.stat().st_size == status.st_size
    return path.read_bytes()


def go(dive: Dive, out: Path, *settings: str, overwrite: bool = False) -> object:
    config = load_config(None, settings)
    return run(
        dive.root / "L",
        dive.root / "R",
        dive.root / "cam.yaml",
        out,
        config,
        RunOptions(overwrite=overwrite),
    )


@pytest.mark.slow
@pytest.mark.parametrize("same_time", [True, False])
@pytest.mark.parametrize(
    ("settings", "overwrite"), [((), True), (("matching.min_confidence=0.7",), False)]
)
def test_a_product_edited_in_the_middle_is_kept_aside(
    copy_run: CopyRun,
    make_dive: Callable[..., Dive],
    tmp_path: Path,
    settings: tuple[str, ...],
    overwrite: bool,
    same_time: bool,
) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    copy_run(out, 2)
    paths = [next((out / product).iterdir()) for product in PRODUCTS] + [
        out / "frames.csv",
        out / "rig.yaml",
    ]
    mine = {path: edited(path, same_time=same_time) for path in paths}
    go(dive, out, *settings, overwrite=overwrite)
    for path, content in mine.items():
        aside = out / "set_aside" / path.relative_to(out)
        assert content in [place.read_bytes() for place in (path, aside) if place.exists()], path


@pytest.mark.slow
@pytest.mark.parametrize("same_time", [True, False])
def test_a_mesh_edited_in_the_middle_outlives_the_next_map(
    copy_run: CopyRun, tmp_path: Path, same_time: bool
) -> None:
    out = copy_run(tmp_path / "out", 2)
    for content in (LARGE, LARGE + b"next"):
        with RunFolder.existing(out, "fuse") as folder, building_map(folder, "key") as building:
            (building / "mesh.ply").write_bytes(content)
        if content == LARGE:
            mine = edited(out / "map/mesh.ply", same_time=same_time)
    assert (out / "set_aside/map/mesh.ply").read_bytes() == mine
    assert (out / "map/mesh.ply").read_bytes() == LARGE + b"next"


@pytest.mark.slow
def test_a_page_edited_in_the_middle_is_kept_aside(copy_run: CopyRun, tmp_path: Path) -> None:
    out = copy_run(tmp_path / "out", 2)
    mine = edited(out / "index.html", same_time=False)
    report(out)
    assert (out / "set_aside/index.html").read_bytes() == mine


@pytest.mark.slow
def test_an_unchanged_result_copied_with_a_new_time_is_replaced_and_not_kept_twice(
    copy_run: CopyRun, make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    copy_run(out, 2)
    for path in out.rglob("*"):
        os.utime(path, ns=(1, 1))
    go(dive, out, overwrite=True)
    assert not (out / "set_aside").exists()
