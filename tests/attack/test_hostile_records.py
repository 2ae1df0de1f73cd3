"""An OUT that comes by mail or from a share: no command touches or reads a file outside of it that
its records name.
"""

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from conftest import CopyRun, Dive, command

from stereo_seecolor.commands.view import view
from stereo_seecolor.errors import InputError, OutputError
from stereo_seecolor.extras.evaluation.truth import ResultFiles, evaluate_truth, true_frames
from stereo_seecolor.files.decode import read_array
from stereo_seecolor.files.encode import encode_map
from stereo_seecolor.files.png import encode_png
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.manifest import DiveRecord, FrameRecord, Manifest, StageRecord

MINE = b"mine"
STAMP = {
    "size": len(MINE),
    "mtime_ns": 0,
    "digest": hashlib.blake2b(MINE + MINE, digest_size=8).hexdigest(),
}
UP = ("../home/notes.txt", "range/../../home/notes.txt", "/home/notes.txt", "..")
OUTSIDE = (*UP, "", ".", "range//a.tiff", "./range/a.tiff", "a\0b")
Change = Callable[[dict[str, Any], str], None]


def _file(content: dict[str, Any], path: str) -> None:
    content["files"][path] = [STAMP]


def _output(content: dict[str, Any], path: str) -> None:
    content["stages"]["range"]["outputs"]["range"] = path


def _subfolder(content: dict[str, Any], path: str) -> None:
    content["subfolder"] = path or "x"


def _name(content: dict[str, Any], path: str) -> None:
    content["name"] = path


IN_FRAME = (_file, _output, _subfolder, _name)


def changed(record: Path, change: Change, path: str) -> None:
    content = json.loads(record.read_bytes())
    change(content, path)
    record.write_text(json.dumps(content))


@pytest.mark.parametrize("path", OUTSIDE)
@pytest.mark.parametrize("change", IN_FRAME)
def test_a_frames_record_that_names_what_is_outside_is_refused(
    tmp_path: Path, change: Change, path: str
) -> None:
    manifest = Manifest(tmp_path)
    manifest.save_frame(
        FrameRecord("a", stages={"range": StageRecord("key", outputs={"range": "range/a.tiff"})})
    )
    assert manifest.frame("a")
    changed(tmp_path / ".state/frames/a.json", change, path)
    with pytest.raises(
        OutputError,
        match=r"a\.json: does not have the form that this program writes: .*nothing outside",
    ) as raised:
        list(manifest.frames())
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("path", OUTSIDE)
def test_a_dives_record_that_names_what_is_outside_is_refused(tmp_path: Path, path: str) -> None:
    manifest = Manifest(tmp_path)
    manifest.save_dive(DiveRecord())
    changed(tmp_path / ".state/manifest.json", _file, path)
    with pytest.raises(
        OutputError, match=r"manifest\.json: does not have the form that this program writes"
    ):
        manifest.dive()


def test_a_frames_record_names_no_records_of_its_own(tmp_path: Path) -> None:
    """A part could bring a manifest of its own into the whole."""
    manifest = Manifest(tmp_path)
    manifest.save_frame(FrameRecord("a"))
    changed(tmp_path / ".state/frames/a.json", _file, ".state/manifest.json")
    with pytest.raises(OutputError, match="is not in a folder of products"):
        manifest.frame("a")


@pytest.mark.parametrize("wrong", ["1", [], {"a": 1}, True, None, [[]], 10**400, {"size": "x"}])
@pytest.mark.parametrize("key", ["name", "timestamp_s", "inputs", "stages", "files", "subfolder"])
def test_a_record_of_other_types_is_damaged_and_nothing_worse(
    tmp_path: Path, key: str, wrong: object
) -> None:
    manifest = Manifest(tmp_path)
    manifest.save_frame(FrameRecord("a"))
    record = tmp_path / ".state/frames/a.json"
    record.write_text(json.dumps(json.loads(record.read_bytes()) | {key: wrong}))
    try:
        found = manifest.frame("a")
    except OutputError as error:
        assert "does not have the form that this program writes" in str(error)
    else:
        assert found is None or getattr(found, key) in (wrong, 1, {}, "")


@pytest.fixture
def hostile(copy_run: CopyRun, make_dive: Callable[..., Dive], tmp_path: Path) -> tuple[Path, Path]:
    """A finished run, and a file of the user's beside it."""
    make_dive(2)
    copy_run(tmp_path / "out", 2)
    (tmp_path / "home").mkdir()
    (tmp_path / "home/notes.txt").write_bytes(MINE)
    return tmp_path / "out", tmp_path / "home/notes.txt"


