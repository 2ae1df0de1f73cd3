"""Our matcher beside cv2.StereoSGBM 3WAY, on the synthetic reef and Teddy: python
benchmarks/matching.py [WIDTHxHEIGHT].
"""

import os
import platform
import resource
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import cv2
import numpy as np
from arguments import words_of

from calibration import RectifiedPair
from stereo_seecolor.config import MatchingConfig
from stereo_seecolor.extras.synthetic.render import Scene
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.matching.matcher import Matcher
from stereo_seecolor.records import StereoFrame

REPEATS = 5
TEDDY = Path(os.environ.get("STEREO_SEECOLOR_DATA", ".")) / "teddy"


def plain(left, right, count: int, color: bool) -> Callable[[], np.ndarray]:
    """StereoSGBM 3WAY as a good user calls it: padded on the left, block 3, left-right check,
    speckle filter.
    """
    channels = 3 if color else 1
    if not color:
        left, right = (cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in (left, right))
    sgbm = cv2.StereoSGBM.create(
        0,
        count,
        3,
        8 * channels * 9,
        32 * channels * 9,
        1,
        0,
        10,
        100,
        2,
        cv2.StereoSGBM_MODE_SGBM_3WAY,
    )

    def run() -> np.ndarray:
        padded = [
            cv2.copyMakeBorder(image, 0, 0, count, 0, cv2.BORDER_REPLICATE)
            for image in (left, right)
        ]
        found = sgbm.compute(*padded)[:, count:] / np.float32(16)
        return np.where(found >= 0, found, np.nan)

    return run


def compare(
    name: str,
    pair: RectifiedPair,
    frame: StereoFrame,
    truth: np.ndarray,
    both: np.ndarray,
    count: int,
) -> None:
    config = MatchingConfig(min_range_m=pair.focal_px * pair.baseline_m / count)
    ways = {
        "3WAY gray": plain(frame.left, frame.right, count, False),
        "3WAY color": plain(frame.left, frame.right, count, True),
        "ours": lambda: Matcher(pair, config).match(frame).disparity,
        "ours, min_confidence 0": lambda: (
            Matcher(pair, config.model_copy(update={"min_confidence": 0.0})).match(frame).disparity
        ),
        "ours, filled": lambda: (
            Matcher(pair, config.model_copy(update={"fill": True})).match(frame).disparity
        ),
    }
    seconds: dict[str, list[float]] = {way: [] for way in ways}
    for way in ways.values():
        way()
    for _ in range(REPEATS):  # in turns, so that what else the machine does hits all alike
        for way, run in ways.items():
            start = time.perf_counter()
            run()
            seconds[way].append(time.perf_counter() - start)
    for way, run in ways.items():
        disparity = run()
        known = np.isfinite(truth) & np.isfinite(disparity)
        error = np.abs(disparity - truth)
        rates = [
            100 * float((error[where] > px).mean())
            for where in (known, known & both)
            for px in (1, 2)
        ]
        fraction = 100 * known.sum() / np.isfinite(truth).sum()
        print(
            f"{name:14s} {way:24s} {1e3 * median(seconds[way]):6.0f} ms  known {fraction:5.1f} %  "
            f"bad-1 {rates[0]:5.2f}  bad-2 {rates[1]:5.2f}  | seen by both: bad-1 {rates[2]:5.2f}  "
            f"bad-2 {rates[3]:5.2f}  median error {np.median(error[known & both]):.3f} px",
            flush=True,
        )


def main() -> None:
    words = words_of(__doc__, "SIZE") or ["1280x1024"]
    size = tuple(int(n) for n in words[0].split("x"))
    print(
        f"{platform.machine()}, {cv2.getNumberOfCPUs()} cores, OpenCV {cv2.__version__}, images "
        f"{size[0]}x{size[1]}"
    )
    for water in ("blue-ocean", "coastal-green", "turbid"):
        spec = SurveySpec(
            seed=5,
            pairs=2,
            lines=1,
            image_size=size,
            water=water,
            pair_spacing_m=3.0,
            altitude_m=(2.0, 2.6),
        )
        scene = Scene.from_spec(spec)
        rendered = scene.render(0)
        truth = np.where(scene.rectification.seen_left(), rendered.range_map.disparity, np.nan)
        count = int(np.ceil(np.nanmax(truth) / 16) * 16)
        compare(
            water,
            scene.rectification.pair,
            rendered.rectified,
            truth,
            rendered.visible & ~rendered.moving,
            max(count, 128),
        )
    if TEDDY.is_dir():
        left, right = (
            cv2.imread(str(TEDDY / f"{side}.png"))[..., ::-1].copy() for side in ("left", "right")
        )
        truth = cv2.imread(str(TEDDY / "disparity_x4.pgm"), cv2.IMREAD_GRAYSCALE) / np.float32(4)
        height, width = truth.shape
        pair = RectifiedPair(500.0, width / 2, width / 2, height / 2, 0.1, (width, height))
        truth = np.where(truth > 0, truth, np.nan)
        compare(
            "Teddy",
            pair,
            StereoFrame("teddy", left, right),
            truth,
            np.ones(truth.shape, np.bool_),
            64,
        )
    print(
        "peak memory of the process "
        f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB"
    )


if __name__ == "__main__":
    main()
