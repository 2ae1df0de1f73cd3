"""Registration of a second survey of a site to the first, with the evidence; it is refused where
the evidence is not enough.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.errors import ComparingError
from stereo_seecolor.extras.reef.comparing.surface_fit import SurfaceFit, surface_fit
from stereo_seecolor.extras.reef.site_surface import Site, grid_of, terrain_of
from stereo_seecolor.files.rasters import open_raster
from stereo_seecolor.geometry import rigid_alignment, scale_of, similarity_alignment, transformed
from stereo_seecolor.mapping.raster import georeference
from stereo_seecolor.mapping.raster.grid import Grid
from stereo_seecolor.mapping.raster.height_model import Terrain
from stereo_seecolor.mapping.track.local_contrast import local_contrast
from stereo_seecolor.mapping.track.sift import keypoints, match_descriptors
from stereo_seecolor.run_folder.layout import MOSAIC
from stereo_seecolor.run_folder.posed_run import PosedRun

# A gray picture of the bottom from above, fine enough to recognize things: the orthomosaic, or
# the mesh's colors without one.

FINEST_OF_VOXEL = 0.25
"""Cells of the picture, in voxels: what is finer is grain that the next dive sees otherwise."""
MOST_PX = 36e6
"""Some 20 s and 2 GB of SIFT; larger sites are examined in coarser cells."""


@dataclass(frozen=True, eq=False)
class Orthophoto:
    """A gray picture. gray: (H, W) uint8, 0 where nothing is known. grid: of its pixels, in the
    map's own coordinates.
    """

    gray: NDArray[np.uint8]
    grid: Grid


def orthophoto(posed: PosedRun, terrain: Terrain) -> Orthophoto:
    """Make the gray picture of a fused run. Raises InputError if its orthomosaic is damaged."""
    path = posed.map_folder / MOSAIC
    if not georeference.available() or not path.is_file():
        return Orthophoto(_gray(np.nan_to_num(terrain.color), terrain.known), terrain.grid)
    from rasterio.enums import Resampling

    with open_raster(path, 4) as file:
        cell_m, corner = (
            file.res[0],
            (file.bounds.left - posed.offset_m[0], file.bounds.top - posed.offset_m[1]),
        )
        step = max(
            FINEST_OF_VOXEL * posed.voxel_m / cell_m,
            float(np.sqrt(file.width * file.height / MOST_PX)),
            1.0,
        )
        shape = max(int(file.height / step), 1), max(int(file.width / step), 1)
        bands = file.read([1, 2, 3, 4], out_shape=(4, *shape), resampling=Resampling.average)
        grid = Grid(corner[0], corner[1], cell_m * file.width / shape[1], shape)
    return Orthophoto(_gray(np.moveaxis(bands[:3], 0, -1), bands[3] > 127), grid)


def _gray(color: NDArray[np.generic], known: NDArray[np.bool_]) -> NDArray[np.uint8]:
    gray = cv2.cvtColor(color.clip(1, 255).astype(np.uint8), cv2.COLOR_RGB2GRAY)
    return np.where(known, np.maximum(gray, 1), 0).astype(np.uint8)


# Landmarks of a site: features of its colors as seen from above, each with its place in three
# dimensions.

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LandmarkSettings:
    """How features are found and matched."""

    per_m2: int = 2000  # of the ground that was seen; more are too small to last a year
    most: int = 60_000  # matching them takes a minute
    # looser than Lowe's 0.8: a rigid motion is searched in what is left, and few wrong ones fit it
    lowe_ratio: float = 0.85
    margin_px: int = 5  # from holes and the edge, where the picture is none of the bottom


LANDMARK_SETTINGS = LandmarkSettings()


@dataclass(frozen=True, eq=False)
class Landmarks:
    """The landmarks of a site. points_m: (n, 3) in the terrain's coordinates. descriptors: (n, 128)
    float32, square roots of normalized SIFT.
    """

    points_m: Array
    descriptors: NDArray[np.float32]


def landmarks(photo: Orthophoto, terrain: Terrain) -> Landmarks:
    """SIFT (Lowe 2004) with root normalization (Arandjelovic and Zisserman 2012) on local contrast,
    where the ground is known.
    """
    known = photo.gray > 0
    contrast = local_contrast(photo.gray, 1.0)
    mask = cv2.erode(
        known.astype(np.uint8),
        np.ones((2 * LANDMARK_SETTINGS.margin_px + 1,) * 2, np.uint8),
        borderValue=0,
    )
    count = min(
        LANDMARK_SETTINGS.most,
        round(LANDMARK_SETTINGS.per_m2 * float(known.sum()) * photo.grid.cell_m**2),
    )
    pixels, descriptors = keypoints(contrast, mask, max(count, 100))
    if not len(pixels):
        return Landmarks(np.zeros((0, 3)), descriptors)
    places = _places(photo, terrain, pixels)
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)).astype(
        np.float32
    )
    high = np.isfinite(places[:, 2])
    return Landmarks(places[high], root[high])


def _places(photo: Orthophoto, terrain: Terrain, pixels: Array) -> Array:
    """(n, 3) of pixels (n, 2); heights between the terrain's cells, NaN beside a hole."""
    grid = photo.grid
    x, y = (
        grid.west_m + (pixels[:, 0] + 0.5) * grid.cell_m,
        grid.north_m - (pixels[:, 1] + 0.5) * grid.cell_m,
    )
    at = terrain.grid.pixels(np.stack([x, y], axis=-1)).astype(np.float32)
    outside = float("nan")
    z = cv2.remap(
        terrain.height_m.astype(np.float32),
        at[:, None, 0],
        at[:, None, 1],
        cv2.INTER_LINEAR,
        borderValue=outside,
    )
    return np.stack([x, y, z[:, 0].astype(np.float64)], axis=-1)


