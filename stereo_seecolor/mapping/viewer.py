"""A window onto the map."""

import os
import sys
from pathlib import Path
from typing import Any

from stereo_seecolor.errors import DeviceError, InputError
from stereo_seecolor.mapping.surface.extraction import check_available


def view(out: Path) -> None:
    """Open OUT/map/mesh.ply in rerun where the viewer extra is installed, else in Open3D's viewer; returns when it is closed.

    Raises InputError if there is no map, DeviceError if there is no viewer or no screen.
    """
    mesh = next((path for path in (out / "map" / "mesh.ply", out / "mesh.ply") if path.is_file()), None)
    if mesh is None:
        raise InputError(f"{out}: holds no map (map/mesh.ply): make it with stereo-seecolor fuse {out}")
    rerun = _rerun()
    if rerun is not None:
        rerun.init("stereo-seecolor", spawn=True)
        rerun.log_file_from_path(mesh)
        return
    check_available()
    import open3d

    window = open3d.visualization.Visualizer()
    # Without a screen Open3D would draw into memory for ever.
    if not _has_screen() or not window.create_window(window_name=str(mesh)):
        raise DeviceError(f"there is no screen to open a window on: look at {mesh.with_name('preview.png')} instead")
    window.add_geometry(open3d.io.read_triangle_mesh(mesh))
    window.run()
    window.destroy_window()


def _has_screen() -> bool:
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _rerun() -> Any:
    try:
        import rerun
    except ImportError:
        return None
    return rerun
