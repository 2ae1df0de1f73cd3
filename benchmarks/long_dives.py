"""How `run --fuse` grows with the length of a dive that finds its own track.

    python benchmarks/long_dives.py --pairs 600 1200 2400 [--keep FOLDER]

A synthetic survey in parallel lines of 120 pairs of 320x256, back and forth, 2 m above ground with
relief of some decimeters; neighboring frames share four fifths, neighboring lines two thirds.
Shorter dives are the first lines of the longest. The ground is one texture and one height map,
which the cameras look up directly; `synthesize`, which casts rays at corals, takes some ten times
as long. No poses are given. Each dive is run by a process of its own, with two workers, everything
written. Prints processor seconds (user and system) for each pair, peak memory, placed pairs, and
the error of the track, after alignment to the true one by a rotation and a shift, without a scale.
"""

import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml
from arguments import parser_of, sides
from compare import REPOSITORY, execute, machine
from numpy.typing import NDArray

LINE_PAIRS, STEP_M, LINE_GAP_M = 120, 0.38, 0.8
WIDTH, HEIGHT, FOCAL_PX, BASELINE_M, ALTITUDE_M = 320, 256, 260.0, 0.12, 2.0
CELL_M, MARGIN_M = 0.006, 2.5
"""Of the texture, below a pixel's 8 mm; ground beside the outermost camera centers."""
ATTENUATION = np.array([0.45, 0.10, 0.07])
"""Red, green, blue, 1/m."""
VEIL = np.array([0.02, 0.10, 0.16])
NOISE = 0.006
"""Of linear values, standard deviation."""
WANDER_M, WANDER_DEG = 0.05, 2.0
"""Amplitude of the slow sways beside the lines, and of roll and pitch."""


@dataclass(frozen=True)
class Ground:
    """albedo: (rows, columns, 3) float32, linear. height_m: (rows, columns) float32, upward. Both
    begin at -MARGIN_M in x (columns) and y (rows).
    """

    albedo: NDArray[np.float32]
    height_m: NDArray[np.float32]


def ground_of(lines: int) -> Ground:
    """Noise at several scales: relief of decimeters, and three minerals in changing shares."""
    rng = np.random.default_rng(5)
    columns = round((LINE_PAIRS * STEP_M + 2 * MARGIN_M) / CELL_M)
    rows = round((lines * LINE_GAP_M + 2 * MARGIN_M) / CELL_M)

    def noise(period_m: float) -> NDArray[np.float32]:
        size = [max(4, round(n * CELL_M / period_m)) for n in (columns, rows)]
        coarse = rng.normal(0, 1, size[::-1]).astype(np.float32)
        return cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_CUBIC)

    height_m = 0.12 * noise(1.5) + 0.03 * noise(0.4)
    fine = np.exp(0.35 * noise(0.03) + 0.25 * noise(0.012) + 0.25 * noise(0.1))
    share = 1 / (1 + np.exp(-2 * noise(0.25)))
    sand, algae = np.float32([0.42, 0.36, 0.28]), np.float32([0.10, 0.13, 0.07])
    albedo = fine[..., None] * (share[..., None] * sand + (1 - share[..., None]) * algae)
    return Ground(np.clip(albedo, 0.01, 0.95), height_m)


def poses_of(lines: int) -> Iterator[NDArray[np.float64]]:
    """T_world_camera of each left camera, looking down, along the lines and back."""
    rng = np.random.default_rng(6)
    phases = rng.uniform(0, 2 * np.pi, 5)
    for k in range(lines * LINE_PAIRS):
        line, i = divmod(k, LINE_PAIRS)
        along = i if line % 2 == 0 else LINE_PAIRS - 1 - i
        sway = np.sin(k / 17 + phases)
        roll, pitch = np.deg2rad(WANDER_DEG * sway[:2])
        tilt, _ = cv2.Rodrigues(np.array([roll, pitch, 0.03 * sway[2]]))
        T = np.eye(4)
        T[:3, :3] = np.diag([1.0, -1.0, -1.0]) @ tilt
        T[:3, 3] = (
            along * STEP_M + WANDER_M * sway[3],
            line * LINE_GAP_M + WANDER_M * sway[4],
            ALTITUDE_M,
        )
        yield T


