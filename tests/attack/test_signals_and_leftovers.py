"""What a run that is asked to end, or was killed, leaves behind; and that nobody's files are taken
for it.
"""

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stereo_seecolor.files.atomic import temporary_path
from stereo_seecolor.files.free_places import new_folder

PROGRAM = (sys.executable, "-m", "stereo_seecolor")
NAMES = (".writing-notes.txt", ".writing-0", ".writing-2024-05-01-dive.csv", ".writing-thesis")


@pytest.mark.slow
@pytest.mark.posix
@pytest.mark.parametrize(("number", "times"), [(signal.SIGTERM, 3), (signal.SIGHUP, 1)])
def test_a_batch_systems_signal_ends_a_run_as_ctrl_c_does(
    make_dive, tmp_path: Path, number: int, times: int
) -> None:
    dive, out = make_dive(40), tmp_path / "out"
    with subprocess.Popen(
        [*PROGRAM, *dive.command(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # ignored where the tests were started by nohup, and inherited
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    ) as process:
        while not (out / "range").exists() and process.poll() is None:
            time.sleep(0.01)
        for _ in range(times):
            process.send_signal(number)
            time.sleep(0.02)
        printed, said = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "stopped early" in printed
    assert "Traceback" not in said
    assert not list(out.rglob("lease*"))
    assert not list(out.rglob(".writing-*"))


@pytest.mark.posix
def test_a_signal_that_is_ignored_stays_ignored() -> None:
    code = "import os, signal; from stereo_seecolor.cli.interrupts import interrupts\n"
    code += (
        "signal.signal(signal.SIGHUP, signal.SIG_IGN)\nwith interrupts():\n    "
        "os.kill(os.getpid(), signal.SIGHUP)\nprint('on')"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout) == (0, "on\n")


@pytest.mark.slow
def test_leftovers_of_a_killed_run_go_and_a_users_files_stay(
    make_dive, cli, tmp_path: Path
) -> None:
    dive, out = make_dive(2), tmp_path / "out"
    assert cli(*dive.command(out))[0] == 0
    (out / "map").mkdir(exist_ok=True)
    folders = [out, out / "page", out / "map", out / "range"]
    left = [temporary_path(folder / "half.png") for folder in folders]
    mine = [folder / name for folder in folders for name in NAMES]
    for file in (*left, *mine):
        file.write_bytes(b"half")
    assert cli(*dive.command(out))[0] == 0
    assert not [file for file in left if file.exists()]
    assert all(file.read_bytes() == b"half" for file in mine)


@pytest.mark.slow
@pytest.mark.posix
def test_what_a_killed_export_left_goes_with_the_next_and_nothing_else(tmp_path: Path) -> None:
    code = (
        "import os, sys; from pathlib import Path; from stereo_seecolor.files.free_places "
        "import new_folder\n"
    )
    code += "with new_folder(Path(sys.argv[1])) as building:\n    (building / 'a').touch()\n"
    killed = "    os.kill(os.getpid(), 9)"
    live = "    print('at work', flush=True); input()"
    out, other = tmp_path / "colmap", tmp_path / "nerf"
    for place in (out, other):
        subprocess.run([sys.executable, "-c", code + killed, place], check=False)
    (abandoned,) = tmp_path.glob(".writing-*-colmap")
    mine = [tmp_path / f"{name}-colmap" for name in NAMES]
    for folder in mine:
        folder.mkdir()
    with subprocess.Popen(
        [sys.executable, "-c", code + live, out], stdin=-1, stdout=-1, text=True
    ) as writing:
        assert writing.stdout is not None and writing.stdout.readline() == "at work\n"
        assert not abandoned.exists(), "the next export into the same folder removes it"
        with new_folder(out) as building:
            assert (
                len([path for path in tmp_path.glob(".writing-*-colmap") if path not in mine]) == 2
            ), "one of them at work"
            (building / "mine").touch()
        writing.kill()
    assert all(folder.is_dir() for folder in mine)
    assert len(list(tmp_path.glob(".writing-*-nerf"))) == 1, "that of another output"
