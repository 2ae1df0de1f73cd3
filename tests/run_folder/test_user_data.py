"""Forty ways to lose a user's data, each tried: nothing is lost, and one clear line says why."""

import csv
import errno
import json
import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import AtPair, CopyRun, Dive, contents

from calibration.formats import load_rig, write_rig
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.run import correct, range_maps, rectify, run
from stereo_seecolor.config import RunConfig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.files import atomic
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.frame_table import RunSummary
from stereo_seecolor.run_folder.layout import PRODUCTS
from stereo_seecolor.run_folder.lease import held
from stereo_seecolor.run_folder.manifest import Manifest
from stereo_seecolor.run_folder.owned_files import OwnedFiles
from stereo_seecolor.run_folder.ownership import FolderRequest, Owner
from stereo_seecolor.run_folder.survey_frames import SurveyFrames

PRECIOUS = b"three years of field notes"
PRODUCT_FOLDERS = (
    "corrected",
    "range",
    "range_std",
    "confidence",
    "mask",
    "clouds",
    "rectified_left",
    "rectified_right",
    "map",
)
DIVE_FILES = (
    "run.json",
    "frames.csv",
    "water.json",
    "rig.yaml",
    "water_measured.json",
    "rectified.yaml",
)
BOTH = pytest.mark.parametrize("overwrite", [False, True])


@pytest.fixture
def dive(make_dive: Callable[..., Dive]) -> Dive:
    return make_dive(3)


def go(
    dive: Dive,
    out: Path,
    *settings: str,
    overwrite: bool = False,
    calib: Path | None = None,
    water: Path | None = None,
) -> RunSummary:
    options = RunOptions(overwrite=overwrite, water=water)
    return run(
        dive.root / "L",
        dive.root / "R",
        calib or dive.root / "cam.yaml",
        out,
        load_config(None, settings),
        options,
    )


