"""A window onto the map."""

from pathlib import Path
from typing import Any

from stereo_seecolor.errors import DeviceError, InputError
from stereo_seecolor.mapping.fusion import check_available


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
    if not window.create_window(window_name=str(mesh)):
        raise DeviceError(f"no window can be opened here: look at {mesh.with_name('preview.png')} instead")
    window.add_geometry(open3d.io.read_triangle_mesh(mesh))
    window.run()
    window.destroy_window()


def _rerun() -> Any:
    try:
        import rerun
    except ImportError:
        return None
    return rerun
