"""Registration of a second survey of a site to the first, with the evidence; it is refused where
the evidence is not enough.
"""

from dataclasses import dataclass

import numpy as np

from calibration.transforms import scale_of, transform_points
from stereo_seecolor.errors import ComparingError
from stereo_seecolor.extras.reef.comparing.landmarks import Landmarks, landmarks, matched
from stereo_seecolor.extras.reef.comparing.orthophoto import orthophoto
from stereo_seecolor.extras.reef.comparing.ransac import SimilarityFit, similarity_fit
from stereo_seecolor.extras.reef.comparing.surface_fit import SurfaceFit, surface_fit
from stereo_seecolor.extras.reef.site_surface import Site
from stereo_seecolor.extras.reef.terrain_of_mesh import grid_of, terrain_of
from stereo_seecolor.records import Array


@dataclass(frozen=True)
class RegistrationSettings:
    """When a registration is accepted."""

    tolerance_cells: float = 3.0  # matched points that lie nearer agree
    # matches that agree; wrong matches of a rigid motion with this tolerance reach 4 or 5
    fewest: int = 12
    fraction: float = 0.05  # of the matches; RANSAC finds no motion below
    apart_cells: float = 5.0  # most that registrations by features and by surfaces may differ
    # of the ground over both must fit: what moved cannot be told from what did not otherwise
    stable: float = 0.5
    scale_sigmas: float = 4.0  # beyond which the scales of the two surveys differ
    least_scale: float = 0.001  # tracks without loops differ by as much; a volume by 0.3 %
    wrong_scale: float = 0.02  # beyond which they do not only differ: one is wrong, as for check


SETTINGS = RegistrationSettings()


@dataclass(frozen=True, eq=False)
class Registration:
    """T_a_b: (4, 4) from b's coordinates to a's: scale times rotation, and a shift. covariance:
    (6, 6) of (turn in rad, shift in m) about center_m. scale_std: standard error of the scale.

    matches, agreeing: features, and those that agree on the motion, within feature_rms_m. stable:
    fraction of the ground over both that fits. spread_m: robust standard deviation of the distances
    there. apart_m: between features and surfaces.
    """

    T_a_b: Array
    covariance: Array
    center_m: Array
    matches: int
    agreeing: int
    feature_rms_m: float
    stable: float
    spread_m: float
    apart_m: float
    scale_std: float

    @property
    def scale(self) -> float:
        """How many times as long as in b lengths are in a."""
        return scale_of(self.T_a_b)

    @property
    def scale_note(self) -> str:
        """What it means that the two surveys certainly have different meters; else empty."""
        off = self.scale - 1
        if abs(off) <= max(SETTINGS.scale_sigmas * self.scale_std, SETTINGS.least_scale):
            return ""
        return (
            f"lengths of the second survey are {abs(off):.2%} +- {self.scale_std:.2%} too "
            f"{'short' if off > 0 else 'long'} for the first: a calibration or navigation of one "
            "of them is off; the second was scaled to the first: if the first is the wrong one, "
            f"all areas are off by {abs(2 * off):.1%} and all liters by {abs(3 * off):.1%}"
        )

    @property
    def is_wrong(self) -> bool:
        """Whether lengths of one of the two surveys are off by more than ``check`` accepts."""
        return bool(self.scale_note) and abs(self.scale - 1) > SETTINGS.wrong_scale

    def std_m(self, points_m: Array, slopes: Array) -> Array:
        """(...,) standard error of the height over a place, through the registration alone, of
        ground through points (..., 3).

        slopes: (2, ...) its rise to the east and to the north, where shifts sideways are of height.
        """
        arm, (east, north) = points_m - self.center_m, slopes
        normal = np.stack([-east, -north, np.ones_like(east)], axis=-1)
        J = np.concatenate([np.cross(arm, normal), normal], axis=-1)
        longer = self.scale_std * (arm * normal).sum(axis=-1)
        return np.asarray(
            np.sqrt(np.einsum("...i,ij,...j->...", J, self.covariance, J) + longer**2)
        )


def register(a: Site, b: Site, cell_m: float) -> Registration:
    """Place b in a's coordinates. Raises ComparingError, with the evidence, if unsure."""
    found = matched(_landmarks(a, cell_m), _landmarks(b, cell_m))
    count = len(found[0])
    coarse = similarity_fit(*found, SETTINGS.tolerance_cells * cell_m)
    agreeing = int(coarse.inliers.sum()) if coarse else 0
    needed = max(SETTINGS.fewest, round(SETTINGS.fraction * count))
    if coarse is None or agreeing < needed:
        raise ComparingError(
            f"the surveys cannot be registered: of {count} features that look alike {agreeing} "
            f"agree on one place (needed: {needed}"
            "): do they show the same site, in colors that are corrected alike?"
        )
    fine = surface_fit(a.mesh, b.mesh, coarse.T, SETTINGS.apart_cells * cell_m)
    return _checked(coarse, fine, found[0][coarse.inliers], count, cell_m)


def _landmarks(site: Site, cell_m: float) -> Landmarks:
    """What it can be recognized by."""
    terrain = terrain_of(site.mesh, grid_of(site.mesh, cell_m))
    return landmarks(orthophoto(site.posed, terrain), terrain)


def _checked(
    coarse: SimilarityFit, fine: SurfaceFit | None, places: Array, count: int, cell_m: float
) -> Registration:
    """The registration by features and surfaces together, if they agree."""
    if fine is None:
        raise ComparingError(
            "the surveys cannot be registered: features agree, but the surfaces do not overlap "
            "there"
        )
    back = transform_points(coarse.T @ np.linalg.inv(fine.T), places)
    apart_m = float(np.sqrt(((back - places) ** 2).sum(axis=1).mean()))
    if fine.stable < SETTINGS.stable or apart_m > SETTINGS.apart_cells * cell_m:
        raise ComparingError(
            f"the surveys cannot be registered: {fine.stable:.0%} of the ground fits (needed: "
            f"{SETTINGS.stable:.0%}); features and surfaces are {1000 * apart_m:.0f} mm apart (at "
            f"most {1000 * SETTINGS.apart_cells * cell_m:.0f}): is a map bent?"
        )
    agreeing = int(coarse.inliers.sum())
    return Registration(
        fine.T,
        fine.covariance,
        fine.center_m,
        count,
        agreeing,
        coarse.rms_m,
        fine.stable,
        fine.spread_m,
        apart_m,
        coarse.scale_std,
    )
