"""The program at its edges: full devices, closed pipes, terminals that know ASCII only, Ctrl-C;
never a traceback.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stereo_seecolor.cli.text import lines, table

PROGRAM = (sys.executable, "-m", "stereo_seecolor")
needs_dev_full = pytest.mark.skipif(
    not Path("/dev/full").exists(), reason="a device that is always full exists on Linux only"
)


def run(*words: str | Path, **options) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*PROGRAM, *map(str, words)], text=True, stderr=subprocess.PIPE, **options
    )


@pytest.mark.slow
@needs_dev_full
@pytest.mark.parametrize(
    "words",
    [
        ("config",),
        ("config", "--json"),
        ("--version",),
        ("convert-calib", "nowhere", "x", "--json"),
    ],
)
def test_output_to_a_full_device_is_an_error_in_one_line(words) -> None:
    with Path("/dev/full").open("w") as full:
        ended = run(*words, stdout=full)
    assert ended.returncode == 1
    assert ended.stderr.count("\n") == 1
    assert (
        "convert-calib" in words
        or "standard output cannot be written: No space left on device" in ended.stderr
    )


@pytest.mark.slow
def test_a_reader_that_has_gone_ends_the_program_in_silence() -> None:
    read, write = os.pipe()
    os.close(read)
    ended = run("config", stdout=write)
    os.close(write)
    assert (ended.returncode, ended.stderr) == (1, "")


@pytest.mark.slow
@needs_dev_full
def test_messages_that_cannot_be_written_are_no_error() -> None:
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            [*PROGRAM, "config", "--set", "no.key=1"],
            stdout=subprocess.PIPE,
            stderr=full,
            text=True,
        )
    assert (ended.returncode, ended.stdout) == (1, "")


@pytest.mark.slow
@pytest.mark.posix
def test_closed_streams_are_no_error() -> None:
    ended = subprocess.run(["sh", "-c", f"{sys.executable} -m stereo_seecolor config >&- 2>&-"])
    assert ended.returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["d\u00fcnung \u6df1\u6d77", "broken\udcff\udcfe"])
def test_odd_names_on_an_ascii_terminal(tmp_path: Path, name: str) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0", "LC_ALL": "C"}
    ended = run("fuse", tmp_path / name, stdout=subprocess.PIPE, env=environment)
    assert ended.returncode == 1
    assert ended.stderr.startswith("stereo-seecolor: ")
    assert ended.stderr.isascii()
    assert ended.stderr.count("\n") == 1


def start_and_interrupt(words: list[str], out: Path, times: int) -> tuple[int, str, str]:
    """Start a run, press Ctrl-C once it writes ranges, and again at once for the other times."""
    with subprocess.Popen(
        [*PROGRAM, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as process:
        while not (out / "range").exists() and process.poll() is None:
            time.sleep(0.01)
        for _ in range(times):
            process.send_signal(signal.SIGINT)
            time.sleep(0.02)
        printed, said = process.communicate(timeout=120)
    return process.returncode, printed, said


@pytest.mark.slow
@pytest.mark.parametrize("times", [1, 5])
def test_ctrl_c_any_number_of_times(make_dive, tmp_path: Path, times: int) -> None:
    out = tmp_path / "out"
    code, printed, said = start_and_interrupt(make_dive(40).command(out), out, times)
    assert code == 130
    assert "Traceback" not in said
    assert "Ctrl-C again stops immediately" in said
    if times == 1:
        assert "stopped early" in printed
        assert not list(out.rglob(".writing-*"))


@pytest.mark.slow
@pytest.mark.posix
def test_ctrl_c_before_the_work_begins() -> None:
    code = (
        "import os, signal; from stereo_seecolor.cli import main; os.kill(os.getpid(), "
        "signal.SIGINT) if 0 else None\n"
    )
    code += (
        "import stereo_seecolor.cli.app as app; app.run_command_line = lambda: "
        "os.kill(os.getpid(), signal.SIGINT)\nmain()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert ended.returncode == 130
    assert "Traceback" not in ended.stderr


def test_what_a_name_holds_breaks_no_line() -> None:
    """A label with a line break, a tab, or what a terminal obeys; one of many characters."""
    name = "Acropora\nsp.\t\x1b[31m"
    assert lines(name, "b") == "Acropora%0Asp.%09%1B[31m\nb\n"
    drawn = table(("label", "n"), [(name, "1"), ("x" * 20_000, "2")]).splitlines()
    assert [len(line.split()) for line in drawn] == [2, 2, 2]
