"""Make the prior's colors of the sea floor, scene_colors.json, from published reflectance spectra.

``reflectances.csv`` holds the spectra with their sources. Scenes are mixed from them and seen,
without water, by drawn cameras, which are those of the prior of the water.
"""

import argparse
import csv
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting.scene_colors import COLORS, SceneColors
from stereo_seecolor.color.fitting.water_prior import WAVELENGTH_NM, random_camera
from stereo_seecolor.color.table.range_quantiles import FRACTIONS

Array = NDArray[np.float64]
SPECTRA = Path(__file__).with_name("reflectances.csv")


@dataclass(frozen=True)
class Scenes:
    """How spectra are mixed to scenes."""

    number: int = 1024
    """Twice as many move no mean by a twentieth of its standard deviation."""
    pixels: int = 1024
    """Of a scene: its darkest quantile is the third of them."""
    kinds: int = 8
    """Kinds of things in a scene, 1 to this many, each with a share that may be any (Dirichlet)."""
    pigment: float = 0.2
    """Standard deviation of the logarithm of the power of a reflectance: more or less of the same
    pigment (Beer's law).
    """
    brightness: float = 0.4
    """Standard deviation of the logarithm of a thing's brightness from scene to scene, and of its
    places within one.
    """
    shade: float = 0.5
    """Standard deviation of the logarithm of the light of a place."""


SCENES = Scenes()


def read_spectra() -> tuple[list[str], list[str], Array]:
    """Kinds, sources, and reflectances (N, 31) at ``WAVELENGTH_NM`` of the table of spectra."""
    head, *rows = csv.reader(
        line for line in SPECTRA.read_text().splitlines() if not line.startswith("#")
    )
    nm = np.array(head[3:], np.float64)
    spectra = [np.interp(WAVELENGTH_NM, nm, np.array(row[3:], np.float64)) for row in rows]
    return [row[0] for row in rows], [row[1] for row in rows], np.array(spectra)


def mixed(without: frozenset[str] = frozenset()) -> SceneColors:
    """The colors of scenes that are mixed from all spectra but those of some sources."""
    kinds, sources, spectra = read_spectra()
    kept = np.array([source not in without for source in sources])
    _, kind_of = np.unique(np.array(kinds)[kept], return_inverse=True)
    rng = np.random.default_rng(1)
    logs = np.array(
        [
            np.log(np.quantile(_scene(spectra[kept], kind_of, rng), FRACTIONS, axis=0).T)
            for _ in range(SCENES.number)
        ]
    )
    colors = logs - logs.mean(axis=1, keepdims=True)
    each = np.mean([np.cov(colors[:, :, p].T) for p in range(FRACTIONS.size)], axis=0)
    warm = np.array([1.0, 0.0, -1.0]) / np.sqrt(2)
    return SceneColors(
        colors.mean(axis=0), each / (warm @ each @ warm), np.cov(colors.mean(axis=2).T)
    )


def _scene(spectra: Array, kind_of: NDArray[np.intp], rng: np.random.Generator) -> Array:
    """(pixels, 3) linear light of a scene of some kinds of things, each by one of its spectra;
    white is 1.
    """
    chosen = rng.permutation(kind_of.max() + 1)[: rng.integers(1, SCENES.kinds + 1)]
    things = np.array([rng.choice(np.flatnonzero(kind_of == kind)) for kind in chosen])
    power = np.exp(rng.normal(0, SCENES.pigment, (len(things), 1)))
    colors = spectra[things] ** power @ random_camera(rng.random(4)).T
    colors *= np.exp(rng.normal(0, SCENES.brightness, (len(things), 1)))
    of = rng.choice(len(things), SCENES.pixels, p=rng.dirichlet(np.ones(len(things))))
    light = rng.normal(0, np.hypot(SCENES.brightness, SCENES.shade), (SCENES.pixels, 1))
    return np.asarray(colors[of] * np.exp(light))


def main() -> None:
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    made = mixed()
    content = {
        name: np.round(getattr(made, name), 4).tolist() for name in ("mean", "channels", "cast")
    }
    about = {"made by": "benchmarks/spectra.py of reflectances.csv"}
    COLORS.write_text(json.dumps(about | content, indent=1) + "\n")


if __name__ == "__main__":
    main()
