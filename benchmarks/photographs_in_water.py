"""Photographs under drawn waters of measured absorption and scattering: tables of
docs/lab/color.md, on any photographs.

    python benchmarks/photographs_in_water.py PHOTOGRAPHS --range RANGES [--draws 4] [--first-seed
    0] [--all-methods]

PHOTOGRAPHS: a folder of pictures taken in air, which are the truth. RANGES: a folder of range maps
with their names (float TIFF in meters or 16-bit PNG in millimeters, other sizes are resized); a
photograph without one gets a drawn relief. Medians over pixels and pictures of the angle to the
truth in degrees, in brackets after the best gain a channel. Three tables: methods; which part of
the water an error comes from (the true part in place of the fitted one); and how far off each part
is, its bias and its scatter.
"""

import argparse
import itertools
from pathlib import Path

import cv2
import numpy as np
from color_cases import Case, make_range
from color_quality import METHODS_COMPARED, true_water
from independent_waters import KINDS, seen
from measured_waters import Kind

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.extras.evaluation.measures import angle_deg, clipped
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.inputs.images import read_range_map

OPTICAL_DEPTHS = ((0.25, 0.5), (0.5, 1.0), (1.0, 3.0))
"""Of the weakest channel at the far end."""
SHOWN = ("gray world", "half of it, 8-norm log-linear", "the paper's objective", "stereo-seecolor")
SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
PARTS = ("backscatter", "attenuation", "white")
ERRORS = (
    "backscatter, of white at its range",
    "attenuation, all channels",
    "attenuation, color",
    "white",
)
LARGEST = 400
"""Pixels of the longer side."""
DARKEST = 0.06
"""As in ``score_truth``."""


def photographs(
    folder: Path, ranges: Path | None
) -> list[tuple[str, np.ndarray, np.ndarray | None]]:
    """Name, (H, W, 3) linear light and (H, W) range in meters, or None where there is no range
    map.
    """
    found = []
    for path in sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES):
        pixels = cv2.imread(str(path))
        scale = min(1.0, LARGEST / max(pixels.shape[:2]))
        pixels = cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        maps = sorted(ranges.glob(f"{path.stem}.*")) if ranges else []
        range_m = None
        if maps:
            range_m = cv2.resize(
                read_range_map(maps[0]), pixels.shape[1::-1], interpolation=cv2.INTER_NEAREST
            )
        found.append((path.stem, decode_srgb(pixels[..., ::-1] / 255.0), range_m))
    return found


def cases_of(
    pictures: list[tuple[str, np.ndarray, np.ndarray | None]],
    kind: Kind,
    seeds: range,
    depth: tuple[float, float],
) -> list[Case]:
    """Every picture in a water of its own for each seed."""
    cases = []
    for (name, truth, measured_m), seed in itertools.product(pictures, seeds):
        rng = np.random.default_rng([79, seed, KINDS.index(kind), *name.encode()])
        range_m = (
            make_range(rng, truth.shape[:2], ("slope", "deep")[seed % 2])
            if measured_m is None
            else measured_m
        )
        cases.append(seen(name, truth, range_m, kind, rng, depth))
    return cases


def score(case: Case, result: np.ndarray) -> tuple[float, float]:
    """Median angle, and after the best gain a channel, of pixels that are neither dark nor
    clipped.
    """
    truth = encode_srgb(case.truth / np.quantile(case.truth.max(axis=-1), 0.995))
    seen_well = (
        (case.image < 254).all(axis=-1)
        & np.isfinite(case.range_m)
        & np.isfinite(result).all(axis=-1)
    )
    counted = seen_well & (truth.max(axis=-1) >= DARKEST) & ~clipped(truth)
    truth, found = truth[counted], np.maximum(result[counted], 1e-4)
    gained = found * np.median(truth / found, axis=0)
    return float(np.nanmedian(angle_deg(found, truth))), float(
        np.nanmedian(angle_deg(gained, truth))
    )


def corrected(case: Case, fitted, parts: frozenset[str]) -> np.ndarray:
    """By the fitted water, with the true one's parts of these names."""
    of = {part: case.water if part in parts else fitted for part in PARTS}
    direct = np.maximum(
        decode_srgb(case.image / 255.0) - of["backscatter"].backscatter(case.range_m), 0
    )
    color = direct / (of["attenuation"].attenuation(case.range_m) * of["white"].white)
    return encode_srgb(np.minimum(color / np.nanquantile(color.max(axis=-1), 0.995), 4))


