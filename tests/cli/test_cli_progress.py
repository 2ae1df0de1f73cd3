"""What is said while a command works: plain lines, JSON lines, nothing, and the log."""

import json
import logging
import os
import re
from pathlib import Path

import pytest
from conftest import Cli

from stereo_seecolor.cli.progress import LINE_EVERY_S, PlainLines
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.progress import LOG_EVERY_S, LoggingListener
from stereo_seecolor.records import FrameRow


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time that the listeners see; the test sets it."""
    now = [0.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    return now


@pytest.mark.slow
def test_without_a_terminal_lines_say_how_far_it_is(make_dive, cli: Cli, tmp_path: Path) -> None:
    dive = make_dive(3)
    (dive.root / "R/0001.png").write_bytes(b"")
    _, _, said = cli(*dive.command(tmp_path / "out"))
    assert "ranges: 0 of 3" in said.splitlines()
    assert re.search(r"^failed: 0001: .*is empty", said, re.M)
    assert re.search(r"^ranges: 3 of 3, [\d.]+ s$", said, re.M)
    assert re.search(r"^colors: 2 of 2, [\d.]+ s$", said, re.M)


@pytest.mark.slow
def test_a_pair_that_failed_is_neither_tried_nor_named_in_the_passes_after(
    make_dive, cli: Cli, tmp_path: Path
) -> None:
    dive = make_dive(11)  # so many that the light of the dive is looked for first
    (dive.root / "R/0001.png").write_bytes(b"")
    code, _, said = cli(*dive.command(tmp_path / "out"))
    assert code == 3
    assert said.count("failed: 0001: ") == 1
    assert re.search(r"^waters: 10 of 10, [\d.]+ s$", said, re.M)


@pytest.mark.slow
def test_with_json_the_lines_are_json(make_dive, cli: Cli, tmp_path: Path) -> None:
    dive = make_dive(2)
    (dive.root / "R/0001.png").write_bytes(b"")
    _, _, said = cli(*dive.command(tmp_path / "out"), "--json")
    events = [json.loads(line) for line in said.splitlines()]
    assert events[0]["event"] == "notice"
    assert events[1] == {"event": "begin", "stage": "ranges", "total": 2}
    first, second = (
        event for event in events if event["event"] == "advance" and event["stage"] == "ranges"
    )
    assert (first["name"], first["done"], first["total"], first["status"], first["error"]) == (
        "0000",
        1,
        2,
        "ok",
        "",
    )
    assert (second["status"], second["kept"], second["warnings"]) == ("failed", False, [])
    assert "is empty" in second["error"]
    assert second["seconds"] >= 0


@pytest.mark.slow
def test_progress_can_be_chosen(make_dive, cli: Cli, tmp_path: Path) -> None:
    dive = make_dive(1)
    assert cli(*dive.command(tmp_path / "out"), "--progress", "none")[2] == ""
    assert cli(*dive.command(tmp_path / "out"), "--progress", "json")[2].startswith(
        '{"event": "begin"'
    )
    _, printed, said = cli(*dive.command(tmp_path / "out"), "--progress", "lines", "--json")
    # the ranges and the water are those of the first run
    assert said.startswith("ranges: 0 of 1\n")
    assert json.loads(printed)["ok"] == 1
    _, _, said = cli(*dive.command(tmp_path / "out"), "--progress", "bar")
    assert "colors" in said


def test_lines_come_now_and_then(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    listener = PlainLines()
    listener.begin("ranges", 100)
    for done in range(1, 100):
        clock[0] = done * LINE_EVERY_S / 4
        listener.advance(FrameRow(f"{done}"))
    assert capsys.readouterr().err.count("\n") == 1 + 99 // 4


@pytest.mark.slow
def test_the_log_tells_the_story_of_a_run(make_dive, cli: Cli, tmp_path: Path) -> None:
    dive, log = make_dive(2), tmp_path / "logs/run.log"
    (dive.root / "R/0001.png").write_bytes(b"")
    cli(*dive.command(tmp_path / "out"), "--log-file", log)
    lines = log.read_text().splitlines()
    assert all(
        re.match(
            r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} (INFO|WARNING|ERROR) stereo_seecolor\.", line
        )
        for line in lines
    )
    story = "\n".join(lines)
    assert re.search(r"INFO .*stereo-seecolor run --left .*L --right ", story)
    assert re.search(r"INFO .*: ranges: begins, 2 in all\n", story)
    assert re.search(r"ERROR .*: ranges: failed: 0001: .*is empty", story)
    assert re.search(r"INFO .*: ranges: 2 of 2, 1 failed, ", story)
    assert re.search(r"INFO .*: run ended$", lines[-1])


def test_the_log_is_appended_to(cli: Cli, tmp_path: Path) -> None:
    log = tmp_path / "run.log"
    log.touch()
    for _ in range(2):
        assert cli("fuse", tmp_path / "nowhere", "--log-file", log)[0] == 1
    text = log.read_text()
    assert text.count("fuse failed: ") == 2
    assert "Traceback" not in text


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("image.png", "is not a log of"),
        ("cam.yaml", "is not a log of"),
        ("folder", "cannot be written"),
        pytest.param("pipe", "is a named pipe", marks=pytest.mark.posix),
    ],
)
def test_a_log_file_that_is_none(cli: Cli, tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "image.png").write_bytes(b"\x89PNG\0\0")
    (tmp_path / "cam.yaml").write_text("version: 1\n")
    (tmp_path / "folder").mkdir()
    if name == "pipe":
        os.mkfifo(tmp_path / name)
    code, _, said = cli("fuse", tmp_path / "nowhere", "--log-file", tmp_path / name)
    assert code == 1
    assert f"--log-file {tmp_path / name}: " in said
    assert message in said
    assert (tmp_path / "image.png").read_bytes() == b"\x89PNG\0\0"
    assert (tmp_path / "cam.yaml").read_text() == "version: 1\n"


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no disk is full at will")
@pytest.mark.parametrize("as_json", [False, True])
def test_a_log_on_a_full_disk_is_named_once(make_dive, cli: Cli, as_json: bool) -> None:
    words = ("inspect", make_dive(2).root, "--log-file", "/dev/full", *["--json"] * as_json)
    assert cli(*words[:2])[0] == 0
    code, out, said = cli(*words)
    assert said.count("--log-file /dev/full: ends here: No space left on device") == 1
    assert "Traceback" not in said and "Logging error" not in said
    assert code == 3
    assert not as_json or json.loads(out)["exit_code"] == 3


@pytest.mark.slow
def test_verbose_is_the_log_on_standard_error(make_dive, cli: Cli, tmp_path: Path) -> None:
    _, _, said = cli(*make_dive(1).command(tmp_path / "out"), "--verbose")
    assert "INFO stereo_seecolor.progress: ranges: begins, 1 in all" in said
    assert "\nranges: 0 of 1\n" not in said
    assert not [
        handler
        for handler in logging.getLogger("stereo_seecolor").handlers
        if type(handler) is logging.StreamHandler
    ]


def test_an_unknown_error_keeps_its_traceback_in_the_log(
    cli: Cli, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from stereo_seecolor.commands import check

    monkeypatch.setattr(check, "check", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        cli("check", "--left", "L", "--right", "R", "--calib", "c", "--log-file", tmp_path / "log")
    assert "ZeroDivisionError" in (tmp_path / "log").read_text()


def test_the_library_is_quiet_and_can_be_listened_to(
    clock: list[float], caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    listener = RunOptions().listener
    assert isinstance(listener, LoggingListener)
    with caplog.at_level(logging.INFO, "stereo_seecolor"):
        listener.begin("ranges", 50)
        for done in range(1, 51):
            clock[0] = done * LOG_EVERY_S / 10
            listener.advance(FrameRow(f"{done}", warnings=(f"coverage {done} %",)))
    assert capsys.readouterr().err == ""
    assert [
        record.getMessage() for record in caplog.records if record.levelno == logging.WARNING
    ] == ["ranges: 1: coverage 1 %"]
    assert sum(" of 50, 0 failed, " in record.getMessage() for record in caplog.records) == 5
