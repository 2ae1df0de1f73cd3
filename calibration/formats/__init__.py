"""One file a format; each has read(path) -> StereoRig and, where it makes sense, write."""

from pathlib import Path

from calibration.errors import CalibrationError
from calibration.formats import native
from calibration.rig import StereoRig

__all__ = ["load_rig", "write_rig"]


def load_rig(path: str | Path, image_size: tuple[int, int] | None = None) -> StereoRig:
    """Read a calibration of any known format; which one it is, its content tells.

    path: a file, a folder of files, or two files with a comma between: ``left.yaml,right.yaml``.
    image_size: (width, height) of the images, for files that do not store it (OpenCV's); ignored where the file says.

    Raises CalibrationError, naming the file and the key.
    """
    return native.read(Path(path))


def write_rig(rig: StereoRig, path: str | Path, format: str = "native") -> None:
    """Write ``rig`` in the named format.

    Raises CalibrationError for a format that is not written, or a rig that the format cannot hold.
    """
    if format != "native":
        raise CalibrationError(f"cannot write {format!r}: the formats written are native")
    native.write(rig, Path(path))