def seen(ground: Ground, T: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.uint8]:
    """The image, BGR in sRGB: rays meet the height map by fixed-point steps."""
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.stack(
        [(u - WIDTH / 2 + 0.5) / FOCAL_PX, (v - HEIGHT / 2 + 0.5) / FOCAL_PX, np.ones(u.shape)], -1
    )
    directions = rays @ T[:3, :3].T
    depth_m = np.full(u.shape, T[2, 3])
    for _ in range(10):
        column, row = (
            ((T[a, 3] + depth_m * directions[..., a] + MARGIN_M) / CELL_M).astype(np.float32)
            for a in (0, 1)
        )
        height_m = cv2.remap(ground.height_m, column, row, cv2.INTER_LINEAR)
        depth_m = (height_m - T[2, 3]) / directions[..., 2]
    range_m = (depth_m * np.linalg.norm(rays, axis=-1))[..., None]
    reef = cv2.remap(ground.albedo, column, row, cv2.INTER_LINEAR)
    linear = reef * np.exp(-ATTENUATION * range_m) + VEIL * (1 - np.exp(-ATTENUATION * range_m))
    linear = np.clip(linear + rng.normal(0, NOISE, linear.shape), 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.rint(255 * encoded[..., ::-1]).astype(np.uint8)


def draw(folder: Path, lines: int) -> None:
    """left/, right/ and cam.yaml of the survey."""
    ground, rng = ground_of(lines), np.random.default_rng(7)
    shift = np.eye(4)
    shift[0, 3] = BASELINE_M
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
    for k, T in enumerate(poses_of(lines)):
        for side, pose in (("left", T), ("right", T @ shift)):
            cv2.imwrite(str(folder / side / f"{k:06d}.png"), seen(ground, pose, rng))
    K = [[FOCAL_PX, 0, WIDTH / 2 - 0.5], [0, FOCAL_PX, HEIGHT / 2 - 0.5], [0, 0, 1]]
    camera = {"model": "pinhole", "image_size": [WIDTH, HEIGHT], "K": K, "distortion": [0.0] * 5}
    form = {"format": "stereo-seecolor/rig", "version": 1, "medium": "water"}
    rig = form | {"left": camera, "right": camera, "T_right_left": np.linalg.inv(shift).tolist()}
    (folder / "cam.yaml").write_text(yaml.safe_dump(rig))


def first_pairs(whole: Path, folder: Path, pairs: int) -> None:
    """A dive of the first pairs, by links."""
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
        for file in sorted((whole / side).iterdir())[:pairs]:
            (folder / side / file.name).hardlink_to(file)


def track_error_mm(out: Path, pairs: int) -> tuple[int, float]:
    """Pairs that the track places, and the RMS distance to their true places, aligned."""
    rows = np.loadtxt(out / "map" / "trajectory.tum", ndmin=2)
    true = np.array([T[:3, 3] for T in poses_of(-(-pairs // LINE_PAIRS))])[: len(rows)]
    placed = rows[:, 1:4]
    a, b = placed - placed.mean(0), true - true.mean(0)
    u, _, vt = np.linalg.svd(a.T @ b)
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    return len(rows), 1000 * float(np.sqrt(((a @ turn - b) ** 2).sum(1).mean()))


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--pairs", type=int, nargs="+", default=[600, 1200, 2400])
    parser.add_argument("--keep", type=Path, help="folder in which dives and results stay")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        work = options.keep or Path(temporary)
        whole = work / "whole"
        if not whole.exists():
            draw(whole, -(-max(options.pairs) // LINE_PAIRS))
        print(machine() + "\n\n| pairs | processor s a pair | peak MiB | placed | track, mm |")
        print("|---|---|---|---|---|", flush=True)
        for pairs in options.pairs:
            dive, out = work / f"pairs_{pairs}", work / f"out_{pairs}"
            shutil.rmtree(dive, ignore_errors=True)
            first_pairs(whole, dive, pairs)
            timing = execute(
                REPOSITORY,
                "run",
                *sides(dive, whole / "cam.yaml"),
                *("--out", out, "--fuse", "--workers", 2),
            )
            placed, error_mm = track_error_mm(out, pairs)
            print(
                f"| {pairs} | {timing.processor_s / pairs:.3f} | {timing.peak_mib:.0f} "
                f"| {placed} | {error_mm:.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