def errors(case: Case, fitted) -> np.ndarray:
    """(4, 3) fitted less true, R, G, B: backscatter at the median range, of white there; the
    logarithm of what attenuation leaves at the far end against the near end, all channels together;
    the rest of it in each; the logarithm of the white point's color.
    """
    near_m, median_m, far_m = np.nanquantile(case.range_m, [0.05, 0.5, 0.95])
    white_there = case.water.white * case.water.attenuation(median_m)
    backscatter = (fitted.backscatter(median_m) - case.water.backscatter(median_m)) / white_there
    ends_m = np.array([near_m, far_m])
    left = np.diff(np.log(fitted.attenuation(ends_m) / case.water.attenuation(ends_m)), axis=0)[0]
    white = np.log(fitted.white / case.water.white)
    return np.stack(
        [backscatter, np.full(3, left.mean()), left - left.mean(), white - white.mean()]
    )


def row(name: str, scores: list[list[tuple[float, float]]]) -> None:
    medians = [np.median(of_kind, axis=0) for of_kind in scores]
    print(
        f"| {name} | "
        + " | ".join(f"{angle:.1f} ({gained:.1f})" for angle, gained in medians)
        + " |",
        flush=True,
    )


def head(title: str, first: str) -> None:
    print(
        f"\n### {title}\n\n| {first} | " + " | ".join(KINDS) + " |\n|" + " --- |" * (len(KINDS) + 1)
    )


def tables(cases: dict[Kind, list[Case]], methods: dict, title: str) -> None:
    """The three tables of the cases of each kind of water."""
    head(title, "method")
    for name, method in methods.items():
        row(name, [[score(case, method(case)) for case in cases[kind]] for kind in KINDS])
    corrector = Corrector(ColorConfig())
    fits = {
        kind: [corrector.fit_frame(case.image, case.range_m) for case in cases[kind]]
        for kind in KINDS
    }
    head(f"{title}: true parts", "true")
    for parts in (
        (),
        ("backscatter",),
        ("attenuation",),
        ("white",),
        ("backscatter", "attenuation"),
        PARTS,
    ):
        swapped = [
            [
                score(c, corrected(c, w, frozenset(parts)))
                for c, w in zip(cases[k], fits[k], strict=True)
            ]
            for k in KINDS
        ]
        row(", ".join(parts) or "none", swapped)
    head(f"{title}: by how much parts are off, percent, median +- scatter, R, G, B", "part")
    off = {
        kind: np.array([errors(c, w) for c, w in zip(cases[kind], fits[kind], strict=True)])
        for kind in KINDS
    }
    for i, part in enumerate(ERRORS):
        cells = [
            ", ".join(f"{100 * np.median(e):+.0f} +- {100 * spread(e):.0f}" for e in of[:, i].T)
            for of in off.values()
        ]
        print(f"| {part} | " + " | ".join(cells) + " |", flush=True)


def spread(values: np.ndarray) -> float:
    """Standard deviation, from quartiles."""
    return float(np.subtract(*np.quantile(values, [0.75, 0.25])) / 1.35)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("photographs", type=Path)
    parser.add_argument("--range", type=Path)
    parser.add_argument(
        "--draws", type=int, default=4, help="waters of each kind for each photograph"
    )
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--all-methods", action="store_true")
    asked = parser.parse_args()
    pictures = photographs(asked.photographs, asked.range)
    methods = {
        name: method
        for name, method in METHODS_COMPARED.items()
        if asked.all_methods or name in SHOWN
    }
    methods["the true water"] = true_water
    seeds = range(asked.first_seed, asked.first_seed + asked.draws)
    for depth in OPTICAL_DEPTHS:
        cases = {kind: cases_of(pictures, kind, seeds, depth) for kind in KINDS}
        title = f"optical depth {depth[0]:g} to {depth[1]:g}, {len(cases['ocean'])} pictures a kind"
        tables(cases, methods, title)


if __name__ == "__main__":
    main()
