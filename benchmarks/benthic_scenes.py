"""Drawn benthic scenes of published spectra in waters of measured properties: colors, and whether
standard errors hold.

    python benchmarks/benthic_scenes.py [--waters 30] [--first-seed 0]

The spectra are split by source: what a scene shows is left out of the prior of its fit, whose other
half comes from other papers. Every wavelength goes through the water by itself. All of this is
drawn: patches of one spectrum, relief, light and noise.
"""

import argparse
import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from color_cases import make_range, smooth_noise
from independent_waters import KINDS
from measured_waters import Kind, SpectralWater, draw_contents, draw_water
from spectra import mixed, read_spectra

from stereo_seecolor.color.fitting import robust, scene_prior
from stereo_seecolor.color.table.counting import measure
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.extras.evaluation.measures import angle_deg
from stereo_seecolor.files.srgb import encode_srgb

SPLIT = (
    frozenset({"maritorena1994", "hochberg2003", "pigments"}),
    frozenset({"mobley2005", "roelfsema2012", "leiper2012", "lubin2001", "bigelow2023"}),
)
"""Scenes of either half are corrected by fits whose prior knows the other half alone."""
GROUPS = {
    "sand": ("sand", "rubble", "silt"),
    "coral": ("coral",),
    "algae": ("algae", "turf", "seagrass"),
}
SHAPE = (240, 320)
MOST_OPTICAL_DEPTH = 2.0
"""Of the weakest channel at the far end: beyond, hardly any red is left to see."""


@contextmanager
def prior_without(sources: frozenset[str]) -> Iterator[None]:
    """The fit's prior without the spectra of these sources, in this block."""
    colors, before = mixed(sources), scene_prior.sea_floor
    scene_prior.sea_floor = robust.sea_floor = lambda: colors
    scene_prior.whole_prior.cache_clear()
    try:
        yield
    finally:
        scene_prior.sea_floor = robust.sea_floor = before
        scene_prior.whole_prior.cache_clear()


@dataclass(frozen=True, eq=False)
class Scene:
    """A picture through water. image (H, W, 3) uint8; range_m (H, W); linear (H, W, 3): light
    before noise and encoding; truth
    (H, W, 3): what the camera sees in air under flat light; kind (H, W): name of the thing.
    """

    image: np.ndarray
    range_m: np.ndarray
    linear: np.ndarray
    truth: np.ndarray
    kind: np.ndarray
    water: SpectralWater


def drawn(shown: frozenset[str], kind: Kind, seed: int) -> Scene:
    """A scene of the spectra of these sources, in a water of a kind."""
    rng = np.random.default_rng([81, seed, KINDS.index(kind)])
    kinds, sources, spectra = read_spectra()
    known = np.flatnonzero([source in shown for source in sources])
    bare = [i for i in known if kinds[i] in GROUPS["sand"]]
    things = np.concatenate(
        [rng.choice(bare, 1), rng.choice(known, rng.integers(3, 7), replace=False)]
    )
    shares = rng.dirichlet(np.ones(len(things)))
    field = np.argmax(
        [smooth_noise(rng, SHAPE, 25) + 1.5 * np.log(share) for share in shares], axis=0
    )
    light = np.exp(0.3 * smooth_noise(rng, SHAPE, 40) + 0.4 * smooth_noise(rng, SHAPE, 3) - 0.3)
    reflectance = spectra[things] ** np.exp(rng.normal(0, 0.1, (len(things), 1)))
    water = draw_water(draw_contents(kind, rng), rng)
    range_m = make_range(rng, SHAPE, ("slope", "deep", "slope")[seed % 3])
    weakest = float(np.max(-np.log(water.attenuation(np.array(1.0)))))
    range_m *= np.float32(
        min(1.0, rng.uniform(0.5, MOST_OPTICAL_DEPTH) / (weakest * np.quantile(range_m, 0.95)))
    )
    direct = np.empty((*SHAPE, 3))
    for thing, spectrum in enumerate(reflectance):
        here = field == thing
        left = np.exp(-range_m[here][:, None] * water.beam) * spectrum * water.light
        direct[here] = left @ water.bands.T
    linear = direct * light[..., None] + water.backscatter(range_m)
    gain = rng.uniform(0.6, 1.0) / np.quantile(linear.max(axis=-1), 0.999)
    exposed = linear * gain
    noisy = exposed + rng.standard_normal(exposed.shape) * np.sqrt(
        exposed / rng.uniform(4000, 20000) + 0.001**2
    )
    image = np.round(encode_srgb(np.clip(noisy, 0, 1)) * 255).astype(np.uint8)
    truth = (reflectance @ water.bands.T)[field] * light[..., None]
    names = np.array([kinds[i] for i in things])[field]
    scaled = SpectralWater(water.bands, water.light * gain, water.beam, water.veil * gain)
    return Scene(image, range_m.astype(np.float32), exposed, truth, names, scaled)


def judged(scene: Scene) -> tuple[dict[str, float], np.ndarray, np.ndarray]:
    """Median angles of the true color of each group; error of the logarithm of the white point's
    color, and its standard error.
    """
    water = robust.fit(measure(scene.image, scene.range_m), ColorConfig())
    left = water.white * water.attenuation(scene.range_m.astype(np.float64))
    found = (
        np.maximum(scene.linear - water.backscatter(scene.range_m.astype(np.float64)), 1e-6) / left
    )
    angles = angle_deg(
        encode_srgb(found / found.max()), encode_srgb(scene.truth / scene.truth.max())
    )
    groups = {
        name: float(np.median(angles[inside]))
        for name, words in GROUPS.items()
        if (
            inside := np.isin(
                scene.kind, [k for k in np.unique(scene.kind) if any(word in k for word in words)]
            )
        ).sum()
        > 500
    }
    off = np.log(water.white / scene.water.white)
    error = water.standard_errors["white"] / water.white
    return groups, off - off.mean(), error


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--waters", type=int, default=30, help="in all; a third of each kind")
    parser.add_argument("--first-seed", type=int, default=0)
    asked = parser.parse_args()
    seeds = range(asked.first_seed, asked.first_seed + asked.waters // len(KINDS))
    results = []
    for shown in SPLIT:
        with prior_without(shown):
            results += [
                (kind, *judged(drawn(shown, kind, seed)))
                for kind, seed in itertools.product(KINDS, seeds)
            ]
    print("Angle to the true color in degrees: median over scenes of the median over pixels\n")
    print("| | " + " | ".join((*KINDS, "all")) + " |\n|" + " --- |" * (len(KINDS) + 2))
    for group in GROUPS:
        cells = [
            [
                angles[group]
                for kind, angles, *_ in results
                if group in angles and of in (kind, "all")
            ]
            for of in (*KINDS, "all")
        ]
        print(f"| {group} | " + " | ".join(f"{np.median(cell):.1f}" for cell in cells) + " |")
    off, error = (np.array([result[i] for result in results]) for i in (2, 3))
    print(
        f"\n95 % intervals of the white point hold for {(np.abs(off) < 1.96 * error).mean():.0%} "
        f"of channels of {len(off)} scenes"
    )
    for name, values in (("off by, rms", off), ("stated", error)):
        print(
            f"{name}: R, G, B "
            f"{', '.join(f'{100 * value:.0f} %' for value in np.sqrt((values**2).mean(axis=0)))}"
        )


if __name__ == "__main__":
    main()