def keep(path: Path) -> Path:
    """A file of the user's."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(PRECIOUS)
    return path


def statuses(out: Path) -> dict[str, str]:
    return {
        row["name"]: row["status"]
        for row in csv.DictReader((out / "frames.csv").read_text().splitlines())
    }


# A folder that never was the program's


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize(
    "name",
    [
        *(f"{folder}/notes.txt" for folder in PRODUCT_FOLDERS),
        *DIVE_FILES,
        "thesis.tex",
        ".state/mine",
    ],
)
def test_a_folder_of_the_users_own_is_refused(
    dive: Dive, tmp_path: Path, name: str, overwrite: bool
) -> None:
    mine = keep(tmp_path / "data" / name)
    with pytest.raises(OutputError, match="holds other files"):
        go(dive, tmp_path / "data", overwrite=overwrite)
    assert mine.read_bytes() == PRECIOUS
    assert [path for path in (tmp_path / "data").rglob("*") if path.is_file()] == [mine]


@BOTH
@pytest.mark.parametrize("name", ["corrected", "range", "map", ".state"])
def test_a_link_out_of_the_folder_is_not_followed(
    dive: Dive, tmp_path: Path, name: str, overwrite: bool
) -> None:
    mine = keep(tmp_path / "elsewhere/notes.txt")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).symlink_to(mine.parent)
    with pytest.raises(OutputError, match="is a link"):
        go(dive, tmp_path / "out", overwrite=overwrite)
    assert [path.name for path in mine.parent.iterdir()] == ["notes.txt"]


@pytest.mark.slow
def test_out_may_be_a_link_itself(dive: Dive, tmp_path: Path) -> None:
    (tmp_path / "big disk").mkdir()
    (tmp_path / "out").symlink_to(tmp_path / "big disk")
    assert go(dive, tmp_path / "out").all_done
    assert (tmp_path / "big disk/corrected/0000.png").exists()


# A folder of the program's, with files of the user's in it


@pytest.mark.slow
@pytest.mark.parametrize("name", ["annotations/0000.json", "corrected/0000.jpg"])
def test_files_that_are_in_nobodys_way_stay(
    copy_run: CopyRun, dive: Dive, tmp_path: Path, name: str
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    mine = keep(out / name)
    for settings, overwrite in (((), False), (("color.lock=survey",), False), ((), True)):
        assert go(dive, out, *settings, overwrite=overwrite).all_done
        assert mine.read_bytes() == PRECIOUS


@pytest.mark.slow
@BOTH
@pytest.mark.parametrize(
    "name", [*(f"{folder}/notes.txt" for folder in PRODUCT_FOLDERS), "water_measured.json"]
)
def test_files_in_a_products_place_are_refused(
    copy_run: CopyRun, dive: Dive, tmp_path: Path, name: str, overwrite: bool
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    before, mine = contents(out), keep(out / name)
    with pytest.raises(OutputError, match=r"was not written by this program.*nothing was changed"):
        go(dive, out, "color.lock=survey", overwrite=overwrite)
    assert mine.read_bytes() == PRECIOUS
    assert contents(out).items() >= before.items()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "overwrite"),
    [(("color.lock=survey",), False), ((), True), (("output.image_format=jpg",), False)],
)
def test_a_product_that_the_user_edited_is_kept_aside(
    copy_run: CopyRun, dive: Dive, tmp_path: Path, settings: tuple[str, ...], overwrite: bool
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    keep(out / "corrected/0001.png")
    summary = go(dive, out, *settings, overwrite=overwrite)
    assert (out / "set_aside/corrected/0001.png").read_bytes() == PRECIOUS
    assert any("0001.png: was changed after the program wrote it" in note for note in summary.notes)
    assert summary.all_done
    assert len(list((out / "corrected").iterdir())) == 3


@pytest.mark.slow
@BOTH
def test_a_product_replaced_by_a_link_is_not_written_through(
    copy_run: CopyRun, dive: Dive, tmp_path: Path, overwrite: bool
) -> None:
    out, mine = tmp_path / "out", keep(tmp_path / "elsewhere/photo.png")
    copy_run(out)
    (out / "corrected/0001.png").unlink()
    (out / "corrected/0001.png").symlink_to(mine)
    go(dive, out, "color.lock=survey", overwrite=overwrite)
    assert mine.read_bytes() == PRECIOUS
    assert not (out / "corrected/0001.png").is_symlink()


@pytest.mark.slow
def test_overwrite_deletes_what_the_manifest_names_and_nothing_else(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    mine = keep(out / "notes.txt")
    (dive.root / "L/0002.png").unlink()
    go(dive, out, "output.preset=no-clouds", overwrite=True)
    assert mine.read_bytes() == PRECIOUS
    assert not (out / "clouds").exists()
    assert sorted(path.name for path in (out / "corrected").iterdir()) == ["0000.png", "0001.png"]


# Inputs inside OUT


@pytest.mark.slow
@pytest.mark.parametrize("given", ["water.json", "run.json", "rig.yaml"])
def test_overwrite_never_deletes_its_own_inputs(
    copy_run: CopyRun, dive: Dive, tmp_path: Path, given: str
) -> None:
    out = tmp_path / "out"
    copy_run(out, 3, "color.lock=survey")
    before = contents(out)
    left, right, calib = (
        dive.root / "L",
        dive.root / "R",
        out / "rig.yaml" if given == "rig.yaml" else dive.root / "cam.yaml",
    )
    config_file, water = (
        out / name if given == name else None for name in ("run.json", "water.json")
    )
    options = RunOptions(overwrite=True, config_file=config_file, water=water)
    with pytest.raises(
        OutputError, match=rf"{given}: is an input of this run.*nothing was changed"
    ):
        run(left, right, calib, out, options=options)
    assert contents(out) == before


@pytest.mark.slow
@BOTH
def test_range_maps_are_not_overwritten_by_their_own_correction(
    copy_run: CopyRun, dive: Dive, tmp_path: Path, overwrite: bool
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    before = contents(out)
    with pytest.raises(OutputError):
        correct(dive.root / "L", out / "range", out, options=RunOptions(overwrite=overwrite))
    assert contents(out) == before


@pytest.mark.slow
def test_images_inside_out_are_not_deleted(dive: Dive, tmp_path: Path) -> None:
    out = tmp_path / "out"
    rectify(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", out)
    with pytest.raises(OutputError):
        run(
            out / "rectified_left",
            out / "rectified_right",
            out / "rectified.yaml",
            out,
            options=RunOptions(overwrite=True),
        )
    assert len(list((out / "rectified_left").iterdir())) == 3


@pytest.mark.slow
def test_a_run_may_take_the_water_of_its_own_folder(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    copy_run(out, 3, "color.lock=survey")
    water = (out / "water.json").read_bytes()
    assert go(dive, out, "color.lock=survey", water=out / "water.json").all_done
    assert (out / "water.json").read_bytes() == water


# Other dives, other commands, other programs


@pytest.mark.parametrize("command", [range_maps, rectify])
def test_two_programs_never_write_into_one_folder(
    dive: Dive, tmp_path: Path, command: Callable[..., RunSummary]
) -> None:
    out = tmp_path / "out"
    with held(out), pytest.raises(OutputError):
        command(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", out)


@pytest.mark.slow
def test_rectified_images_are_refused_where_a_run_lies(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    copy_run(tmp_path / "out")
    with pytest.raises(OutputError, match="another dive or command"):
        rectify(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", tmp_path / "out")


# Moved and copied


@pytest.mark.slow
def test_a_moved_dive_and_a_moved_out_go_on(dive: Dive, tmp_path: Path) -> None:
    go(dive, tmp_path / "out")
    dive.root.rename(tmp_path / "moved dive")
    (tmp_path / "out").rename(tmp_path / "moved out")
    summary = go(replace(dive, root=tmp_path / "moved dive"), tmp_path / "moved out")
    assert (summary.kept, summary.all_done) == (3, True)


@pytest.mark.slow
def test_a_copied_out_is_still_the_programs(dive: Dive, tmp_path: Path) -> None:
    first = go(dive, tmp_path / "out")
    shutil.copytree(tmp_path / "out", tmp_path / "copy", copy_function=shutil.copyfile)
    summary = go(dive, tmp_path / "copy")
    assert (summary.kept, summary.notes) == (3, first.notes)
    assert not (tmp_path / "copy/set_aside").exists()


@pytest.mark.slow
def test_a_finished_run_is_read_without_its_inputs(dive: Dive, tmp_path: Path) -> None:
    go(dive, tmp_path / "out")
    shutil.rmtree(dive.root)
    (tmp_path / "out").rename(tmp_path / "elsewhere")
    finished = open_run(tmp_path / "elsewhere")
    assert [frame.name for frame in finished.frames] == ["0000", "0001", "0002"]
    assert finished.rig.baseline_m == pytest.approx(0.1)
    assert finished.frames[0].read("corrected").shape == (128, 176, 3)


# Nothing stale


@pytest.mark.slow
def test_a_changed_format_leaves_nothing_of_the_old_one(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    go(dive, out, "output.image_format=jpg", "output.preset=no-clouds")
    assert {path.suffix for path in (out / "corrected").iterdir()} == {".jpg"}
    assert not list(out.glob("clouds/*"))
    products = {name for name in open_run(out).frames[0].products if not name.startswith("page/")}
    assert products == {"range", "range_std", "confidence", "corrected", "mask"}


def products_of(folder: Path, name: str) -> dict[str, bytes]:
    """Files of a frame in a run's folders of products: path -> content."""
    files = (file for product in PRODUCTS for file in folder.glob(f"{product}/{name}.*"))
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


