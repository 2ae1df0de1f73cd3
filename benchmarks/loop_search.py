"""How long the search for places seen before takes on a long dive, in how much memory, and how many
it finds.

    python benchmarks/loop_search.py [frames ...]

Simulated: a lawnmower dive over a bottom of random landmarks, 40 in each cell of 0.7 m; a frame
sees those of nine cells, a third of them others than its neighbors see, with noise in their
descriptors. Frames are half a meter apart on lines of 200 frames, which are one meter apart.
"""

import resource
import time

import numpy as np
from arguments import words_of
from numpy.typing import NDArray

from stereo_seecolor.compute.sequences import Lazy
from stereo_seecolor.compute.threads import Threads, cores
from stereo_seecolor.mapping.track.features import Features
from stereo_seecolor.mapping.track.loops import by_overlap
from stereo_seecolor.mapping.track.place_recognition import by_appearance

STEP_M, LINE_M, LINE_FRAMES = 0.5, 1.0, 200
CELL_M, LANDMARKS, NOISE, SEEN_AGAIN = 0.7, 40, 12.0, 0.7


class Lawnmower(Lazy[Features]):
    """Simulated features of a dive, made when asked for."""

    def __init__(self, frames: int) -> None:
        number = np.arange(frames)
        line, along = number // LINE_FRAMES, number % LINE_FRAMES
        x = np.where(line % 2 == 0, along, LINE_FRAMES - 1 - along) * STEP_M
        self.position_m = np.stack([x, line * LINE_M, np.zeros(frames)], axis=-1)

    def __len__(self) -> int:
        return len(self.position_m)

    def item(self, number: int) -> Features:
        """Of the frame at a position of the track."""
        rng = np.random.default_rng(number)
        column, row = np.floor(self.position_m[number, :2] / CELL_M).astype(int)
        cells = [_landmarks(column + j, row + i) for i in (-1, 0, 1) for j in (-1, 0, 1)]
        landmarks = np.concatenate(cells)
        found = landmarks[rng.random(len(landmarks)) < SEEN_AGAIN]
        noisy = np.clip(found + rng.normal(0, NOISE, found.shape), 0, 255).astype(np.uint8)
        unknown = np.zeros((len(noisy), 3))
        return Features(unknown, unknown, unknown[:, 2], noisy)


def _landmarks(column: int, row: int) -> NDArray[np.float64]:
    """Descriptors with few large numbers, as SIFT's."""
    return np.minimum(
        np.random.default_rng((column + 1000, row + 1000)).exponential(30, (LANDMARKS, 128)), 255
    )


def main(counts: list[int]) -> None:
    print(
        "| frames | by appearance: s, processor s | candidates | true | frames found again | by "
        "overlap: s | candidates | GiB |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for count in counts:
        dive = Lawnmower(count)
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        pairs = np.array(by_appearance(dive, Threads(cores())))
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
        apart_m = np.linalg.norm(
            dive.position_m[pairs[:, 0]] - dive.position_m[pairs[:, 1]], axis=1
        )
        true = pairs[apart_m < 1.5]
        again_s = time.perf_counter()
        flat = np.random.default_rng(0).uniform(-1, 1, (50, 3))
        near = by_overlap(((i, dive.position_m[i] + flat) for i in range(count)), 3)
        again_s = time.perf_counter() - again_s
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        found = len(np.unique(true)) / count
        print(
            f"| {count} | {wall_s:.0f}, {cpu_s:.0f} | {len(pairs)} | {len(true) / len(pairs):.1%} "
            f"| {found:.1%} | {again_s:.0f} | {len(near)} | {peak:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main([int(word) for word in words_of(__doc__, "FRAMES")] or [500, 2000, 20_000])
