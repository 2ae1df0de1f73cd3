"""Frames a second of the torch path (``color.device``) on the device that is there, beside the
compiled one: the same numbers.

    python benchmarks/device.py [--size 1280 1024] [--device cpu] [--batches 1 4 16]

count: colors over range, into a table. apply: the water taken out. A batch is that many frames of
one water and one exposure, row under row: their table is that of their sum, so what asks for a
table or an exposure of each frame cannot be batched. Fitting works on a table, on the processor
wherever the pixels are. Pixels go to the device and back for each batch, as in a run for each
frame.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from functools import partial

import color_speed
import numpy as np
import torch

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.device import find_device
from stereo_seecolor.color.render import torch_apply
from stereo_seecolor.color.render.tone import display, gains
from stereo_seecolor.color.table import torch_counting
from stereo_seecolor.color.table.measure import VALUE_BINS, measure
from stereo_seecolor.color.table.moment_table import range_bits

ROUNDS = 7


def batches_a_second(work: Callable[[], object]) -> float:
    """The median of some rounds, after one to warm up."""
    work()
    seconds = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return 1 / statistics.median(seconds)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 1024))
    parser.add_argument("--batches", type=int, nargs="+", default=(1, 4, 16))
    parser.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    options = parser.parse_args()
    color_speed.SIZE = (options.size[1], options.size[0])
    device, name = find_device(options.device), "processor"
    if device.type == "cuda":
        name = torch.cuda.get_device_name()
    print(f"{device} ({name}), {options.size[0]}x{options.size[1]}")
    image, range_m = color_speed.frame(0)
    for frames in options.batches:
        compare(
            np.concatenate([image] * frames), np.concatenate([range_m] * frames), frames, device
        )


def compare(image: np.ndarray, range_m: np.ndarray, frames: int, device: torch.device) -> None:
    """Print how fast both are on a batch, and whether they agree."""
    corrector = Corrector()
    table = corrector.measure(image, range_m)
    by_range, shown = gains(corrector.fit(table), corrector.config, 1.3), display(8, "srgb", 2.0)
    flat, bits, values = image.reshape(-1, 3), range_bits(range_m), VALUE_BINS[8]
    compiled = (
        partial(measure, image, range_m),
        partial(torch_apply.on_processor, flat, bits, by_range, shown),
    )
    in_torch = (
        partial(torch_counting.count, image, range_m, values, device),
        partial(torch_apply.apply, flat, bits, by_range, shown, device),
    )
    most = np.abs(compiled[1]()[0].image.astype(int) - in_torch[1]()[0].image.astype(int)).max()
    equal = np.array_equal(in_torch[0]()[0], compiled[0]().counts)
    print(f"batches of {frames}: counts equal: {equal}; corrected values differ by at most {most}")
    for name, ways in zip(("count", "apply"), zip(compiled, in_torch, strict=True), strict=True):
        by_loop, by_torch = (frames * batches_a_second(way) for way in ways)
        print(f"    {name}: compiled {by_loop:.1f}, torch {by_torch:.1f} frames a second")


if __name__ == "__main__":
    main()
