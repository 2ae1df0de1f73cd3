"""Frames a second of the torch path (``--device``) on the device that is there, beside the
compiled one: the same numbers.

    python benchmarks/device.py [--size 1280 1024] [--device cpu] [--batches 1 4 16]

count: colors over range, into a table. apply: the water taken out. A batch is that many frames of
one water and one exposure, row under row: their table is that of their sum, so what asks for a
table or an exposure of each frame cannot be batched. Fitting works on a table, on the processor
wherever the pixels are. Pixels go to the device and back for each batch, as in a run for each
frame.
"""

import statistics
import time
from collections.abc import Callable
from functools import partial

import color_speed
import numpy as np
import torch
from arguments import parser_of

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.device import find_device
from stereo_seecolor.device import memory_on
from stereo_seecolor.device.color import DeviceCorrector

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
    parser = parser_of(__doc__)
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
    both = Corrector(), DeviceCorrector(memory_on(device.type))
    tables = [corrector.measure(image, range_m) for corrector in both]
    water = both[0].fit(tables[0])

    def apply(corrector: Corrector) -> np.ndarray:
        return corrector.apply(image, range_m, water, exposure=1.3, highlights=2.0).image

    most = np.abs(apply(both[0]).astype(int) - apply(both[1]).astype(int)).max()
    equal = np.array_equal(tables[0].counts, tables[1].counts)
    print(f"batches of {frames}: counts equal: {equal}; corrected values differ by at most {most}")
    for name, way in {"count": lambda c: c.measure(image, range_m), "apply": apply}.items():
        by_loop, by_torch = (frames * batches_a_second(partial(way, each)) for each in both)
        print(f"    {name}: compiled {by_loop:.1f}, torch {by_torch:.1f} frames a second")


if __name__ == "__main__":
    main()
