"""How long the pose graph of a long dive takes to solve, and in how much memory.

    python benchmarks/track_graph.py [frames ...]

Simulated: a lawnmower dive as in loop_search.py; each frame is connected with the three before it
and with the nearest of the line beside it, by relative poses with errors of 3 mm and 2 mrad, and
one of a hundred loops is false, by some meters; the solver starts from the poses that the edges
between neighbors add up to.
"""

import resource
import time

import numpy as np
from arguments import words_of
from numpy.typing import NDArray

from calibration.transforms import inverse, rigid_transform, rotation_from_vector
from stereo_seecolor.mapping.track.pose_graph import solve
from stereo_seecolor.mapping.track.relative_pose import Edge

STEP_M, LINE_M, LINE_FRAMES, BACK = 0.5, 1.0, 200, 3
STD_M, STD_RAD = 0.003, 0.002
FALSE_EVERY, FALSE_M = 100, 3.0
COVARIANCE = np.diag([STD_RAD**2] * 3 + [STD_M**2] * 3)


def truth(frames: int) -> NDArray[np.float64]:
    """(N, 4, 4) cameras that look down, north up."""
    number = np.arange(frames)
    line, along = number // LINE_FRAMES, number % LINE_FRAMES
    T = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (frames, 1, 1))
    T[:, 0, 3] = np.where(line % 2 == 0, along, LINE_FRAMES - 1 - along) * STEP_M
    T[:, 1, 3], T[:, 2, 3] = line * LINE_M, 2 + 0.2 * np.sin(number / 30)
    return T


def edges_of(T: NDArray[np.float64], rng: np.random.Generator) -> list[Edge]:
    """Measured relative poses: neighbors, then loops."""
    count = len(T)
    ends = [(j - back, j, False) for j in range(count) for back in range(1, BACK + 1) if j >= back]
    ends += [
        (2 * LINE_FRAMES * (j // LINE_FRAMES) - 1 - j, j, True) for j in range(LINE_FRAMES, count)
    ]
    turns, shifts = rng.normal(0, STD_RAD, (len(ends), 3)), rng.normal(0, STD_M, (len(ends), 3))
    false = false_loops(len(ends), sum(loop for *_, loop in ends))
    shifts[false] += rng.normal(0, FALSE_M, (len(false), 3))
    return [
        Edge(
            i,
            j,
            inverse(T[i]) @ T[j] @ rigid_transform(rotation_from_vector(turn), shift),
            COVARIANCE,
            100,
            loop,
        )
        for (i, j, loop), turn, shift in zip(ends, turns, shifts, strict=True)
    ]


def false_loops(edges: int, loops: int) -> NDArray[np.int64]:
    """Numbers of the edges that are false: loops come last."""
    return np.arange(edges - loops, edges, FALSE_EVERY)


def main(counts: list[int]) -> None:
    print(
        "| frames | edges | off at the start, m | solved, m (rms) | false loops drawn, found, "
        "wrongly | s | processor s | GiB |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for count in counts:
        T = truth(count)
        edges = edges_of(T, np.random.default_rng(0))
        start = T.copy()
        for edge in edges:
            if edge.j - edge.i == 1:
                start[edge.j] = start[edge.i] @ edge.T_i_j
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        solved, false = solve(start, range(count), edges)
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
        off_m = [
            float(np.sqrt(((one - T)[:, :3, 3] ** 2).sum(axis=1).mean())) for one in (start, solved)
        ]
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        drawn = {
            id(edges[number])
            for number in false_loops(len(edges), sum(edge.loop for edge in edges))
        }
        found = len(drawn & {id(edge) for edge in false})
        told = f"{len(drawn)}, {found}, {len(false) - found}"
        row = (
            f"{count} | {len(edges)} | {off_m[0]:.2f} | {off_m[1]:.3f} | {told} | {wall_s:.0f} "
            f"| {cpu_s:.0f} | {peak:.2f}"
        )
        print(f"| {row} |", flush=True)


if __name__ == "__main__":
    main([int(word) for word in words_of(__doc__, "FRAMES")] or [2000, 20_000, 30_000, 100_000])
