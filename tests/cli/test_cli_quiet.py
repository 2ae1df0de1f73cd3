"""What libraries in C write to standard error stays off the terminal; what the program says gets
there.
"""

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from stereo_seecolor.cli import main
from stereo_seecolor.cli.quiet import quiet_libraries


def with_bad_profile(image: np.ndarray) -> bytes:
    """A PNG with an opacity, which libpng reads, and a color profile that it complains about; its
    pixels are good.
    """
    content = cv2.imencode(".png", np.dstack([image, np.full(image.shape[:2], 255, np.uint8)]))[
        1
    ].tobytes()
    kind, data = b"iCCP", b"x\x00\x00" + zlib.compress(bytes(200))
    chunk = struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    return content[:33] + chunk + content[33:]


@pytest.mark.slow
@pytest.mark.parametrize("verbose", [False, True])
def test_libpngs_warnings_are_shown_only_if_asked_for(
    make_dive,
    tmp_path: Path,
    verbose: bool,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    dive = make_dive(2)
    for side in "LR":
        path = dive.root / side / "0000.png"
        path.write_bytes(with_bad_profile(cv2.imread(str(path))))
    (dive.root / "L" / "0001.png").write_bytes(b"damaged")
    words = dive.command(tmp_path / "out", *(["--verbose"] if verbose else []))
    monkeypatch.setattr(sys, "argv", ["stereo-seecolor", *words])
    with pytest.raises(SystemExit) as end:
        main()
    done = capfd.readouterr()
    assert end.value.code == 3
    assert ("libpng warning" in done.err) == verbose
    assert "1 pair done, 1 failed" in done.out


@pytest.mark.slow
def test_errors_of_the_program_get_to_standard_error() -> None:
    words = ["check", "--left", "nowhere", "--right", "elsewhere", "--calib", "cam.yaml"]
    done = subprocess.run(
        [sys.executable, "-m", "stereo_seecolor", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert "nowhere: the folder of left images does not exist" in done.stderr


def test_everything_is_as_before_afterwards(capfd: pytest.CaptureFixture[str]) -> None:
    with quiet_libraries():
        os.write(2, b"from C")
        print("from Python", file=sys.stderr)
    os.write(2, b"C again")
    said = capfd.readouterr().err
    assert "from C" not in said
    assert "C again" in said


@pytest.mark.slow
def test_libraries_hear_of_their_threads_before_they_are_imported() -> None:
    code = (
        "import sys; sys.argv = ['x', '--version']\n"
        "from stereo_seecolor import cli\n"
        "cli.one_thread_in_libraries = lambda: print('BEFORE', sorted({'numpy', 'cv2', 'scipy'} & "
        "sys.modules.keys()))\n"
        "cli.main()"
    )
    printed = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert "BEFORE []" in printed
