"""``view``: open the page of a run in a browser, or its map in a window of rerun or Open3D."""

import importlib.util
import os
import shutil
import subprocess
import sys
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from shlex import quote

from stereo_seecolor.errors import DeviceError, InputError
from stereo_seecolor.mapping.surface.open3d_library import open3d
from stereo_seecolor.run_folder.layout import INDEX
from stereo_seecolor.run_folder.own_paths import refuse_links_out


@dataclass(frozen=True)
class ViewResult:
    """The opened viewer: "browser", "rerun" or "open3d". mesh: the map shown, None for the page."""

    mesh: Path | None
    viewer: str


def view(out: Path) -> ViewResult:
    """Show ``out``/index.html in the browser; without a page, the map as ``view_map``.

    A page is opened as it is: that of a stranger's folder is the stranger's until ``report`` makes
    it anew.
    Raises InputError if there is neither; OutputError where a link leads out of it;
    DeviceError if there is no browser, viewer or screen.
    """
    page = out / INDEX
    if not out.is_dir():
        raise InputError(f"{out}: no such folder: give the output folder of a run")
    refuse_links_out(out)
    if not page.is_file():
        return view_map(out)
    if not (_has_screen() and webbrowser.open(page.resolve().as_uri())):
        raise DeviceError(
            f"there is no browser to open: copy {out} to a computer with one, and open {INDEX} "
            "there"
        )
    return ViewResult(None, "browser")


def view_map(out: Path) -> ViewResult:
    """Show ``out``/map/mesh.ply until the window is closed.

    Raises InputError if there is no map; DeviceError without a viewer or screen, or if it fails.
    """
    mesh = next(
        (path for path in (out / "map" / "mesh.ply", out / "mesh.ply") if path.is_file()), None
    )
    if mesh is not None and not mesh.resolve().is_relative_to(out.resolve()):
        raise InputError(f"{mesh}: is a link that leads out of {out}: put the file in its place")
    if mesh is None:
        raise InputError(
            f"{out}: holds no map (map/mesh.ply): make it with "
            f"stereo-seecolor fuse {quote(str(out))}"
        )
    if not _has_screen():  # without one, Open3D does not return and rerun's viewer crashes
        raise _no_screen(mesh)
    program = _rerun_program()
    if program is None:
        _open_in_open3d(mesh)
        return ViewResult(mesh, "open3d")
    _open_in_rerun(program, mesh)
    return ViewResult(mesh, "rerun")


def _has_screen() -> bool:
    return not sys.platform.startswith("linux") or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


def _no_screen(mesh: Path) -> DeviceError:
    return DeviceError(
        f"there is no screen to open a window on: look at {mesh.with_name('preview.png')} instead"
    )


def _rerun_program() -> str | None:
    """The viewer's program: on the PATH or in rerun's package, whose starter hides exit codes."""
    package = importlib.util.find_spec("rerun_cli")
    inside = list(package.submodule_search_locations or []) if package else []
    return shutil.which("rerun") or next(
        (found for folder in inside if (found := shutil.which("rerun", path=folder))), None
    )


def _open_in_rerun(program: str, mesh: Path) -> None:
    ended = subprocess.run(
        [program, str(mesh)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
    )
    if ended.returncode != 0:
        output = ended.stdout.decode(errors="replace").strip().splitlines() or ["it gave no reason"]
        raise DeviceError(
            f"rerun's viewer ({program}) ended with exit code {ended.returncode}: {output[-1]}: "
            f"look at {mesh.with_name('preview.png')} instead"
        )


def _open_in_open3d(mesh: Path) -> None:
    library = open3d("a window with the map")
    window = library.visualization.Visualizer()
    if not window.create_window(window_name=str(mesh)):
        raise _no_screen(mesh)
    window.add_geometry(library.io.read_triangle_mesh(mesh))
    window.run()
    window.destroy_window()