@pytest.mark.slow
@pytest.mark.parametrize("record", ["frames/0000.json", "manifest.json"])
def test_no_command_touches_a_file_that_a_record_names_outside(
    hostile: tuple[Path, Path], tmp_path: Path, record: str
) -> None:
    out, _ = hostile
    changed(out / ".state" / record, _file, "../home/notes.txt")
    dive = tmp_path / "dive"
    sides = [
        "--left",
        dive / "L",
        "--right",
        dive / "R",
        "--calib",
        dive / "cam.yaml",
        "--out",
        out,
    ]
    before = {
        path: path.read_bytes()
        for path in tmp_path.rglob("*")
        if path.is_file() and ".state" not in path.parts
    }
    for words in (
        ["run", *sides],
        ["run", *sides, "--overwrite"],
        ["run", *sides, "--set", "color.lock=survey"],
        ["fuse", out],
        ["report", out],
        ["metrics", out],
        ["export", out, "--to", "nerfstudio", "--out", tmp_path / "to"],
        ["merge", out, "--out", tmp_path / "whole/deep"],
        ["compare", out, out, "--out", tmp_path / "changes"],
    ):
        code, said = command(*words)
        assert (code, said.count("\n"), "Traceback" in said) == (1, 1, False), (words, said)
        assert "does not have the form that this program writes" in said, (words, said)
    assert {path: path.read_bytes() for path in before} == before
    assert not (tmp_path / "whole/home").exists()


@pytest.mark.slow
@pytest.mark.posix
def test_links_that_lead_out_are_neither_read_nor_written_through(
    hostile: tuple[Path, Path], tmp_path: Path
) -> None:
    out, mine = hostile
    for name in ("corrected/0000.png", ".state/light.kept", "rig.yaml", "range/new"):
        copy = tmp_path / "copy"
        shutil.copytree(out, copy)
        (copy / name).unlink(missing_ok=True)
        (copy / name).symlink_to(mine if name != "range/new" else mine.parent)
        with pytest.raises(OutputError, match="is a link that leads out"):
            open_run(copy)
        shutil.rmtree(copy)
    (out / ".state/lock").unlink(missing_ok=True)
    (out / ".state/lock").symlink_to(mine)
    code, said = command("fuse", out)
    assert code == 1 and "is a link" in said
    assert mine.read_bytes() == MINE


@pytest.mark.posix
@pytest.mark.parametrize("name", ["index.html", "mesh.ply", "page", "map/mesh.ply"])
def test_view_opens_nothing_outside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", lambda url: not opened.append(url))
    monkeypatch.setattr("stereo_seecolor.commands.view._has_screen", lambda: True)
    monkeypatch.setattr("stereo_seecolor.commands.view._rerun_program", lambda: "true")
    monkeypatch.setattr("subprocess.run", lambda words, **_: opened.append(words[1]))
    (tmp_path / "notes.txt").write_bytes(MINE)
    out = tmp_path / "out"
    (out / name).parent.mkdir(parents=True)
    (out / name).symlink_to(tmp_path if name == "page" else tmp_path / "notes.txt")
    with pytest.raises((OutputError, InputError)):
        view(out)
    assert not opened


@pytest.mark.slow
def test_links_within_the_folder_are_read(finished_demo: Any, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(finished_demo.out, out)
    product = next((out / "corrected").glob("*.png"))
    product.rename(out / "kept.png")
    product.symlink_to(out / "kept.png")
    assert open_run(out).frames


@pytest.mark.slow
def test_a_page_shows_no_image_that_the_run_did_not_read(
    hostile: tuple[Path, Path], tmp_path: Path
) -> None:
    out, _ = hostile
    secret = tmp_path / "home/secret.png"
    shutil.copy(next((out / "corrected").glob("*.png")), secret)

    def left(content: dict[str, Any], path: str) -> None:
        content["inputs"]["left"]["path"] = path

    changed(out / ".state/frames/0000.json", left, str(secret))
    (out / "page/before/0000.jpg").unlink(missing_ok=True)
    code, said = command("report", out)
    assert code in (0, 3), said
    assert not (out / "page/before/0000.jpg").exists()


def test_a_campaigns_states_name_no_folder_outside(tmp_path: Path) -> None:
    (tmp_path / "campaign.json").write_text(
        json.dumps({"../home": {"name": "../home", "state": "done"}})
    )
    code, said = command("status", tmp_path)
    assert (code, "which is not in" in said) == (1, True), said


@pytest.mark.parametrize("file", ["range", "corrected", "mask"])
def test_evaluate_names_a_result_of_another_size(
    finished_demo: Any, tmp_path: Path, file: str
) -> None:
    """Where two sizes meet, arrays of one of them would be stretched, or end the program."""
    dive = finished_demo.out.parent / "dive"
    name = true_frames(dive / "truth")[0]
    paths = {what: finished_demo.out / what / f"{name}.png" for what in ("corrected", "mask")}
    paths["range"] = finished_demo.out / "range" / f"{name}.tiff"
    small = read_array(paths[file])[:9, :7]
    paths[file] = tmp_path / paths[file].name
    paths[file].write_bytes(encode_map(small, None) if file == "range" else encode_png(small))
    result = ResultFiles(paths["range"], paths["corrected"], paths["mask"])
    with pytest.raises(InputError, match=f"{tmp_path}.*is 7x9 pixels, but its truth"):
        evaluate_truth({name: result}, dive / "truth")
