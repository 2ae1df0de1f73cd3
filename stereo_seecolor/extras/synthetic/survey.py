"""The survey: its specification, its rig, and its track."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration import Camera, Rectification, StereoRig
from calibration.rig_errors import RigErrors
from calibration.transforms import rigid_transform, rotation_from_euler
from stereo_seecolor.extras.synthetic.waters import WaterName
from stereo_seecolor.records import Trajectory

START_S = 1_790_000_000.0
SPEED_M_S = 0.5


@dataclass(frozen=True)
class SurveySpec:
    """A synthetic dive, whole: the same specification gives the same images.

    pairs, lines: stereo pairs in all, and lines of the lawn mower over which they are spread; every
    second line flies back.
    line_spacing_m, pair_spacing_m: between lines, and between pairs on a line.
    altitude_m: the cameras' height above the mean bottom, at the start and at the end; it changes
    half way.
    tilt_deg: how far forward of straight down the cameras look.
    bottom_depth_m: depth of the mean bottom below the surface. relief_m: height of the coarse
    relief.
    full_well_e, read_noise_e: electrons of a full and of an empty pixel; they set the noise.
    caustic_contrast: relative strength of the moving light that waves focus on the bottom, 0 for
    none.
    lamp_intensity: light of the rig's lamps at 1 m against the sun's at the bottom, 0 for none; 200
    makes it night.
    lamp_pattern: contrast of rings and spokes in the lamps' beams, which travel with the rig, 0 for
    none, at most 1.
    strobe_variation: standard deviation of the logarithm of the lamps' energy from pair to pair.
    vignette: fraction of the light that the lenses lose in the corners, growing with the square of
    the distance from the middle.
    bits: 8 for sRGB-encoded images, 16 for linear ones.
    """

    seed: int = 7
    pairs: int = 12
    lines: int = 2
    image_size: tuple[int, int] = (640, 512)
    line_spacing_m: float = 1.0
    pair_spacing_m: float = 0.5
    altitude_m: tuple[float, float] = (1.7, 2.6)
    tilt_deg: float = 15.0
    water: WaterName = "blue-ocean"
    bottom_depth_m: float = 8.0
    relief_m: float = 0.3
    textureless_patch: bool = False
    fish: int = 0
    full_well_e: float = 12_000.0
    read_noise_e: float = 6.0
    caustic_contrast: float = 0.0
    lamp_intensity: float = 0.0
    lamp_pattern: float = 0.0
    strobe_variation: float = 0.0
    vignette: float = 0.0
    bits: int = 8

    @property
    def line_length_m(self) -> float:
        """The distance from the first to the last pair of a line."""
        return (-(-self.pairs // self.lines) - 1) * self.pair_spacing_m

    @property
    def exposure_range_m(self) -> float:
        """The range that the exposure is set for: where the cameras are nearest to the bottom."""
        return min(self.altitude_m)


def rig(spec: SurveySpec) -> StereoRig:
    """The rig: 62 degrees wide, 12 cm apart, with lens distortion and a slight rotation, so
    rectification has work to do.
    """
    width, height = spec.image_size
    focal_px = 0.83 * width
    K_left = np.array(
        [[focal_px, 0, 0.503 * width], [0, focal_px * 1.001, 0.491 * height], [0, 0, 1]]
    )
    K_right = np.array(
        [[focal_px * 1.004, 0, 0.494 * width], [0, focal_px * 1.003, 0.507 * height], [0, 0, 1]]
    )
    R = rotation_from_euler(-0.004, 0.012, 0.006)
    T_right_left = rigid_transform(R, R @ [-0.12, 0.0006, -0.0011])
    left = Camera(K_left, np.array([-0.11, 0.04, 0.0006, -0.0004, 0.0]), spec.image_size)
    right = Camera(K_right, np.array([-0.12, 0.05, -0.0005, 0.0007, 0.0]), spec.image_size)
    drawn = RigErrors(focal=0.0, baseline=0.0, stated_by="rendering the dive")
    return StereoRig(left, right, T_right_left, errors=drawn)


def track(spec: SurveySpec) -> Trajectory:
    """Poses of the rectified left camera, world axes east, north, up; origin on the mean bottom at
    the start of the first line.

    The vehicle rolls, pitches, yaws and heaves by a degree or two and a few centimeters, slowly
    enough for neighbors to agree.
    """
    per_line = -(-spec.pairs // spec.lines)
    index = np.arange(spec.pairs)
    line, along = index // per_line, (index % per_line) * spec.pair_spacing_m
    returning = line % 2 == 1
    x_m = np.where(returning, spec.line_length_m - along, along)
    y_m = line * spec.line_spacing_m
    time_s = START_S + (index * spec.pair_spacing_m + line * 4.0) / SPEED_M_S
    sway = _slow_noise(spec, time_s)
    progress = index / max(spec.pairs - 1, 1)
    climb = 1.0 / (1.0 + np.exp(-(progress - 0.5) * 16.0))
    z_m = spec.altitude_m[0] + (spec.altitude_m[1] - spec.altitude_m[0]) * climb + 0.04 * sway[3]
    y_m = y_m + 0.05 * sway[4]

    R_left = Rectification.from_rig(rig(spec)).R_left
    tilt_rad = np.radians(spec.tilt_deg)
    poses = np.empty((spec.pairs, 4, 4))
    for i in range(spec.pairs):
        heading = np.pi if returning[i] else 0.0
        # small turns about the camera's x (pitch), y (yaw) and z (roll)
        attitude = rotation_from_euler(0.025 * sway[1, i], 0.03 * sway[2, i], 0.025 * sway[0, i])
        R = _looking_down(heading, tilt_rad) @ attitude @ R_left.T
        poses[i] = rigid_transform(R, (x_m[i], y_m[i], z_m[i]))
    return Trajectory(_frame_names(time_s), time_s, poses)


def _frame_names(time_s: NDArray[np.float64]) -> tuple[str, ...]:
    """``reef_<milliseconds since 1970>``: unique, in order, and the time can be read back."""
    return tuple(f"reef_{round(t * 1000):013d}" for t in time_s)


def _looking_down(heading_rad: float, tilt_rad: float) -> NDArray[np.float64]:
    """Camera axes in the world: image up is ahead, image right is starboard, the axis ``tilt_rad``
    ahead of straight down.
    """
    ahead = np.array([np.cos(heading_rad), np.sin(heading_rad), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    forward = np.sin(tilt_rad) * ahead - np.cos(tilt_rad) * up
    down = -np.cos(tilt_rad) * ahead - np.sin(tilt_rad) * up
    return np.stack([np.cross(down, forward), down, forward], axis=1)


def _slow_noise(spec: SurveySpec, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """(5, pairs) of about unit variance, a sum of slow sines: swell and control."""
    rng = np.random.default_rng([spec.seed, 1])
    periods_s = rng.uniform(7.0, 30.0, (5, 4, 1))
    phases = rng.uniform(0.0, 2 * np.pi, (5, 4, 1))
    return np.asarray(
        np.sin(2 * np.pi * (time_s - START_S) / periods_s + phases).sum(axis=1) / np.sqrt(2.0)
    )
