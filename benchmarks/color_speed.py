"""Seconds of the color stage at 1952x1242, 8 bit: measure, fit, apply; and apply where highlights
roll off, and where besides noise stops the gain in a quarter of the pixels.

python benchmarks/color_speed.py
"""

import statistics
import time
from collections.abc import Callable

import numpy as np
from arguments import words_of

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import Image, Map, Water

SIZE = (1242, 1952)
FRAMES = 20


def frame(seed: int) -> tuple[Image, Map]:
    """A noisy scene through known water: slopes and steps in range, a tenth of it unknown."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float32)
    range_m = (
        2.5 + 1.2 * np.sin(x / 300 + seed) + y / 800 + 0.5 * (np.sin(x / 90) * np.sin(y / 70) > 0.6)
    ).astype(np.float32)
    range_m[
        np.kron(rng.random((SIZE[0] // 8 + 1, SIZE[1] // 8 + 1)) < 0.1, np.ones((8, 8), bool))[
            : SIZE[0], : SIZE[1]
        ]
    ] = np.nan
    scene = (
        0.35
        + 0.25 * np.sin(x / 37 + np.arange(3)[:, None, None]) * np.cos(y / 53)
        + rng.normal(0, 0.02, (3, *SIZE))
    )
    rate, veil = np.array([0.45, 0.12, 0.09]), np.array([0.02, 0.1, 0.14])
    z = np.nan_to_num(range_m, nan=3.0)[..., None]
    light = scene.transpose(1, 2, 0) * np.exp(-rate * z) * [0.5, 0.9, 1.0] + veil * (
        1 - np.exp(-0.3 * z)
    )
    noisy = np.clip(light, 0, 1) ** (1 / 2.2) + rng.normal(0, 0.006, (*SIZE, 3))
    return np.clip(noisy * 255 + 0.5, 0, 255).astype(np.uint8), range_m


def timed(what: Callable[[], object], times: int) -> str:
    """Median and least of some calls, after one to warm up; the third number is the time the cores
    worked.
    """
    what()
    walls, works = [], []
    for _ in range(times):
        wall, work = time.perf_counter(), time.process_time()
        what()
        walls.append(1e3 * (time.perf_counter() - wall))
        works.append(1e3 * (time.process_time() - work))
    return f"{statistics.median(walls):8.2f} {min(walls):8.2f} {statistics.median(works):8.2f}"


def report(corrector: Corrector) -> None:
    (image, range_m), following = frame(0), frame(1)
    name = corrector.config.method
    table, next_table = corrector.measure(image, range_m), corrector.measure(*following)
    water = corrector.fit(table)

    def whole(start: Water | None) -> None:
        table = corrector.measure(*following)
        corrector.apply(*following, corrector.fit(table, start), table)

    def many(start: Water | None) -> None:
        for _ in Threads(cores()).each(lambda _: whole(start), range(FRAMES)):
            pass

    print(f"{name:7} measure               {timed(lambda: corrector.measure(image, range_m), 25)}")
    print(f"{name:7} fit, cold             {timed(lambda: corrector.fit(table), 15)}")
    print(f"{name:7} fit, warm             {timed(lambda: corrector.fit(next_table, water), 25)}")
    print(
        f"{name:7} apply                 "
        f"{timed(lambda: corrector.apply(image, range_m, water, table), 25)}"
    )
    shown = corrector.apply(image, range_m, water, table).exposure
    print(
        f"{name:7} apply, rolled off     "
        f"{timed(lambda: corrector.apply(image, range_m, water, table, shown, 2.0), 25)}"
    )
    print(
        f"{name:7} apply, a quarter dim  "
        f"{timed(lambda: corrector.apply(image, range_m, water, table, 2.5 * shown, 2.5), 25)}"
    )
    print(f"{name:7} all three, cold       {timed(lambda: whole(None), 15)}")
    print(f"{name:7} all three, warm       {timed(lambda: whole(water), 25)}")
    print(f"{name:7} {FRAMES} frames, one a core {timed(lambda: many(water), 5)}")


def main() -> None:
    print(f"{SIZE[1]}x{SIZE[0]}, 8 bit, milliseconds    median    least  of CPU")
    for method in ("robust", "paper"):
        report(Corrector(ColorConfig(method=method)))


if __name__ == "__main__":
    words_of(__doc__)
    main()