@pytest.mark.slow
def test_old_products_of_a_pair_that_fails_now_are_kept_aside(dive: Dive, tmp_path: Path) -> None:
    """A disk that fails, or is not mounted, must not cost the results of a dive whose images cannot
    be read any more.
    """
    out = tmp_path / "out"
    go(dive, out)
    before = products_of(out, "0001")
    (dive.root / "R/0001.png").write_bytes(b"broken")
    summary = go(dive, out)
    assert [
        row.error.endswith("(results of an earlier run are in set_aside)") for row in summary.rows
    ] == [False, True, False]
    assert not list(out.glob("*/0001.*"))
    assert products_of(out / "set_aside", "0001") == before and len(before) == 6
    assert statuses(out) == {"0000": "ok", "0001": "failed", "0002": "ok"}
    again = go(dive, out)
    assert (
        not again.rows[1].error.endswith("set_aside)")
        and products_of(out / "set_aside", "0001") == before
    )


@pytest.mark.slow
def test_products_of_a_pair_that_was_removed_are_kept_aside(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    before = products_of(out, "0001")
    for side in "LR":
        (dive.root / side / "0001.png").unlink()
    summary = go(dive, out)
    assert summary.all_done
    assert (
        "1 frame of an earlier run, no longer in the dive: its results are kept in "
        f"{out / 'set_aside'}" in summary.notes
    )
    assert not list(out.glob("*/0001.*"))
    assert products_of(out / "set_aside", "0001") == before
    assert "no longer in the dive" not in " ".join(go(dive, out).notes)


@pytest.mark.slow
def test_a_dive_of_which_all_pairs_failed_is_told_no_other_cause(make_dive, tmp_path: Path) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    for path in (dive.root / "R").iterdir():
        path.write_bytes(b"no image")
    summary = run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", out)
    assert summary.count("failed") == 2
    assert not [note for note in summary.notes if "show the same spots" in note]
    with pytest.raises(InputError, match="all 2 pairs failed, for reasons that"):
        SurveyFrames(open_run(out))


@pytest.mark.slow
def test_ranges_by_another_calibration_leave_no_old_colors(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    rig = load_rig(dive.root / "cam.yaml")
    wider = rig.T_right_left.copy()
    wider[0, 3] *= 1.1
    write_rig(replace(rig, T_right_left=wider), dive.root / "other.yaml")
    range_maps(dive.root / "L", dive.root / "R", dive.root / "other.yaml", out)
    assert not list(out.glob("corrected/*")) + list(out.glob("mask/*"))
    with pytest.raises(InputError, match="contains no frame that finished all stages"):
        SurveyFrames(open_run(out))


@pytest.mark.slow
def test_ranges_by_the_same_settings_keep_the_colors(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    copy_run(out, 3, "color.lock=survey")
    before = contents(out)
    assert range_maps(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", out).kept == 3
    assert contents(out) == before
    assert open_run(out).config.color.lock == "survey"
    assert len(SurveyFrames(open_run(out))) == 3


# Stopped and starved


@pytest.mark.slow
@pytest.mark.parametrize("at", [1, 4])
def test_a_stopped_run_hides_nothing_and_is_not_fused(
    copy_run: CopyRun, dive: Dive, tmp_path: Path, at: int
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    options = RunOptions(workers=1, listener=AtPair(at, KeyboardInterrupt))
    config = load_config(None, ["color.robust.white_point=gray", "matching.min_confidence=0.5"])
    summary = run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", out, config, options)
    assert summary.stopped
    assert summary.count("pending") >= 1
    assert statuses(out).keys() == {"0000", "0001", "0002"}
    with pytest.raises(InputError, match=r"was stopped: |finish the run first"):
        SurveyFrames(open_run(out))
    assert go(dive, out).all_done
    assert len(SurveyFrames(open_run(out))) == 3


@pytest.mark.parametrize("settings", ["", "other"])
def test_what_is_not_finished_is_not_called_of_earlier_settings(
    copy_run: CopyRun, tmp_path: Path, settings: str
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    manifest = Manifest(out)
    record = manifest.frame("0001")
    assert record is not None
    stages = {"range": record.stages["range"]}
    if settings:
        stages["range"] = replace(stages["range"], settings=settings)
    manifest.save_frame(replace(record, stages=stages))
    said = "1 are of earlier settings" if settings else "1 are not finished"
    with pytest.raises(InputError, match=rf"2 frames are finished .*, {said} \(0001\): run"):
        SurveyFrames(open_run(out))


@pytest.mark.slow
def test_ok_means_all_stages(dive: Dive, tmp_path: Path) -> None:
    out = tmp_path / "out"
    # of three: ranges, light, waters, colors
    options = RunOptions(workers=1, listener=AtPair(11, KeyboardInterrupt))
    run(dive.root / "L", dive.root / "R", dive.root / "cam.yaml", out, options=options)
    corrected = {path.stem for path in (out / "corrected").iterdir()}
    assert {name for name, status in statuses(out).items() if status == "ok"} == corrected
    assert json.loads((out / "run.json").read_text())["totals"]["stopped"]


@pytest.mark.slow
@pytest.mark.parametrize("writes", range(2, 28, 5))
def test_a_full_disk_loses_nothing(
    copy_run: CopyRun, dive: Dive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, writes: int
) -> None:
    out, left, one_water = tmp_path / "out", writes, "color.lock=survey"
    copy_run(tmp_path / "whole", 3, one_water)
    genuine = atomic.write_temporary

    def full(path: Path, content: atomic.Content) -> Path:
        nonlocal left
        left -= 1
        if left < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return genuine(path, content)

    with monkeypatch.context() as patched:
        patched.setattr(atomic, "write_temporary", full)
        with pytest.raises(OutputError, match="No space left on device"):
            go(dive, out, one_water)
    mine = keep(out / "notes.txt") if (out / ".state/manifest.json").exists() else None
    assert go(dive, out, one_water).all_done
    assert contents(out) == contents(tmp_path / "whole")
    assert mine is None or mine.read_bytes() == PRECIOUS
    assert not list(out.rglob(".writing-*"))


@pytest.mark.slow
def test_every_product_is_on_the_disk_before_it_gets_its_name(
    dive: Dive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, flushed, named = tmp_path / "out", set(), []
    move = atomic.move_into_place

    def flush(descriptor: int) -> None:
        flushed.add(os.fstat(descriptor).st_ino)

    def move_into_place(temporary: Path, path: Path) -> None:
        number = temporary.stat().st_ino
        named.append((path, number in flushed))
        flushed.discard(number)
        move(temporary, path)

    monkeypatch.setattr(os, "fsync", flush)
    monkeypatch.setattr(atomic, "move_into_place", move_into_place)
    assert go(dive, out).all_done
    products = [
        (path, safe)
        for path, safe in named
        if ".state" not in path.parts or path.parent.name == "frames"
    ]
    assert {path.relative_to(out).parts[0] for path, _ in products} >= {
        "range",
        "corrected",
        "clouds",
        ".state",
        "run.json",
    }
    assert [path for path, safe in products if not safe] == []


@pytest.mark.slow
def test_a_file_that_cannot_be_flushed_is_named_and_not_left_behind(
    dive: Dive, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, flush = tmp_path / "out", atomic.flush_file

    def failing(temporary: Path) -> None:
        if temporary.parent.name == "confidence":
            raise OSError(errno.EIO, "Input/output error")
        flush(temporary)

    with monkeypatch.context() as patched:
        patched.setattr(atomic, "flush_file", failing)
        with pytest.raises(
            OutputError, match=r"confidence/.*: cannot be written: Input/output error"
        ):
            go(dive, out)
    assert not list(out.rglob(".writing-*"))
    assert go(dive, out).all_done


def test_a_folder_lost_while_files_are_written_is_named(tmp_path: Path) -> None:
    def contents_of_a_pair() -> Iterator[tuple[str, bytes]]:
        yield "range/0001.tiff", b"range"
        (tmp_path / "range").rename(tmp_path / "lost")
        (tmp_path / "range").touch()  # removing the first file fails now with an error of its own
        yield "range/0002.tiff", b"range"

    with pytest.raises(OutputError, match=r"range/000.\.tiff: cannot be written"):
        OwnedFiles(tmp_path).write_temporaries(contents_of_a_pair())


@pytest.mark.slow
def test_a_damaged_manifest_is_refused_untouched(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    before = contents(out)
    (out / ".state/manifest.json").write_text("{")
    for overwrite in (False, True):
        with pytest.raises(OutputError, match=r"manifest\.json: is damaged"):
            go(dive, out, overwrite=overwrite)
    assert contents(out) == before


@pytest.mark.slow
def test_a_folder_turned_into_a_file_is_left_alone(
    copy_run: CopyRun, dive: Dive, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    shutil.rmtree(out / "corrected")
    mine = keep(out / "corrected")
    with pytest.raises(OutputError, match="corrected"):
        go(dive, out, "color.lock=survey")
    assert mine.read_bytes() == PRECIOUS


# The map


@pytest.mark.slow
def test_a_users_file_in_the_map_is_refused(copy_run: CopyRun, tmp_path: Path) -> None:
    out = tmp_path / "out"
    copy_run(out)
    mine = keep(out / "map/report.docx")
    with pytest.raises(OutputError, match=r"report\.docx: was not written by this program"):
        fuse(out, config=RunConfig())
    assert mine.read_bytes() == PRECIOUS


def test_a_run_refused_before_it_wrote_leaves_nothing_that_it_made(tmp_path: Path) -> None:
    def refuse(out: Path, written: str = "") -> None:
        with pytest.raises(InputError), RunFolder(out, FolderRequest(Owner("stereo", {}))) as run:
            assert (out / ".state/manifest.json").is_file()
            if written:
                run.dive.write(written, b"{}")
            raise InputError("exchanged sides")

    refuse(tmp_path / "new/out")
    assert not (tmp_path / "new").exists()
    (tmp_path / "empty").mkdir()
    refuse(tmp_path / "empty")
    assert not any((tmp_path / "empty").iterdir())
    plan = tmp_path / "planned/.state/plan.kept"
    plan.parent.mkdir(parents=True)
    plan.write_bytes(b"of the user")
    refuse(tmp_path / "planned")
    assert list(plan.parent.iterdir()) == [plan]
    refuse(tmp_path / "written", "water.json")
    assert (tmp_path / "written/.state/manifest.json").is_file()
    refuse(tmp_path / "written")
    assert (tmp_path / "written/water.json").is_file()
