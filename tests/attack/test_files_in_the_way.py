"""Files of a user's that lie where a command writes its log, its plan or a target; and text of
files on a terminal.
"""

import errno
import json
import os
import stat
from pathlib import Path

import pytest

from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.free_places import new_folder
from stereo_seecolor.run_folder.layout import FRAMES_TABLE

POSES = "# time x y z qx qy qz qw\n1.0 0 0 0 0 0 0 1\n"


@pytest.mark.parametrize("name", ["poses.txt", "dive.log", "notes"])
def test_a_log_is_appended_to_logs_alone(cli, tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(POSES)
    code, _, said = cli("inspect", tmp_path, "--log-file", tmp_path / name)
    assert code == 1
    assert f"--log-file {tmp_path / name}: already exists, and is not a log of this program" in said
    assert (tmp_path / name).read_text() == POSES


@pytest.mark.slow
def test_the_log_of_a_run_may_lie_in_its_folder(make_dive, cli, tmp_path: Path) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    for _ in range(2):
        code, _, said = cli(*dive.command(out), "--log-file", out / "run.log")
        assert code == 0, said
    assert (out / "run.log").read_text().count("command line: ") >= 2
    (tmp_path / "other").mkdir()
    (tmp_path / "other/run.log").write_text(POSES)
    assert cli(*dive.command(tmp_path / "other"))[0] == 1


@pytest.mark.parametrize("place", ["map/x", "corrected/x", "page/a/b", ".state/x"])
def test_nothing_is_written_into_a_folder_that_a_run_fills(
    copy_run, cli, tmp_path: Path, place: str
) -> None:
    out = tmp_path / "out"
    copy_run(out)
    for words in (
        ["export", out, "--to", "colmap", "--out", out / place],
        ["metrics", out, "--out", out / place],
        ["markers", out, "--size", "0.1", "--out", out / place],
        ["compare", out, out, "--out", out / place],
        ["convert-calib", out / "rig.yaml", f"{out / place}.yaml"],
    ):
        code, _, said = cli(*words)
        assert code == 1 and "which contains only files of the program" in said, words
    assert not (out / place).exists()


@pytest.mark.slow
def test_a_plan_replaces_plans_alone(make_dive, cli, tmp_path: Path) -> None:
    dive, file = make_dive(2), tmp_path / "out/.state/plan.kept"
    file.parent.mkdir(parents=True)
    words = ("plan", *dive.command(tmp_path / "out")[1:])
    for content in ("my plan", '{"pairs": 3}', "[]"):
        file.write_text(content)
        code, _, said = cli(*words)
        assert (code, f"{file}: is not a plan of this program" in said) == (1, True)
        assert file.read_text() == content
    file.unlink()
    assert [cli(*words)[0] for _ in range(2)] == [0, 0]


def test_a_target_that_finds_no_room_leaves_no_half_file(
    cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    target = tmp_path / "target.pdf"
    monkeypatch.setattr(os, "fsync", full)
    code, _, said = cli("calibrate", "--target", "chessboard:9x6:30mm", "--print-target", target)
    assert code == 1, said
    assert "cannot be written: No space left" in said
    assert not list(tmp_path.iterdir())


@pytest.mark.posix
def test_a_target_is_written_where_the_folder_cannot_be_flushed(
    cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    target = tmp_path / "target.pdf"
    monkeypatch.setattr(os, "fsync", refuse)
    code, _, said = cli("calibrate", "--target", "chessboard:9x6:30mm", "--print-target", target)
    assert code == 0, said
    assert target.read_bytes().startswith(b"%PDF")


@pytest.mark.slow
def test_text_of_a_shared_folder_does_not_command_the_terminal(
    make_dive, cli, tmp_path: Path
) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    (dive.root / "R/0001.png").write_bytes(b"")
    cli(*dive.command(out))
    table = out / FRAMES_TABLE
    table.write_text(table.read_text().replace("is empty", "is\x1b]0;owned\x07 \x1b[2Jempty\x9b"))
    code, printed, said = cli("status", out)
    assert code == 0
    assert "%1B]0;owned%07 %1B[2Jempty" in printed
    lease = {"user": "\x1b[31mmallory", "host": "elsewhere", "process": 1, "token": "t"}
    (out / ".state/lease.json").write_text(json.dumps(lease))
    _, printed, said = cli(*dive.command(out))
    assert not {"\x1b", "\x07", "\x9b"} & set(printed + said)


@pytest.mark.parametrize("name", [".", "../here"])
def test_a_new_folder_does_not_take_the_place_of_the_current_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(OutputError, match="is the current folder"), new_folder(Path(name)):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["here"]
