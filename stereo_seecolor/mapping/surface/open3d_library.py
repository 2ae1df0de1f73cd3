"""Open3D, the optional library that fuses maps (``mapping.engine: open3d``) and opens the window
onto one (``view --window``).
"""

from typing import Any

from stereo_seecolor.errors import DeviceError

SYSTEM_LIBRARIES = "apt-get install -y libusb-1.0-0 libgl1 libgomp1 libegl1"
INSTALL = "pip install 'stereo-seecolor[open3d]'"


def open3d(purpose: str) -> Any:
    """The library, which prints errors alone. Raises DeviceError, with the command that installs
    what ``purpose`` lacks.
    """
    try:
        import open3d as library
    except ModuleNotFoundError as error:
        raise DeviceError(
            f"{purpose} needs Open3D, which is not installed ({error}): {INSTALL}"
        ) from error
    except (ImportError, OSError) as error:
        raise DeviceError(
            f"{purpose} needs Open3D, which lacks a system library ({error}): {SYSTEM_LIBRARIES}"
        ) from error
    library.utility.set_verbosity_level(library.utility.VerbosityLevel.Error)
    return library
