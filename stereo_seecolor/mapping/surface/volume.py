"""The voxels of a tile."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.mapping.surface.kernels import BLOCK

MIN_WEIGHT = 0.05
"""A surface is kept where the weights add up to this: a standard error of some four voxels, seen once."""


@dataclass(frozen=True, eq=False)
class Volume:
    """A tile's voxels. blocks: (B, 3) int32 coordinates, sorted. tsdf: signed distance in units of the truncation; weight: its
    weight, both (B, 8, 8, 8) float32, index z, y, x. color: (B, 8, 8, 8, 3) float32, 0..255; color_weight: (B, 8, 8, 8) float32.
    """

    blocks: NDArray[np.int32]
    voxel_m: float
    tsdf: NDArray[np.float32]
    weight: NDArray[np.float32]
    color: NDArray[np.float32]
    color_weight: NDArray[np.float32]

    @classmethod
    def empty(cls, blocks: NDArray[np.int32], voxel_m: float) -> "Volume":
        """Make the voxels of these blocks, with nothing measured in any."""
        shape = (len(blocks), BLOCK, BLOCK, BLOCK)
        tsdf, weight, color_weight = (np.zeros(shape, np.float32) for _ in range(3))
        return cls(blocks, voxel_m, tsdf, weight, np.zeros((*shape, 3), np.float32), color_weight)
