"""Rigid alignment of the map to surveyed markers; the scale is checked, not fitted."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calibration.transforms import rigid_alignment, scale_of, similarity_alignment, transform_points
from stereo_seecolor.errors import InputError
from stereo_seecolor.mapping.marker_tables import USUAL_STD_M
from stereo_seecolor.mapping.placed_markers import UNITS, PlacedMarker
from stereo_seecolor.records import Array

FEWEST = 3
"""Points that fix a rigid motion; of just three the residuals say little."""
BEYOND_SIGMAS = 5.0
"""Standard errors, of a place and of the map, beyond which a residual is not chance."""
SAME_UNIT = 0.02
"""A factor this near to that of a unit is its."""
EXPLAINED = 0.2
"""A place is mistyped where the others fit so many times better without it."""


@dataclass(frozen=True, eq=False)
class ControlFit:
    """T: (4, 4) from the map's world to that of the control points. residuals_m: by marker. rms_m:
    of them.

    doubt: which places the map contradicts by more than their standard errors, in a line.
    """

    T: Array
    residuals_m: dict[int, float]
    rms_m: float
    doubt: str = ""

    def is_upside_down(self, markers: Sequence[PlacedMarker], T_world_camera: Array) -> bool:
        """Whether surveyed places put the markers above cameras (N, 4, 4) that look down."""
        cameras = T_world_camera[np.isfinite(T_world_camera).all(axis=(1, 2)), :3, 3].mean(axis=0)
        bottom = np.array(
            [marker.place_m for marker in markers if marker.number in self.residuals_m]
        ).mean(axis=0)
        return bool((self.T[:3, :3] @ (cameras - bottom))[2] < 0)


UPSIDE_DOWN = (
    "the surveyed positions put the bottom above the cameras: are x and y (east and north) "
    "exchanged, or two markers, or is z positive downward?"
)


def control_fit(
    markers: Sequence[PlacedMarker],
    points: Mapping[int, Array],
    stds_m: Mapping[int, float] | None = None,
) -> ControlFit:
    """The rigid motion of the map to the surveyed points. stds_m: their standard errors, by number.

    Raises InputError if fewer than three were found, or they lie in line.
    """
    found = [marker for marker in markers if marker.number in points]
    if len(found) < FEWEST:
        raise InputError(
            f"control points: {len(found)} of {len(points)} markers were found in two frames; "
            f"needed: {FEWEST}"
        )
    here = np.array([marker.place_m for marker in found])
    there = np.array([points[marker.number] for marker in found])
    if (
        np.linalg.svd(there - there.mean(axis=0), compute_uv=False)[1]
        < 1e-3 * np.ptp(there, axis=0).max()
    ):
        raise InputError(
            "control points: the markers that were found lie on a line, and the map can rotate "
            "about it: give a marker beside the line"
        )
    T = rigid_alignment(here, there)
    off = np.linalg.norm(transform_points(T, here) - there, axis=1)
    residuals = {marker.number: float(value) for marker, value in zip(found, off, strict=True)}
    stds = np.array([np.hypot((stds_m or {}).get(m.number, USUAL_STD_M), m.std_m) for m in found])
    doubt = _doubt(here, there, found, stds) if (off > BEYOND_SIGMAS * stds).any() else ""
    return ControlFit(T, residuals, float(np.sqrt((off**2).mean())), doubt)


def _doubt(here: Array, there: Array, markers: Sequence[PlacedMarker], stds_m: Array) -> str:
    """Which place is off, where the others fit without it; else the worst residual."""
    off = np.linalg.norm(transform_points(rigid_alignment(here, there), here) - there, axis=1)
    T = similarity_alignment(here, there)
    left = np.linalg.norm(transform_points(T, here) - there, axis=1)
    units = [of for of, times in UNITS.items() if abs(scale_of(T) / times - 1) < SAME_UNIT]
    if units and left.max() < EXPLAINED * off.max():
        return (
            f"the positions lie {scale_of(T):.4g} times as far apart as in the map: as if given "
            f"{units[0]}"
        )
    for i in np.argsort(-off) if len(markers) > FEWEST else ():
        others = np.arange(len(markers)) != i
        T = rigid_alignment(here[others], there[others])
        left = np.linalg.norm(transform_points(T, here) - there, axis=1)
        if (
            left[others].max() < max(EXPLAINED * off.max(), BEYOND_SIGMAS * stds_m.max())
            and left[i] > BEYOND_SIGMAS * stds_m[i]
        ):
            return (
                f"marker {markers[i].number} lies {left[i]:.3f} m from its position according to "
                "the others: is its given position correct?"
            )
    for i, k in combinations(np.flatnonzero(off > BEYOND_SIGMAS * stds_m).tolist(), 2):
        exchanged = there.copy()
        exchanged[[i, k]] = there[[k, i]]
        left = np.linalg.norm(
            transform_points(rigid_alignment(here, exchanged), here) - exchanged, axis=1
        )
        if (left < BEYOND_SIGMAS * stds_m).all():
            return (
                f"markers {markers[i].number} and {markers[k].number} fit if their positions are "
                "exchanged: are their numbers?"
            )
    worst = int(np.argmax(off / stds_m))
    beyond = f"{off[worst]:.3f} m off, {off[worst] / stds_m[worst]:.0f} standard errors"
    return f"marker {markers[worst].number} lies {beyond}: are all given positions correct?"
