"""The surface in a tile's voxels: by Open3D, or by scikit-image where Open3D or its system libraries are missing."""

import importlib.util
from functools import cache

from stereo_seecolor.errors import DeviceError
from stereo_seecolor.mapping.surface import marching_cubes, open3d_extractor
from stereo_seecolor.mapping.surface.volume import MIN_WEIGHT, Triangles, Volume


def check_available() -> None:
    """Raise DeviceError, with the command that installs one, where there is no extractor; call before the first frame."""
    if not open3d_available() and importlib.util.find_spec("skimage") is None:
        raise DeviceError("a map needs scikit-image or Open3D, of which neither can be imported: pip install scikit-image")


@cache
def open3d_available() -> bool:
    """True if Open3D can be imported."""
    try:
        open3d_extractor.open3d()
    except DeviceError:
        return False
    return True


def extract(volume: Volume) -> Triangles | None:
    """The triangles where the signed distance is zero and all eight voxels around have weight; None where there are none."""
    if not (volume.weight > MIN_WEIGHT).any():
        return None
    return open3d_extractor.extract(volume) if open3d_available() else marching_cubes.extract(volume)
