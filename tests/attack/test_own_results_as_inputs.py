"""Results of OUT given as inputs: what a command would delete or replace is refused as its input,
before anything is touched.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import CopyRun, Dive, contents

from stereo_seecolor.cli.app import every_command
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.run import correct, range_maps, rectify, run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import OutputError
from stereo_seecolor.extras.fleet.merge import merge
from stereo_seecolor.run_folder.layout import RIG, WATER
from stereo_seecolor.run_folder.manifest import Manifest
from stereo_seecolor.run_folder.replaced_results import REPLACES, refuse_inputs

BOTH = pytest.mark.parametrize("overwrite", [False, True])
REFUSED = r"is an input of this run.*nothing was changed"


@pytest.fixture
def dive(make_dive: Callable[..., Dive]) -> Dive:
    return make_dive(3)


def go(
    dive: Dive, out: Path, *settings: str, calib: Path | None = None, **options: object
) -> object:
    chosen = replace(RunOptions(), **options)
    return run(
        dive.root / "L",
        dive.root / "R",
        calib or dive.root / "cam.yaml",
        out,
        load_config(None, settings),
        chosen,
    )


def finished(copy_run: CopyRun, out: Path) -> Path:
    """A finished run with a track in its map, as far as its manifest knows."""
    copy_run(out, 3, "color.lock=survey")
    (out / "map").mkdir()
    (out / "map/trajectory.tum").write_text("0 0 0 0 0 0 0 1\n")
    manifest = Manifest(out)
    record = manifest.dive()
    manifest.save_dive(replace(record, files={**record.files, "map/trajectory.tum": ()}))
    return out


def test_what_every_command_may_replace_is_known() -> None:
    assert set(REPLACES) == set(every_command())


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize("given", ["poses", "config", "exposures", "control points", "scale bars"])
def test_no_input_of_a_run_may_lie_in_its_results(
    copy_run: CopyRun, dive: Dive, tmp_path: Path, given: str, overwrite: bool
) -> None:
    out = finished(copy_run, tmp_path / "out")
    before, table = contents(out), out / "frames.csv"
    table.write_text("name,exposure_s\n0000.png,0.01\n0001.png,0.01\n0002.png,0.01\n")
    setting = {
        "exposures": "input.exposures",
        "control points": "mapping.markers.points",
        "scale bars": "mapping.markers.bars",
    }.get(given)
    settings = [f"{setting}={table}"] if setting else []
    options = {
        "poses": {"also_read": (out / "map/trajectory.tum",)},
        "config": {"config_file": out / "frames.csv"},
    }.get(given, {})
    with pytest.raises(OutputError, match=REFUSED):
        go(dive, out, "color.lock=survey", *settings, overwrite=overwrite, **options)
    assert contents(out) == before


@pytest.mark.slow
@pytest.mark.parametrize("command", [run, range_maps, rectify])
def test_a_link_in_a_folder_of_images_does_not_hide_where_they_lie(
    dive: Dive, tmp_path: Path, command: Callable[..., object]
) -> None:
    out = tmp_path / "out"
    rectify(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", out)
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for image in (out / f"rectified_{side}").iterdir():
            (tmp_path / side / image.name).symlink_to(image)
    before = {path: path.read_bytes() for path in out.glob("rectified*/*")}
    with pytest.raises(OutputError, match=REFUSED):
        command(
            tmp_path / "left",
            tmp_path / "right",
            out / "rectified.yaml",
            out,
            options=RunOptions(overwrite=True),
        )
    assert {path: path.read_bytes() for path in out.glob("rectified*/*")} == before


@pytest.mark.slow
def test_a_folder_of_images_above_its_results_is_no_input_among_them(dive: Dive) -> None:
    """Images beside OUT, and OUT in the folder of the images."""
    for overwrite in (False, True):
        out = dive.root / "L/out"
        assert run(
            dive.root / "L",
            dive.root / "R",
            dive.root / "cam.yaml",
            out,
            options=RunOptions(overwrite=overwrite),
        ).all_done


@pytest.mark.slow
def test_a_calibration_found_in_out_itself_is_not_deleted(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    before, rig = contents(out), (out / RIG).read_bytes()
    with pytest.raises(OutputError, match=REFUSED):
        go(dive, out, calib=out, overwrite=True)
    assert (contents(out), (out / RIG).read_bytes()) == (before, rig)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "name"),
    [((), RIG), (("color.lock=survey",), WATER), (("color.lock=survey",), "run.json")],
)
def test_a_run_may_read_what_it_leaves_as_it_is(
    copy_run: CopyRun, dive: Dive, tmp_path: Path, settings: tuple[str, ...], name: str
) -> None:
    out = tmp_path / "out"
    copy_run(out, 3, *settings)
    content = (out / name).read_bytes()
    options = {WATER: {"water": out / name}, "run.json": {"config_file": out / name}}.get(name, {})
    assert go(dive, out, *settings, calib=out / RIG if name == RIG else None, **options).all_done
    assert name == "run.json" or (out / name).read_bytes() == content


@pytest.mark.slow
def test_a_rig_that_refinement_replaces_is_refused(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    before = contents(out)
    with pytest.raises(OutputError, match=REFUSED):
        go(dive, out, "input.refine=true", calib=out / RIG)
    assert contents(out) == before


def measured_water(out: Path) -> Path:
    """What ``water`` writes: here a copy of the fitted one, in its place and in the manifest."""
    from stereo_seecolor.run_folder.folder import RunFolder

    with RunFolder.existing(out, "water") as folder:
        content = (out / WATER).read_bytes()
        folder.dive.write("water_measured.json", content, made_from=folder.dive.digest("range"))
    return out / "water_measured.json"


@pytest.mark.slow
def test_a_measured_water_is_used_where_it_lies_and_never_removed_by_the_run_that_reads_it(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    copy_run(out, 3, "color.lock=survey")
    water = measured_water(out)
    content = water.read_bytes()
    assert go(dive, out, "color.lock=survey", water=water).all_done
    assert water.read_bytes() == content
    before = contents(out)
    with pytest.raises(OutputError, match=REFUSED):
        go(dive, out, "color.lock=survey", "matching.min_confidence=0.7", water=water)
    assert contents(out) == before
    for side in "LR":
        (dive.root / side / "0002.png").unlink()  # ranges of another set of frames
    go(dive, out, "color.lock=survey", water=water)
    assert water.read_bytes() == content
    go(dive, out, "color.lock=survey")
    assert not water.exists()


@pytest.mark.slow
def test_a_fusion_refuses_the_track_of_the_map_that_it_replaces(
    copy_run: CopyRun, tmp_path: Path
) -> None:
    out = finished(copy_run, tmp_path / "out")
    before = contents(out)
    with pytest.raises(OutputError, match=REFUSED):
        fuse(out, out / "map/trajectory.tum")
    assert contents(out) == before


@pytest.mark.slow
@BOTH
def test_a_part_is_not_merged_into_itself(
    copy_run: CopyRun, tmp_path: Path, overwrite: bool
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    before = contents(out)
    with pytest.raises(OutputError, match=REFUSED):
        merge([out], out, RunOptions(overwrite=overwrite))
    assert contents(out) == before


@pytest.mark.slow
def test_range_maps_of_out_are_refused_as_inputs_of_their_correction(
    copy_run: CopyRun, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    correct(out / "corrected", out / "range", tmp_path / "other")
    with pytest.raises(OutputError, match=REFUSED):
        correct(
            tmp_path / "other/corrected",
            tmp_path / "other/../out/range",
            out,
            options=RunOptions(overwrite=True),
        )


@pytest.mark.parametrize(
    ("command", "name", "refused"),
    [
        ("water", "map/trajectory.tum", False),
        ("water", "water_measured.json", True),
        ("fuse", "map/trajectory.tum", True),
        ("fuse", "poses.tum", False),
        ("fuse", "set_aside/map/trajectory.tum", False),
        ("fuse", "map", True),
        ("fuse", "maps/trajectory.tum", False),
        ("report", "index.html", True),
        ("report", "run.json", False),
        ("plan", ".state/plan.kept", True),
        ("export", "map/trajectory.tum", False),
        ("run", "map/../map/trajectory.tum", True),
        ("run", "map/../poses.tum", False),
        ("run", "annotations/poses.tum", False),
    ],
)
def test_only_what_a_command_replaces_is_refused(
    tmp_path: Path, command: str, name: str, refused: bool
) -> None:
    (tmp_path / "map").mkdir()
    if refused:
        with pytest.raises(OutputError, match=REFUSED):
            refuse_inputs(command, tmp_path, [tmp_path / name])
    else:
        refuse_inputs(command, tmp_path, [tmp_path / name])


def test_a_command_of_another_package_keeps_off_all_results(tmp_path: Path) -> None:
    """It is in no table of this program, and may replace what any command may."""
    (tmp_path / "out/range").mkdir(parents=True)
    file = tmp_path / "out/range/0001.tiff"
    file.write_bytes(b"")
    with pytest.raises(OutputError, match="is an input of this run"):
        refuse_inputs("note", tmp_path / "out", [file])
    refuse_inputs("note", tmp_path / "out", [tmp_path / "left"])
