"""Every color method in waters that stem from no table of Jerlov's: the judging set of
docs/lab/color.md.

    python benchmarks/independent_waters.py [--cases 24] [--first-seed 0] [--data FOLDER]

Scenes: those of color_cases.py, and photographs with their geometry. Waters: synthetic/waters.py.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from arguments import add_data
from color_cases import Case, make_range, make_truth
from color_quality import METHODS_COMPARED, pictures, score, true_water
from measured_waters import Kind, draw_contents, draw_water

from stereo_seecolor.files.srgb import encode_srgb

KINDS: tuple[Kind, ...] = ("ocean", "coast", "harbor")


def seen(
    name: str,
    truth: np.ndarray,
    range_m: np.ndarray,
    kind: Kind,
    rng: np.random.Generator,
    most_optical_depth: tuple[float, float] = (1.0, 3.0),
) -> Case:
    """A scene under a water of a kind by an 8-bit camera with its noise, moved nearer where its
    water is too much to see through.

    most_optical_depth: of the weakest channel over 1 m, times the far end's range; drawn between
    these.
    """
    water = draw_water(draw_contents(kind, rng), rng)
    weakest = float(np.max(-np.log(water.attenuation(np.array(1.0)))))
    range_m = range_m * np.float32(
        min(1.0, rng.uniform(*most_optical_depth) / (weakest * np.nanquantile(range_m, 0.95)))
    )
    linear = truth * water.white * water.attenuation(range_m) + water.backscatter(range_m)
    exposed = linear * rng.uniform(0.6, 1.0) / np.nanquantile(linear.max(axis=-1), 0.995)
    exposed = np.nan_to_num(exposed)
    noisy = exposed + rng.standard_normal(exposed.shape) * np.sqrt(
        exposed / rng.uniform(4000, 20000) + 0.002**2
    )
    image = np.round(encode_srgb(np.clip(noisy, 0, 1)) * 255).astype(np.uint8)
    return Case(
        f"{name} {kind}", image, range_m.astype(np.float32), truth, scaled(water, exposed, linear)
    )


def scaled(water, exposed, linear):
    """The water in the picture's own units."""
    known = np.isfinite(linear) & (linear > 0)
    gain = float(np.median(exposed[known] / linear[known]))
    return type(water)(water.bands, water.light * gain, water.beam, water.veil * gain)


def drawn(kind: Kind, first: int, number: int) -> Iterator[Case]:
    for seed in range(first, first + number):
        rng = np.random.default_rng([77, seed])
        range_m = make_range(rng, (240, 320), ("flat", "slope", "deep")[seed % 3])
        yield seen(
            f"drawn {seed}",
            make_truth(rng, (240, 320), range_m, bool(seed % 2)),
            range_m,
            kind,
            rng,
        )


def photographs(data: Path, kind: Kind, number: int) -> Iterator[Case]:
    for name, truth, range_m in pictures(data):
        for seed in range(number):
            yield seen(name, truth, range_m * 2, kind, np.random.default_rng([78, seed]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--first-seed", type=int, default=0)
    add_data(parser)
    parser.add_argument("--methods", default="", help="only methods whose name holds this")
    asked = parser.parse_args()
    methods = {
        name: method for name, method in METHODS_COMPARED.items() if asked.methods in name
    } | {"the true water": true_water}
    sets = {"synthetic scenes": lambda kind: drawn(kind, asked.first_seed, asked.cases)}
    if asked.data.is_dir():
        sets["photographs"] = lambda kind: photographs(asked.data, kind, max(asked.cases // 4, 1))
    for title, cases_of in sets.items():
        cases = {kind: list(cases_of(kind)) for kind in KINDS}
        print(
            f"\n### {title}: {len(cases['ocean'])} cases a kind; angle to truth in degrees, after "
            "gains in brackets\n"
        )
        print("| method | " + " | ".join(KINDS) + " |\n|" + " --- |" * (len(KINDS) + 1))
        for name, method in methods.items():
            scores = [
                np.mean([score(case, method(case))[:2] for case in cases[kind]], axis=0)
                for kind in KINDS
            ]
            print(
                f"| {name} | "
                + " | ".join(f"{angle:.1f} ({gained:.1f})" for angle, gained in scores)
                + " |",
                flush=True,
            )


if __name__ == "__main__":
    main()
