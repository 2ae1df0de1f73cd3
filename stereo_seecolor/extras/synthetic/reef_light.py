"""Light on the reef: sun through waves and water, the rig's lamps, and lens vignetting."""

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.extras.synthetic.waters import LitWater

Points = NDArray[np.float32]

LAMPS_M = np.array([[-0.30, -0.12, -0.10], [0.42, -0.12, -0.10]])
"""Where the lamps sit in the rectified left camera's axes: beside, above and behind."""
LAMP_BEAM_EXPONENT = 3.0
LAMP_RING_RAD, LAMP_SPOKES = 0.12, 9
"""The pattern of a lamp's reflector and of the ribs of its cover: rings this wide, and so many
spokes.
"""


def sunlight(water: LitWater, points_m: Points) -> NDArray[np.float32]:
    """Compute the light of the sun at world points: (..., 3), 1 = full scale from a white surface;
    each channel falls off with depth.
    """
    depth_m = water.depth_m - points_m[..., 2:3]
    fall_off = np.exp(
        -water.sun_attenuation.astype(np.float32) * (depth_m - np.float32(water.depth_m))
    )
    return np.asarray(water.water.white.astype(np.float32) * fall_off)


def caustics(spec: SurveySpec, points_m: Points, time_s: float) -> NDArray[np.float32]:
    """Compute a factor on the sunlight, mean about 1: (...,); bright lines where waves of several
    directions focus it, moving with time.
    """
    rng = np.random.default_rng([spec.seed, 3])
    total = np.zeros(points_m.shape[:-1], np.float32)
    for _ in range(5):
        angle, wavelength_m = rng.uniform(0, 2 * np.pi), rng.uniform(0.25, 0.7)
        phase = 2 * np.pi * (time_s * rng.uniform(0.4, 1.0) + rng.random())
        along = points_m[..., 0] * np.cos(angle) + points_m[..., 1] * np.sin(angle)
        total += np.sin(2 * np.pi * along / wavelength_m + phase).astype(np.float32)
    lines = np.exp(-(total**2)) - 0.38  # bright where the waves cancel; 0.38 is about its mean
    return np.asarray(np.maximum(1.0 + spec.caustic_contrast * lines, 0.1), dtype=np.float32)


def lamplight(
    spec: SurveySpec, water: LitWater, points_m: Points, T_world_camera: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Compute the light of the rig's lamps at world points, (..., 3): beam shape and pattern, 1 /
    distance squared, and the water between.
    """
    brightness = spec.lamp_intensity * float(water.water.white.max())
    axis = T_world_camera[:3, 2].astype(np.float32)
    total = np.zeros(points_m.shape, np.float32)
    for lamp_m in LAMPS_M:
        position = (T_world_camera[:3, :3] @ lamp_m + T_world_camera[:3, 3]).astype(np.float32)
        away = points_m - position
        distance_m = np.linalg.norm(away, axis=-1)
        beam = np.maximum(away @ axis / distance_m, 0.0) ** LAMP_BEAM_EXPONENT
        if spec.lamp_pattern > 0:
            beam *= lamp_pattern(
                spec.lamp_pattern, away @ T_world_camera[:3, :3].astype(np.float32)
            )
        total += (brightness * beam / distance_m**2)[..., None] * water.water.attenuation(
            distance_m
        ).astype(np.float32)
    return np.asarray(total / len(LAMPS_M), dtype=np.float32)


def lamp_pattern(contrast: float, away: Points) -> NDArray[np.float32]:
    """Compute a factor on a lamp's beam, mean about 1: (...,), rings and spokes. away: (..., 3)
    from the lamp, in the camera's axes.
    """
    across = np.hypot(away[..., 0], away[..., 1])
    rings = np.cos(2 * np.pi * np.arctan2(across, away[..., 2]) / LAMP_RING_RAD)
    spokes = np.cos(LAMP_SPOKES * np.arctan2(away[..., 1], away[..., 0]))
    return np.asarray(1 + contrast * rings * (0.5 + 0.5 * spokes), np.float32)


def strobe_energy(spec: SurveySpec, index: int) -> float:
    """Factor on the lamps' light in a pair: strobes not recharged, or set by the camera."""
    return float(
        np.exp(
            spec.strobe_variation * np.random.default_rng([spec.seed, 6, index]).standard_normal()
        )
    )


def vignetting(spec: SurveySpec) -> NDArray[np.float32]:
    """The fraction of the light that the lens transmits, by pixel of the raw image: (H, W)."""
    width, height = spec.image_size
    y, x = np.ogrid[:height, :width]
    squared = ((2 * x + 1 - width) ** 2 + (2 * y + 1 - height) ** 2) / (width**2 + height**2)
    return np.asarray(1 - spec.vignette * squared, np.float32)
