"""The weight of a view's color in an average, in the fused surface and the mosaic alike."""

from typing import Any

from stereo_seecolor.compute.compiled import compiled

DOUBTFUL_WEIGHT = 0.02
"""Weight of a color that is clipped or beyond recovery: counts only where there is no other."""


@compiled
def color_weight(coarseness: Any, doubtful: Any) -> Any:
    """Compute the weight 1 / (1 + coarseness^2) of a pixel whose size on the bottom is
    ``coarseness`` voxels or cells.

    Not more than that: with light and water taken out, caustics, shadows and what is left of the
    lamps' pattern are the larger part of a color's error, and they are independent of range; the
    average over many views is truer than the nearest one.
    """
    weight = 1 / (1 + coarseness * coarseness)
    return weight * DOUBTFUL_WEIGHT if doubtful else weight
