"""Whether the stages of a frame give the same numbers on the GPU as the compiled loops, and how
long each takes, at 2.4 megapixels.

    python benchmarks/gpu.py [--size 1936 1240] [--rounds 20] [--device cuda]

The search is compared on random images in random bands, all stages on a drawn pair. Then it prints
the latency of each stage, median and 95th percentile, and the frames a second, of one frame after
the other, reading and writing left out. Ends with 1 where numbers differ by more than stated, and
where there is no GPU: then nothing is measured. --device cpu runs the same code in torch on the
processor, which says nothing about time.
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import torch
from arguments import parser_of
from compare import machine

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.config import ColorConfig, MatchingConfig, RunConfig
from stereo_seecolor.device import memory_on, sgm
from stereo_seecolor.device.color import DeviceCorrector
from stereo_seecolor.device.matching import DeviceMatcher
from stereo_seecolor.device.rectify import Rectifier
from stereo_seecolor.extras.synthetic.dive import synthesize
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.matching.matcher import Matcher
from stereo_seecolor.matching.sgm import search as compiled
from stereo_seecolor.matching.sgm.band import LANES, TILE, Band
from stereo_seecolor.pipeline import Pipeline
from stereo_seecolor.records import StereoFrame

MOST_PX, MOST_OTHERWISE_KNOWN, MOST_VALUES = 0.1, 1e-4, 1
"""As the tests allow on torch's CPU device: disparities, fraction of the pixels, values of 255."""


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--size", type=int, nargs=2, default=(1936, 1240))
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cuda")
    options = parser.parse_args()
    if options.device == "cuda" and not torch.cuda.is_available():
        sys.exit("no GPU here: torch finds no CUDA device, and nothing was measured")
    print(machine())
    print(torch.cuda.get_device_name() if options.device == "cuda" else "torch on the processor")
    right = search_is_equal(torch.device(options.device))
    with tempfile.TemporaryDirectory() as folder:
        spec = SurveySpec(pairs=1, lines=1, image_size=tuple(options.size))
        synthesize(spec, Path(folder))
        right &= stages(Path(folder), options.device, options.rounds)
    sys.exit(not right)


def search_is_equal(device: torch.device) -> bool:
    """Compare the search with the compiled one on random images in random bands."""
    equal = True
    for seed in range(10):
        rng = np.random.default_rng(seed)
        size = int(rng.integers(4, 150)), int(rng.integers(4, 90))
        left, right = rng.integers(0, 65536, (2, *size)).astype(np.uint16)
        tiles = tuple(-(-side // TILE) for side in size)
        lowest = rng.integers(-20, 20, tiles).astype(np.int32)
        band = Band(lowest, (LANES * rng.integers(1, 4, tiles)).astype(np.int32))
        there = [torch.from_numpy(image.astype(np.float32)).to(device) for image in (left, right)]
        wanted, found = compiled.search(left, right, band), sgm.search(there[0], there[1], band)
        equal &= all(
            np.array_equal(values.cpu().numpy(), getattr(wanted, name), equal_nan=True)
            for name, values in found._asdict().items()
        )
    print(f"search in ten random bands: {'equal to the bit' if equal else 'DIFFERENT'}")
    return equal


def stages(folder: Path, device: str, rounds: int) -> bool:
    """Compare and time all stages on the pair of a drawn dive."""
    pipeline, memory = Pipeline(folder / "cam.yaml", RunConfig()), memory_on(device)
    raw = StereoFrame(
        "drawn",
        *(
            read_image(next((folder / side).iterdir()), pipeline.config.input)
            for side in ("left", "right")
        ),
    )
    geometry, ways = pipeline.rectification.matching_pair, {}
    for name in ("compiled", device):
        on_device = name != "compiled"
        rectifier = (
            Rectifier(memory, pipeline.rectification) if on_device else pipeline.rectification
        )
        matcher = (
            DeviceMatcher(memory, geometry, MatchingConfig())
            if on_device
            else Matcher(geometry, MatchingConfig())
        )
        ways[f"torch, {name}" if on_device else name] = (
            rectifier,
            matcher,
            DeviceCorrector(memory, ColorConfig()) if on_device else Corrector(),
        )
    found = {}
    for name, (rectifier, matcher, corrector) in ways.items():
        frame = StereoFrame(
            "drawn", rectifier.apply_left(raw.left), rectifier.apply_right(raw.right)
        )
        ranges = matcher.match(frame)
        water = corrector.fit(corrector.measure(frame.left, ranges.range_m))
        timed = {
            "rectify both": lambda r=rectifier: (r.apply_left(raw.left), r.apply_right(raw.right)),
            "match": partial(matcher.match, frame),
            "count colors": partial(corrector.measure, frame.left, ranges.range_m),
            "remove the water": partial(
                corrector.apply, frame.left, ranges.range_m, water, exposure=1.3
            ),
        }
        image = timed["remove the water"]().image
        found[name] = frame, ranges, image
        seconds = {stage: latencies(work, rounds) for stage, work in timed.items()}
        print(f"\n{name:24} median ms   95 % ms")
        for stage, times in seconds.items():
            print(
                f"  {stage:22} {1e3 * statistics.median(times):9.1f}"
                f" {1e3 * np.quantile(times, 0.95):9.1f}"
            )
        print(f"  {1 / sum(map(statistics.median, seconds.values())):.1f} frames a second")
    return agree(*found.values())


def latencies(work: Callable[[], object], rounds: int) -> list[float]:
    """Seconds of each round, after one to warm up, until the GPU is done."""
    seconds = []
    for turn in range(rounds + 1):
        start = time.perf_counter()
        work()
        if torch.cuda.is_available():
            torch.cuda.synchronize()
        if turn:
            seconds.append(time.perf_counter() - start)
    return seconds


def agree(wanted: tuple, found: tuple) -> bool:
    """Compare images, ranges and colors of both ways, and print how far they differ."""
    images = all(
        np.array_equal(getattr(wanted[0], side), getattr(found[0], side))
        for side in ("left", "right")
    )
    a, b = wanted[1].disparity, found[1].disparity
    known, also = np.isfinite(a), np.isfinite(b)
    otherwise, off_px = (known != also).mean(), np.abs(a - b)[known & also].max()
    values = np.abs(wanted[2].astype(int) - found[2].astype(int))[known & also].max()
    right = images and otherwise < MOST_OTHERWISE_KNOWN and off_px < MOST_PX
    right = right and values <= MOST_VALUES
    print(
        f"\nrectified images equal: {images}; disparities known in one only: {otherwise:.1e}, "
        f"at most {off_px:.3f} px apart; colors at most {values} of 255 apart: "
        + ("as stated" if right else "MORE THAN STATED")
    )
    return bool(right)


if __name__ == "__main__":
    main()
