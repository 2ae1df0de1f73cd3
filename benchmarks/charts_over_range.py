"""Why do patches of equal charts differ after correction on frame 3374 of Sea-thru? Drawn scenes in
its place, with its ranges and its four charts.

    python benchmarks/charts_over_range.py [--seeds 3] [--data FOLDER]

Each scene lies in blue ocean water, and is corrected by the water that is fitted to it. Scenes are
alike at all ranges, or warm near and blue far; the camera encodes in sRGB, or by a steeper curve,
as of a picture that was made to please. Printed: by how much a patch differs between ranges, as on
the real frame, which is printed first.
"""

import numpy as np
from arguments import add_data, parser_of
from color_cases import make_truth

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.extras.evaluation.charts.chart_spread import seen_chart, spread_over_charts
from stereo_seecolor.extras.evaluation.charts.targets import Target, targets_of
from stereo_seecolor.extras.evaluation.measures import clipped
from stereo_seecolor.extras.synthetic.waters import lit_water
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.inputs.images import read_image, read_range_map

WARM_NEAR = np.array([-0.12, 0.0, 0.06])
"""Logarithm of reflectance per meter: what the fit to the real frame finds above what its charts
show (docs/lab/color.md).
"""
DEPTH_M = 5.0


def pleasing(encoded: np.ndarray) -> np.ndarray:
    """An S-shaped curve, as converters of raw files have: slope 1.5 in the middle."""
    return encoded + 0.5 * encoded * (1 - encoded) * (2 * encoded - 1) * 2


CURVES = {"sRGB": lambda encoded: encoded, "S-shaped": pleasing}


def drawn(seed: int, range_m: np.ndarray, charts: list[Target], tint: float, curve) -> np.ndarray:
    """The picture (H, W, 3) uint8. tint: fraction of WARM_NEAR."""
    rng = np.random.default_rng([91, seed])
    z = np.where(np.isfinite(range_m), range_m, np.nanmax(range_m)).astype(np.float64)
    truth = make_truth(rng, z.shape, rng.random(z.shape), False)
    truth = truth * np.exp(tint * WARM_NEAR * (z[..., None] - np.median(z)))
    for target in charts:
        for patch, color in zip(target.patches, target.type.srgb, strict=True):
            truth[patch] = decode_srgb(color)
    water = lit_water("blue-ocean", DEPTH_M, DEPTH_M - 1, 1.5).water
    light = truth * water.white * water.attenuation(z) + water.backscatter(z)
    light = light * 0.9 / np.quantile(light.max(axis=-1), 0.995)
    shown = curve(encode_srgb(np.clip(light, 0, 1))) + rng.normal(0, 1 / 255, light.shape)
    return np.round(np.clip(shown, 0, 1) * 255).astype(np.uint8)


def spread_deg(image: np.ndarray, result: np.ndarray, range_m, charts: list[Target]) -> float:
    """By how much a patch differs between ranges."""
    full = clipped(image / 255.0)
    seen = [seen_chart("", target, result, range_m, full) for target in charts]
    return spread_over_charts([chart for chart in seen if chart])[0].angle_deg


def both(image: np.ndarray, range_m: np.ndarray, charts: list[Target]) -> tuple[float, float]:
    """The spread of the picture as it is, and corrected."""
    corrector = Corrector(ColorConfig())
    done = corrector.apply(image, range_m, corrector.fit_frame(image, range_m))
    result = np.where(done.unknown[..., None], np.nan, done.image / 255.0)
    pictures = image / 255.0, result
    return tuple(spread_deg(image, picture, range_m, charts) for picture in pictures)


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    add_data(parser)
    asked = parser.parse_args()
    image = read_image(asked.data / "seathru/3374.png")
    range_m = read_range_map(asked.data / "seathru/3374_range.tiff")
    charts = targets_of([], image, range_m)
    print("| scene | curve | raw | corrected |\n|---|---|---|---|")
    print("| frame 3374, real | unknown | {:.1f} | {:.1f} |".format(*both(image, range_m, charts)))
    for tint, scene in (
        (0.0, "alike at all ranges"),
        (0.5, "half as warm near"),
        (1.0, "warm near"),
    ):
        for name, curve in CURVES.items():
            pictures = (drawn(seed, range_m, charts, tint, curve) for seed in range(asked.seeds))
            found = np.mean([both(picture, range_m, charts) for picture in pictures], axis=0)
            row = "| synthetic, {} | {} | {:.1f} | {:.1f} |".format(scene, name, *found)
            print(row, flush=True)


if __name__ == "__main__":
    main()