def matched(a: Landmarks, b: Landmarks) -> tuple[Array, Array]:
    """Match landmarks of a and b, each the other's best and better than the next best by Lowe's
    ratio: places (n, 3) of a, and of b.
    """
    index_a, index_b = match_descriptors(a.descriptors, b.descriptors, LANDMARK_SETTINGS.lowe_ratio)
    return a.points_m[index_a], b.points_m[index_b]


# The motion that most matched points agree on: RANSAC on triples, then least squares on the
# inliers.
#
# Both surveys are metric, so a triple whose sides differ is not a match: most wrong ones end there.
# A scale is left to the least squares: each calibration is wrong by some thousandths or hundredths.
# Fischler and Bolles 1981; Umeyama 1991; Horn 1987.


@dataclass(frozen=True)
class RansacSettings:
    """How the motion is searched."""

    triples: int = 200_000  # drawn; at one right match in twenty, 25 of them are right
    tried: int = 2_000  # of those whose sides agree
    refinements: int = 20  # of least squares on what agrees, which changes what agrees
    blocks: int = 6  # of ground, a side: left out one at a time for the scale's standard error


RANSAC_SETTINGS = RansacSettings()


@dataclass(frozen=True, eq=False)
class SimilarityFit:
    """T: (4, 4) from b to a, scale times rotation and a shift. inliers: (n,) bool. rms_m: of the
    inliers' distances. scale_std: standard error of the scale.
    """

    T: Array
    inliers: NDArray[np.bool_]
    rms_m: float
    scale_std: float


def similarity_fit(a: Array, b: Array, tolerance_m: float) -> SimilarityFit | None:
    """Fit the motion and scale of matched points (n, 3), of which those within tolerance_m agree;
    None where no three do.
    """
    best: tuple[int, Array] | None = None
    for triple in _alike_triples(a, b, tolerance_m):
        T = rigid_alignment(b[triple], a[triple])
        agree = int((_distances(T, a, b) < tolerance_m).sum())
        if best is None or agree > best[0]:
            best = agree, T
    if best is None:
        return None
    T = best[1]
    for _ in range(RANSAC_SETTINGS.refinements):
        inliers = _distances(T, a, b) < tolerance_m
        if inliers.sum() < 3:
            return None
        T = similarity_alignment(b[inliers], a[inliers])
        if np.array_equal(_distances(T, a, b) < tolerance_m, inliers):
            break
    distances = _distances(T, a, b)
    inliers = distances < tolerance_m
    if inliers.sum() < 3:
        return None
    rms_m = float(np.sqrt((distances[inliers] ** 2).mean()))
    return SimilarityFit(T, inliers, rms_m, _scale_std(a[inliers], b[inliers]))


def _scale_std(a: Array, b: Array) -> float:
    """The standard error of the scale between points (n, 3) of a and b, by leaving out one block of
    ground at a time: errors of neighbors are alike.
    """
    low, most = a[:, :2].min(axis=0), RANSAC_SETTINGS.blocks
    span = np.maximum(np.ptp(a[:, :2], axis=0), 1e-9)
    place = np.minimum((a[:, :2] - low) / span * most, most - 1).astype(int)
    block = place[:, 0] * most + place[:, 1]
    others = [block != number for number in np.unique(block)]
    scales = np.array([scale_of(similarity_alignment(b[k], a[k])) for k in others if k.sum() >= 3])
    if len(scales) < 2:
        return float("inf")
    return float(np.sqrt((len(scales) - 1) * scales.var()))


