"""What fuses the frames of a tile (``mapping.engine``): our own engine, Open3D, or one that another
package adds; and the work on one tile of a map.
"""

from collections.abc import Callable, Iterable

from calibration.geometry import RectifiedPair
from stereo_seecolor.mapping.surface.own_engine import PlacedFrame, fuse_tile
from stereo_seecolor.mapping.surface.surface import Surface
from stereo_seecolor.mapping.surface.tiles import Tile, Tiling
from stereo_seecolor.plugins import load

FuseTile = Callable[[Tile, Tiling, Iterable[PlacedFrame], RectifiedPair], Surface]
"""An engine: fuses a tile's frames to the triangles of its own blocks, without its rim."""


def engine(name: str) -> FuseTile:
    """The engine of that name. Only one that is chosen is imported.

    Raises PluginError for one that no installed package adds; DeviceError, with the command that
    installs it, where it needs a library that is missing.
    """
    found: FuseTile = fuse_tile if name == "tiles" else load("engines", name, needs=("__call__",))
    return found
