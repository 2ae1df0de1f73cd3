"""The command view: which viewer is started, and what is said where none can be."""

import os
import sys
from pathlib import Path

import pytest

from stereo_seecolor.commands.view import view
from stereo_seecolor.errors import DeviceError, InputError


@pytest.fixture
def fused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a map, on a machine with a screen."""
    (tmp_path / "map").mkdir()
    (tmp_path / "map" / "mesh.ply").write_bytes(b"ply")
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("DISPLAY", ":0")
    return tmp_path


def install_rerun(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """A program of that name, first on the PATH."""
    program = folder / "bin" / "rerun"
    program.parent.mkdir()
    program.write_text(f"#!/bin/sh\n{script}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}{os.pathsep}{os.environ['PATH']}")


def test_rerun_is_given_the_mesh(fused: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install_rerun(fused, monkeypatch, f'echo "$@" > {fused}/arguments')
    assert view(fused).viewer == "rerun"
    assert (fused / "arguments").read_text() == f"{fused / 'map' / 'mesh.ply'}\n"


def test_a_viewer_that_dies_is_an_error(fused: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install_rerun(fused, monkeypatch, "echo starting; echo 'no graphics card' >&2; exit 7")
    with pytest.raises(
        DeviceError, match=r"exit code 7: no graphics card: look at .*preview\.png instead"
    ):
        view(fused)


def test_without_open3d_and_rerun_the_line_that_installs_one_is_given(
    fused: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(
        DeviceError,
        match=r"a window with the map needs Open3D, .*: pip install 'stereo-seecolor\[open3d\]'$",
    ):
        view(fused)


def test_without_a_screen_the_preview_is_named(
    fused: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(
        DeviceError, match=r"there is no screen to open a window on: look at .*preview\.png instead"
    ):
        view(fused)


def test_without_a_map_the_command_that_makes_it_is_named(tmp_path: Path) -> None:
    out = tmp_path / "dive 1"
    out.mkdir()
    with pytest.raises(
        InputError,
        match=rf"holds no map \(map/mesh\.ply\): make it with stereo-seecolor fuse '{out}'",
    ):
        view(out)
    with pytest.raises(InputError, match="no such folder"):
        view(tmp_path / "out")
