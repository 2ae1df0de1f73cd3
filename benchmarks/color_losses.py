"""The paper's losses: five hundred Adam steps on every pixel against the table solver, on the same frames.

    python benchmarks/color_losses.py [FOLDER with rgb/ and range/]

For each frame: both losses where each solver ended, and the attenuation loss that the table solver reaches from the dense one's
backscatter, since the loss of a stage depends on what the stage before it took away. Then seconds at 1952x1242.
"""

import statistics
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import torch
from color_speed import frame

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.fitting import table_solver
from stereo_seecolor.color.fitting.parameters import ATTENUATION, BACKSCATTER
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.config import ColorConfig, PaperAdamConfig
from stereo_seecolor.records import Image, Map, Water

STEP = 6
"""Every sixth pixel each way, for the losses: the dense solver takes a minute a frame otherwise."""


def frames(folder: Path | None) -> list[tuple[str, Image, Map]]:
    found = [(f"synthetic {seed}", *(x[::STEP, ::STEP].copy() for x in frame(seed))) for seed in range(3)]
    for path in sorted((folder / "rgb").iterdir()) if folder else []:
        image = cv2.imread(str(path))[::STEP, ::STEP, ::-1].copy()
        range_m = cv2.imread(str(next((folder / "range").glob(f"*{path.stem}*"))), cv2.IMREAD_UNCHANGED)[::STEP, ::STEP].copy()
        found.append((path.stem, image, range_m))
    return found


def attenuation_on(table: MomentTable, water: Water) -> Water:
    """The water with its attenuation fitted anew to what its backscatter leaves."""
    columns = []
    for c, channel in enumerate(table_solver.channels(table, water.input_encoding)):
        veil = np.array([getattr(water, name)[c] for name in BACKSCATTER])
        columns.append(table_solver.fit_attenuation(channel, table_solver.direct_signal(channel, veil), None)[0])
    return replace(water, **dict(zip(ATTENUATION, np.transpose(columns), strict=True)))


def compare(corrector: Corrector, name: str, image: Image, range_m: Map) -> bool:
    table = corrector.measure(image, range_m)
    dense, fast = corrector.fit_dense(image, range_m), corrector.fit(table)
    on_dense = attenuation_on(table, dense)
    b_dense, a_dense = table_solver.losses(table, dense, corrector.config.paper.penalty)
    b_fast, a_fast = table_solver.losses(table, fast, corrector.config.paper.penalty)
    a_same = table_solver.losses(table, on_dense, corrector.config.paper.penalty)[1]
    lower = b_fast <= b_dense and a_same <= a_dense
    print(f"{name:12} {b_dense:10.5f} {b_fast:10.5f}   {a_dense:10.5f} {a_same:10.5f} {a_fast:10.5f}   {'yes' if lower else 'NO'}")
    return lower


def speed(corrector: Corrector) -> None:
    image, range_m = frame(0)
    short = Corrector(corrector.config.model_copy(update={"paper_adam": PaperAdamConfig(first_steps=3)}))
    short.fit_dense(image, range_m)
    start = time.perf_counter()
    short.fit_dense(image, range_m)
    dense = (time.perf_counter() - start) / 3 * 500
    seconds = []
    for _ in range(15):
        start = time.perf_counter()
        corrector.fit(corrector.measure(image, range_m))
        seconds.append(time.perf_counter() - start)
    table = statistics.median(seconds)
    threads = torch.get_num_threads()
    print(f"1952x1242: dense {dense:.0f} s for 500 steps (3 timed, {threads} threads); table and cold fit {1e3 * table:.1f} ms")
    print(f"{dense / table:.0f} times")


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    for encoding in ("srgb", "as-is"):
        corrector = Corrector(ColorConfig(method="paper", input_encoding=encoding, device="cpu"))
        print(f"{encoding:12} backscatter: dense      table   attenuation: dense  table on its backscatter, table  lower")
        every = [compare(corrector, *one) for one in frames(folder)]
        print(f"table lower or equal on {sum(every)} of {len(every)}")
    speed(corrector)


if __name__ == "__main__":
    main()
