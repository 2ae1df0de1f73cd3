"""Synthetic color cases with known truth: many scenes, waters and reliefs, so that no method is
chosen by one picture.

Scenes: dead leaves of reef materials (natural mixtures, and strongly colored ones that gray world
gets wrong), material tied to range in half of them. Waters: Jerlov's types as seen by a camera's
bands, daylight through 0 to 15 m of them; and freely drawn waters that follow no table, half of
them with no light loss on the way down. Cameras: sRGB or another curve, shot and read noise.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.files.srgb import encode_srgb
from stereo_seecolor.records import Water

MATERIALS = np.array(
    [  # linear reflectance R, G, B
        [0.55, 0.47, 0.36],  # sand
        [0.25, 0.24, 0.22],  # rock
        [0.22, 0.15, 0.08],  # brown coral
        [0.14, 0.15, 0.07],  # turf
        [0.33, 0.26, 0.17],  # rubble
        [0.08, 0.18, 0.05],  # green alga
        [0.45, 0.07, 0.05],  # red sponge
        [0.55, 0.42, 0.06],  # yellow sponge
        [0.28, 0.15, 0.35],  # purple sea fan
        [0.10, 0.20, 0.45],  # blue tunicate
        [0.45, 0.28, 0.30],  # coralline crust
        [0.50, 0.22, 0.06],  # orange cup coral
        [0.80, 0.80, 0.78],  # bleached skeleton
        [0.03, 0.03, 0.03],  # crevice
    ]
)
NATURAL = np.array([5, 5, 5, 4, 5, 2, 0.5, 0.5, 0.5, 0.2, 1, 0.5, 0.5, 1.5])
JERLOV = {  # 1/m at 450, 475, 525, 550, 600, 625 nm: Jerlov 1976, Marine Optics, table XXVII
    "I": (0.019, 0.018, 0.043, 0.063, 0.235, 0.305),
    "IA": (0.026, 0.025, 0.048, 0.067, 0.24, 0.31),
    "IB": (0.036, 0.033, 0.054, 0.072, 0.245, 0.315),
    "II": (0.068, 0.062, 0.076, 0.089, 0.26, 0.335),
    "III": (0.135, 0.116, 0.116, 0.12, 0.295, 0.375),
    "1C": (0.25, 0.17, 0.13, 0.12, 0.30, 0.37),
    "3C": (0.39, 0.29, 0.20, 0.19, 0.33, 0.40),
    "5C": (0.56, 0.43, 0.31, 0.30, 0.40, 0.48),
    "7C": (0.89, 0.71, 0.49, 0.46, 0.48, 0.54),
}


@dataclass(frozen=True, eq=False)
class Case:
    """A picture through water: image (H, W, 3) uint8; range_m (H, W) float32; truth (H, W, 3)
    linear J; its water.
    """

    name: str
    image: NDArray[np.uint8]
    range_m: NDArray[np.float32]
    truth: NDArray[np.float64]
    water: Water | None


def smooth_noise(rng, shape, scale):
    small = rng.standard_normal(
        (max(2, int(shape[0] / scale) + 2), max(2, int(shape[1] / scale) + 2))
    )
    field = cv2.resize(small, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC)
    return (field - field.mean()) / (field.std() + 1e-9)


def make_range(rng, shape, kind):
    """flat: a few per cent; slope: 1.5 to 2.5 times; deep: 3 to 8 times, as looking forward."""
    y, x = np.mgrid[0 : 1 : shape[0] * 1j, 0 : 1 : shape[1] * 1j]
    altitude = rng.uniform(1.0, 4.0)
    spread = {
        "flat": rng.uniform(0.02, 0.12),
        "slope": rng.uniform(0.4, 0.9),
        "deep": rng.uniform(1.0, 1.4),
    }[kind]
    turn = rng.uniform(0, 2 * np.pi)
    plane = np.cos(turn) * x + np.sin(turn) * y
    plane = (plane - plane.min()) / np.ptp(plane)
    bumps = 0.25 * smooth_noise(rng, shape, shape[1] / 4) + 0.12 * smooth_noise(
        rng, shape, shape[1] / 12
    )
    log_range = spread * np.clip(plane + 0.6 * bumps, -0.15, 1.15)
    return (altitude * np.exp(log_range - log_range.min())).astype(np.float32)


def make_truth(rng, shape, range_m, colored):
    """Dead leaves of materials, shaded; in half of the scenes what lies far differs from what lies
    near.
    """
    weights = rng.dirichlet(np.full(len(MATERIALS), 0.35)) if colored else rng.dirichlet(NATURAL)
    other = (
        (rng.dirichlet(np.full(len(MATERIALS), 0.35)) if colored else rng.dirichlet(NATURAL))
        if rng.random() < 0.5
        else weights
    )
    labels = np.zeros(shape, np.int32)
    rank = (range_m.argsort(axis=None).argsort() / range_m.size).reshape(shape)
    for _ in range(400):
        cx, cy = int(rng.integers(shape[1])), int(rng.integers(shape[0]))
        far = rng.random() < rank[cy, cx]
        material = int(rng.choice(len(MATERIALS), p=other if far else weights))
        size = np.minimum(4 / rng.random(2) ** 0.7, shape[1] / 5)
        cv2.ellipse(
            labels,
            (cx, cy),
            (int(size[0]) + 2, int(size[1]) + 2),
            float(rng.uniform(0, 180)),
            0,
            360,
            material,
            -1,
        )
    truth = MATERIALS[labels] * np.exp(0.12 * rng.standard_normal((len(MATERIALS), 3)))[labels]
    truth = truth * np.exp(
        0.08 * np.stack([smooth_noise(rng, shape, 6) for _ in range(3)], axis=-1)
    )
    shade = np.exp(
        0.35 * smooth_noise(rng, shape, 25)
        + 0.25 * smooth_noise(rng, shape, 4)
        + 0.1 * rng.standard_normal(shape)
    )
    return np.clip(truth * np.clip(shade, 0.02, 2.0)[..., None], 0, 1)


def jerlov_water(rng):
    """Water and light that belong together: the light that arrives came down through the same
    water.
    """
    kinds = list(JERLOV.values())
    at = rng.uniform(0, len(kinds) - 1)
    mix = np.array(kinds[int(at)]) * (1 - at % 1) + np.array(
        kinds[min(int(at) + 1, len(kinds) - 1)]
    ) * (at % 1)
    diffuse = np.array([mix[4:6].mean(), mix[2:4].mean(), mix[0:2].mean()])
    scatter = rng.uniform(0.0, 0.15)
    attenuation = diffuse * rng.uniform(1.0, 1.5) + scatter
    depth_m = rng.uniform(0, 15 if diffuse.min() < 0.2 else 5)
    camera = np.exp(0.10 * rng.standard_normal(3))
    white = np.exp(-diffuse * depth_m) * camera
    gamma_inf = white * rng.uniform(0.03, 0.35) * np.exp(0.15 * rng.standard_normal(3))
    return white, attenuation, gamma_inf, attenuation * rng.uniform(0.8, 1.4)


def free_water(rng):
    """Water that follows no table."""
    attenuation = (
        np.sort(rng.uniform(0.02, 0.5, 3))[::-1]
        if rng.random() < 0.5
        else rng.uniform([0.17, 0.02, 0.02], [0.55, 0.4, 0.4])
    )
    white = np.ones(3) if rng.random() < 0.5 else np.exp(-rng.uniform([0.2, 0, 0], [1.4, 0.4, 0.6]))
    gamma_inf = rng.uniform([0.01, 0.04, 0.05], [0.1, 0.3, 0.35]) * white.max()
    return white, attenuation, gamma_inf, attenuation * rng.uniform(0.7, 2.0, 3)


def make_case(seed: int, shape: tuple[int, int] = (240, 320)) -> Case:
    """The case of a seed; every seed has another scene, relief, water, camera."""
    rng = np.random.default_rng([20240, seed])
    kind, colored = ("flat", "slope", "deep")[seed % 3], bool((seed // 3) % 2)
    draw_water, name = (free_water, "free") if (seed // 6) % 3 == 0 else (jerlov_water, "jerlov")
    white, attenuation, gamma_inf, beta = draw_water(rng)
    range_m = make_range(rng, shape, kind)
    truth = make_truth(rng, shape, range_m, colored)
    # Nearer, where water would leave less than 5 to 35 % of the weakest channel: stereo would find
    # nothing there.
    range_m = range_m * np.float32(
        min(1, rng.uniform(1.0, 3.0) / (attenuation.max() * np.nanquantile(range_m, 0.95)))
    )
    z = range_m.astype(np.float64)[..., None]
    linear = truth * white * np.exp(-attenuation * z) + gamma_inf * -np.expm1(-beta * z)
    exposure = rng.uniform(0.45, 1.0) / np.nanquantile(linear.max(axis=-1), 0.995)
    noisy = linear * exposure
    noisy = noisy + rng.standard_normal(noisy.shape) * np.sqrt(
        noisy / rng.uniform(4000, 20000) + 0.002**2
    )
    curve = rng.random()
    encoded = (
        encode_srgb(np.clip(noisy, 0, 1))
        if curve < 0.7
        else np.clip(noisy, 0, 1) ** (1 / rng.uniform(1.8, 2.4))
    )
    image = np.clip(np.round(np.nan_to_num(encoded) * 255), 0, 255).astype(np.uint8)
    tag = f"{name}-{kind}-{'colored' if colored else 'natural'}-{seed}"
    zero = np.zeros(3)
    water = Water(
        gamma_inf * exposure,
        beta,
        zero,
        zero,
        w=zero,
        v=zero,
        y=attenuation,
        x=zero,
        white=white * exposure,
    )
    return Case(tag, image, range_m, truth, water)
