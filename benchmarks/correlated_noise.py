"""How true standard errors of ranges are in images whose noise was denoised, compressed or blurred.

    python benchmarks/correlated_noise.py [SEED ...]

Robust spread of (range - truth) / standard error over pixels away from steps, without and with the
factor of the pair, of synthetic dives in three waters, by day and night, with more and less noise.
Seeds 301 to 308 were used to choose what is measured and its limit, 401 to 408 and 501 to 506 to
judge it; these are the default.
"""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from arguments import words_of

from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.extras.synthetic.render import RenderedPair, Scene
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.extras.synthetic.waters import WATER_NAMES
from stereo_seecolor.matching.gray import gray
from stereo_seecolor.matching.matcher import Matcher
from stereo_seecolor.matching.refine import error_factor
from stereo_seecolor.records import Image, Map, Mask

JUDGES = (*range(401, 409), *range(501, 507))
PAIRS = (1, 4)
STEP_PX, STEP_REACH_PX = 1.0, 17
"""Disparities that differ by more between neighbors are a step; it reaches over so many pixels."""


def jpeg(quality: int) -> Callable[[Image], Image]:
    def compressed(image: Image) -> Image:
        encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR))

    return compressed


def demosaiced(image: Image) -> Image:
    mosaic = image[..., 1].copy()
    mosaic[::2, ::2], mosaic[1::2, 1::2] = image[::2, ::2, 0], image[1::2, 1::2, 2]
    return np.asarray(cv2.cvtColor(mosaic, cv2.COLOR_BayerRGGB2RGB))


def blurred(sigma_px: float) -> Callable[[Image], Image]:
    return lambda image: np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px))


PROCESSING: dict[str, Callable[[Image], Image]] = {
    "as drawn": lambda image: image,
    "non-local means": lambda image: np.asarray(
        cv2.fastNlMeansDenoisingColored(image, None, 5, 5, 5, 15)
    ),
    "bilateral": lambda image: np.asarray(cv2.bilateralFilter(image, 5, 15, 2)),
    "median of 3x3": lambda image: np.asarray(cv2.medianBlur(image, 3)),
    "JPEG 40": jpeg(40),
    "JPEG 75": jpeg(75),
    "JPEG 95": jpeg(95),
    "demosaiced": demosaiced,
    "blur 0.7 px": blurred(0.7),
    "blur 1 px": blurred(1.0),
}


def spec_of(seed: int) -> SurveySpec:
    """A dive: its water, altitude, relief, tilt, light and noise follow from the seed."""
    rng = np.random.default_rng([seed, 99])
    lowest_m = rng.uniform(1.1, 2.0)
    return SurveySpec(
        seed=seed,
        pairs=6,
        lines=1,
        water=WATER_NAMES[seed % 3],
        altitude_m=(lowest_m, lowest_m + rng.uniform(0, 0.8)),
        relief_m=rng.uniform(0.15, 0.45),
        tilt_deg=rng.uniform(0, 20),
        full_well_e=(12_000.0, 6_000.0, 3_000.0, 20_000.0)[seed % 4],
        read_noise_e=rng.uniform(4, 12),
        lamp_intensity=0.0 if seed % 5 else 200.0,
        vignette=0.3 if seed % 2 else 0.0,
    )


def away_from_steps(disparity: Map) -> Mask:
    known = np.nan_to_num(disparity, nan=-99).astype(np.float32)
    near, wide = (np.ones((side, side), np.uint8) for side in (3, STEP_REACH_PX))
    step = cv2.dilate(known, near) - cv2.erode(known, near) > STEP_PX
    return np.asarray(~cv2.dilate(step.astype(np.uint8), wide).astype(np.bool_))


def spreads(scene: Scene, drawn: RenderedPair, process: Callable[[Image], Image]) -> list[float]:
    """The robust spread without the factor of the pair, and with it."""
    apply, pair = scene.rectification, scene.rectification.pair
    left = apply.apply_left(process(drawn.frame.left))
    right = apply.apply_right(process(drawn.frame.right))
    found = Matcher(pair, MatchingConfig()).match(replace(drawn.frame, left=left, right=right))
    truth = drawn.range_map
    judged = drawn.visible & ~drawn.moving & away_from_steps(truth.disparity)
    z = ((found.range_m - truth.range_m) / found.range_std_m)[judged]
    spread = 1.4826 * float(np.nanmedian(np.abs(z - np.nanmedian(z))))
    return [spread * error_factor(gray(left), gray(right), found.disparity), spread]


def main() -> None:
    rows = defaultdict(list)
    for seed in [int(word) for word in words_of(__doc__, "SEED")] or JUDGES:
        scene = Scene.from_spec(spec_of(seed))
        pairs = [scene.render(index) for index in PAIRS]
        for name, process in PROCESSING.items():
            rows[name].append(np.mean([spreads(scene, pair, process) for pair in pairs], axis=0))
    print(f"{'':16} without: median (least, largest) dive; with")
    for name, dives in rows.items():
        numbers = np.percentile(dives, (50, 0, 100), axis=0).T
        without, corrected = (f"{a:.2f} ({b:.2f}, {c:.2f})" for a, b, c in numbers)
        print(f"{name:16} {without}; {corrected}", flush=True)


if __name__ == "__main__":
    main()
