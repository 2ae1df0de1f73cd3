"""Open3D, which draws the window onto a map; nothing else needs it."""

from typing import Any

from stereo_seecolor.errors import DeviceError

LIBRARIES = "apt-get install -y libusb-1.0-0 libgl1 libgomp1 libegl1"


def open3d() -> Any:
    """The library. Raises DeviceError, with the command that installs what is missing."""
    try:
        import open3d as library
    except ModuleNotFoundError as error:
        raise DeviceError(f"a window onto the map needs Open3D, which is not installed ({error}): pip install open3d") from error
    except (ImportError, OSError) as error:
        raise DeviceError(f"a window onto the map needs Open3D, which lacks a system library ({error}): {LIBRARIES}") from error
    return library