def _alike_triples(a: Array, b: Array, tolerance_m: float) -> NDArray[np.int64]:
    """(k, 3) numbers of matches whose triangles have the same sides, none of them short."""
    if len(a) < 3:
        return np.zeros((0, 3), np.int64)
    rng = np.random.default_rng(0)
    triples = rng.integers(0, len(a), (RANSAC_SETTINGS.triples, 3))
    alike = np.ones(len(triples), bool)
    for i, j in ((0, 1), (1, 2), (2, 0)):
        side_a, side_b = (
            np.linalg.norm(points[triples[:, i]] - points[triples[:, j]], axis=1)
            for points in (a, b)
        )
        alike &= (np.abs(side_a - side_b) < tolerance_m) & (side_a > 10 * tolerance_m)
    return np.asarray(triples[alike][: RANSAC_SETTINGS.tried])


def _distances(T: Array, a: Array, b: Array) -> Array:
    return np.asarray(np.linalg.norm(transformed(T, b) - a, axis=1))


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
    scale_sigmas: float = 4.0  # beyond which the scale of the two surveys is said to differ


REGISTRATION_SETTINGS = RegistrationSettings()


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
        if abs(off) <= REGISTRATION_SETTINGS.scale_sigmas * self.scale_std:
            return ""
        return (
            f"lengths of the second survey are {abs(off):.2%} +- {self.scale_std:.2%} too "
            f"{'short' if off > 0 else 'long'} for the first: a calibration or navigation of one "
            "of them is off; the second was scaled to the first: if the first is the wrong one, "
            f"all areas are off by {abs(2 * off):.1%} and all liters by {abs(3 * off):.1%}"
        )

    def std_m(self, points_m: Array, slopes: Array) -> Array:
        """(...,) standard error of the height over a place, through the registration alone, of
        ground through points (..., 3).

        slopes: (2, ...) its rise to the east and to the north: there a shift sideways is one of
        height.
        """
        arm, (east, north) = points_m - self.center_m, slopes
        normal = np.stack([-east, -north, np.ones_like(east)], axis=-1)
        J = np.concatenate([np.cross(arm, normal), normal], axis=-1)
        longer = self.scale_std * (arm * normal).sum(axis=-1)
        return np.asarray(
            np.sqrt(np.einsum("...i,ij,...j->...", J, self.covariance, J) + longer**2)
        )


def register(a: Site, b: Site, cell_m: float) -> Registration:
    """Place b in a's coordinates. Raises ComparingError, with the evidence, where it cannot be
    relied on.
    """
    found = matched(_landmarks(a, cell_m), _landmarks(b, cell_m))
    count = len(found[0])
    coarse = similarity_fit(*found, REGISTRATION_SETTINGS.tolerance_cells * cell_m)
    agreeing = int(coarse.inliers.sum()) if coarse else 0
    needed = max(REGISTRATION_SETTINGS.fewest, round(REGISTRATION_SETTINGS.fraction * count))
    if coarse is None or agreeing < needed:
        raise ComparingError(
            f"the surveys cannot be registered: of {count} features that look alike {agreeing} "
            f"agree on one place (needed: {needed}"
            "): do they show the same site, in colors that are corrected alike?"
        )
    fine = surface_fit(a.mesh, b.mesh, coarse.T, REGISTRATION_SETTINGS.apart_cells * cell_m)
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
    back = transformed(coarse.T @ np.linalg.inv(fine.T), places)
    apart_m = float(np.sqrt(((back - places) ** 2).sum(axis=1).mean()))
    if (
        fine.stable < REGISTRATION_SETTINGS.stable
        or apart_m > REGISTRATION_SETTINGS.apart_cells * cell_m
    ):
        raise ComparingError(
            f"the surveys cannot be registered: {fine.stable:.0%} of the ground fits (needed: "
            f"{REGISTRATION_SETTINGS.stable:.0%}); features "
            f"and surfaces are {1000 * apart_m:.0f} mm apart (at most "
            f"{1000 * REGISTRATION_SETTINGS.apart_cells * cell_m:.0f}): is a map bent?"
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
