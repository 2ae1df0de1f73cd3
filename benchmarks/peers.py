"""Other programs beside ours on the same pairs and the same dive, in tables.

    python benchmarks/peers.py [--env FOLDER] [--write]

The first time a virtual environment is made in FOLDER with the peers in the versions pinned here;
that alone needs the package index. Each program runs in a process of its own, on the same files:
matchers on pairs with known disparities (the first pair of the sample dive; Motorcycle, which
scikit-image brings; Teddy where STEREO_SEECOLOR_DATA names a folder that has it), and track and map
on the sample dive. Processor seconds and peak memory are those of the whole process, its start
included. --write puts the tables into docs/performance.md.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import venv
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np
from arguments import parser_of, sides
from compare import REPOSITORY, SAMPLE, machine
from map_errors import nearest_distance_m, surface_points, trajectory_error
from numpy.typing import NDArray
from platformdirs import user_cache_path

from calibration.transforms import rigid_alignment, transform_points
from stereo_seecolor.extras.synthetic.render import Scene
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.files.ply import read_vertices
from stereo_seecolor.inputs.trajectories import read_trajectory

PINNED = {
    "pandora": "1.9.0",
    "pandora-plugin-libsgm": "1.5.8",
    "libSGM": "0.5.2",
    "opencv-contrib-python-headless": "5.0.0.93",
    "open3d-cpu": "0.20.0",
    "pycolmap": "4.2.1",
    "scikit-image": "0.26.0",
}
OURS = "stereo-seecolor"
MATCHERS = {
    OURS: ("ours", ()),
    "OpenCV SGBM, 3-way": ("sgbm", ("opencv-contrib-python-headless",)),
    "OpenCV SGBM with WLS": ("sgbm_wls", ("opencv-contrib-python-headless",)),
    "Pandora: census, libSGM, cross-check": (
        "pandora",
        ("pandora", "pandora-plugin-libsgm", "libSGM"),
    ),
}
MAPPERS = {
    "COLMAP by pycolmap, both sides, known focal length": ("colmap", ("pycolmap",)),
    "Open3D: RGB-D odometry and TSDF, on our ranges": ("open3d", ("open3d-cpu",)),
    "Open3D: TSDF, on our ranges and by our track": ("open3d_by_our_track", ("open3d-cpu",)),
}
PAGE = REPOSITORY / "docs" / "performance.md"
MARKS = ("<!-- table: written by benchmarks/peers.py --write -->", "<!-- end of table -->")
LAUNCHER = """
import json, os, sys
said = [(os.POSIX_SPAWN_DUP2, 2, 1)]
pid = os.posix_spawnp(sys.argv[1], sys.argv[1:], os.environ, file_actions=said)
_, status, used = os.wait4(pid, 0)
code = os.waitstatus_to_exitcode(status)
print(json.dumps([code, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]))
"""
REACH_M = 0.3
"""A point of a map with no truth this near counts as off by as much."""


@dataclass(frozen=True)
class Used:
    """What a process took. failure: the last line that it wrote, where it failed."""

    processor_s: float
    peak_mib: float
    failure: str


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument(
        "--env",
        type=Path,
        default=user_cache_path("stereo-seecolor") / "peers",
        metavar="FOLDER",
        help="where the peers are installed",
    )
    parser.add_argument("--write", action="store_true", help="write docs/performance.md")
    arguments = parser.parse_args()
    missing = install(arguments.env)
    python = arguments.env / "bin" / "python"
    with tempfile.TemporaryDirectory() as work:
        lines = [
            f"{machine()}, Python {sys.version.split()[0]}.",
            "",
            *range_table(Path(work), python, missing),
            "",
            *track_table(Path(work), python, missing),
        ]
    print("\n".join(lines))
    if arguments.write:
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(MARKS[0])
        after = rest.partition(MARKS[1])[2]
        text = "\n".join([MARKS[0], *lines, MARKS[1]])
        PAGE.write_text(before + text + after, encoding="utf-8")


def install(folder: Path) -> dict[str, str]:
    """Make the environment where it is missing. Returns what does not install, and why."""
    record = folder / "peers.json"
    if record.exists():
        pinned, missing = json.loads(record.read_text())
        if pinned == PINNED:
            return dict(missing)
    venv.create(folder, with_pip=True, clear=True)
    missing = {}
    for name, number in PINNED.items():
        done = subprocess.run(
            [folder / "bin" / "python", "-m", "pip", "install", "-q", f"{name}=={number}"],
            capture_output=True,
            text=True,
        )
        if done.returncode:
            missing[name] = (done.stderr.strip().splitlines() or ["pip failed"])[-1]
    record.write_text(json.dumps([PINNED, missing]))
    return missing


def timed(command: list[object], log: Path) -> Used:
    """Run a process to its end, as a child of a small one: Linux counts the memory of the parent in
    the peak of its children.
    """
    path = os.pathsep.join([str(REPOSITORY), str(REPOSITORY / "benchmarks")])
    with log.open("w+") as said:
        launched = subprocess.run(
            [sys.executable, "-S", "-c", LAUNCHER, *map(str, command)],
            stdout=subprocess.PIPE,
            stderr=said,
            text=True,
            env=os.environ | {"PYTHONPATH": path},
            check=True,
        )
        code, processor_s, peak_mib = json.loads(launched.stdout)
        said.seek(0)
        last = (said.read().strip().splitlines() or [f"exit code {code}"])[-1]
    return Used(processor_s, peak_mib, last if code else "")


def program(python: Path, name: str, folder: Path) -> Used:
    """Run one of peer_programs in a folder."""
    code = f"import pathlib, peer_programs as p; p.{name}(pathlib.Path({str(folder)!r}))"
    return timed([python, "-c", code], folder / f"{name}.log")


def title(name: str, packages: tuple[str, ...]) -> str:
    numbers = dict.fromkeys(PINNED[each] for each in packages)
    return f"{name} {' / '.join(numbers) or version('stereo-seecolor')}"


def range_table(work: Path, python: Path, missing: dict[str, str]) -> list[str]:
    lines = [
        "| pair | program | known | of them off by > 2 px | processor s | peak MiB |",
        "|---|---|---|---|---|---|",
    ]
    for pair, (left, right, truth) in pairs(python).items():
        folder = work / pair.split()[0]
        folder.mkdir()
        for side, image in (("left", left), ("right", right)):
            cv2.imwrite(str(folder / f"{side}.png"), image)
        count = max(64, int(np.ceil((np.nanmax(truth) + 1) / 16) * 16))
        (folder / "count.txt").write_text(str(count))
        program(Path(sys.executable), "ours", folder)  # compiles what is not yet compiled
        for name, (function, packages) in MATCHERS.items():
            row = f"| {pair} | {title(name, packages)} |"
            reasons = [missing[each] for each in packages if each in missing]
            if reasons:
                lines.append(f"{row} does not install: {reasons[0]} | | | |")
                continue
            (folder / "disparity.npy").unlink(missing_ok=True)
            used = program(Path(sys.executable) if name == OURS else python, function, folder)
            if used.failure:
                lines.append(f"{row} failed: {used.failure} | | | |")
                continue
            found = np.load(folder / "disparity.npy")
            asked = np.isfinite(truth)
            known = asked & np.isfinite(found)
            wrong = np.abs(found[known] - truth[known]) > 2
            lines.append(
                f"{row} {100 * known.sum() / asked.sum():.1f} % | {100 * wrong.mean():.2f} % | "
                f"{used.processor_s:.1f} | {used.peak_mib:.0f} |"
            )
    return lines


def pairs(python: Path) -> dict[str, tuple[NDArray, NDArray, NDArray]]:
    """Left and right image (BGR) and true disparity, NaN where unknown, of each pair."""
    scene = sample_scene()
    drawn = scene.render(0)
    true = np.where(drawn.moving, np.float32(np.nan), drawn.range_map.disparity)
    found = {
        "sample dive, first pair (synthetic)": (
            drawn.rectified.left[..., ::-1],
            drawn.rectified.right[..., ::-1],
            true,
        )
    }
    data = next(python.parents[1].glob("lib/python*/site-packages/skimage/data"), None)
    if data is not None and (data / "motorcycle_disp.npz").exists():
        left, right = (cv2.imread(str(data / f"motorcycle_{s}.png")) for s in ("left", "right"))
        with np.load(data / "motorcycle_disp.npz") as content:
            disparity = content[content.files[0]].astype(np.float32)
        true = np.where(np.isfinite(disparity) & (disparity > 0), disparity, np.nan)
        found["Motorcycle, a quarter of its size (real)"] = (left, right, true)
    teddy = Path(os.environ.get("STEREO_SEECOLOR_DATA", ".")) / "teddy"
    if teddy.is_dir():
        left, right = (cv2.imread(str(teddy / f"{side}.png")) for side in ("left", "right"))
        truth = cv2.imread(str(teddy / "disparity_x4.pgm"), cv2.IMREAD_GRAYSCALE) / 4
        found["Teddy (real)"] = (left, right, np.where(truth > 0, truth, np.nan))
    return found


def sample_scene() -> Scene:
    """What the sample dive was drawn from (data_samples/README.md)."""
    return Scene.from_spec(
        SurveySpec(pairs=12, lines=2, image_size=(576, 448), water="blue-ocean", seed=7)
    )


def track_table(work: Path, python: Path, missing: dict[str, str]) -> list[str]:
    lines = [
        "| sample dive (synthetic), without navigation | pairs placed | track: RMS error | "
        "map to surface: median, 95 % | processor s | peak MiB |",
        "|---|---|---|---|---|---|",
    ]
    truth = read_trajectory(SAMPLE / "trajectory.tum")
    with np.load(SAMPLE / "truth" / "surface.npz") as content:
        height_m, origin_m = content["height_m"], tuple(content["origin_m"])
        cell_m = float(content["cell_m"])
    surface = surface_points(height_m, origin_m, cell_m)

    def row(name: str, track: NDArray, cloud: NDArray | None, used: Used) -> str:
        placed = np.isfinite(track).all(axis=1)
        true = truth.T_world_camera[:, :3, 3][placed]
        error = trajectory_error(track[placed], true)
        off = "-"
        if cloud is not None:
            points = transform_points(rigid_alignment(track[placed], true), cloud)
            off_m = np.minimum(nearest_distance_m(points[::7], surface, REACH_M), REACH_M)
            off = " mm, ".join(f"{1000 * np.quantile(off_m, q):.1f}" for q in (0.5, 0.95)) + " mm"
        return (
            f"| {name} | {placed.sum()} of {len(track)} | {1000 * error.rms_m:.1f} mm | {off} | "
            f"{used.processor_s:.1f} | {used.peak_mib:.0f} |"
        )

    out = work / "out"
    command = [
        sys.executable,
        "-m",
        "stereo_seecolor",
        "run",
        *sides(SAMPLE),
        "--fuse",
        "--out",
        out,
    ]
    timed(command, work / "first.log")  # compiles what is not yet compiled
    shutil.rmtree(out, ignore_errors=True)
    used = timed(command, work / "run.log")
    if not (out / "map" / "trajectory.tum").exists():
        return [*lines, f"| {OURS} | failed: {used.failure} | | | | |"]
    found = read_trajectory(out / "map" / "trajectory.tum")
    poses = np.full((len(truth.timestamps_s), 4, 4), np.nan)
    for time_s, pose in zip(found.timestamps_s, found.T_world_camera, strict=True):
        poses[np.argmin(np.abs(truth.timestamps_s - time_s))] = pose
    cloud = np.asarray(read_vertices(out / "map" / "cloud.ply")["position"], np.float64)
    whole = f"{OURS} {version('stereo-seecolor')}: ranges, colors, track, map, page"
    lines.append(row(whole, poses[:, :3, 3], cloud, used))
    folder = work / "dive"
    dive_inputs(folder, out)
    np.save(folder / "our_poses.npy", poses)
    for name, (function, packages) in MAPPERS.items():
        words = title(name, packages)
        reasons = [missing[each] for each in packages if each in missing]
        used = Used(0, 0, "") if reasons else program(python, function, folder)
        if reasons or used.failure:
            why = f"does not install: {reasons[0]}" if reasons else f"failed: {used.failure}"
            lines.append(f"| {words} | {why} | | | | |")
            continue
        file = folder / "cloud.npy"
        cloud = np.load(file) if file.exists() else None
        file.unlink(missing_ok=True)
        lines.append(row(words, np.load(folder / "track.npy"), cloud, used))
    return lines


def dive_inputs(folder: Path, out: Path) -> None:
    """The rectified images of the sample dive, its camera, and the depths of our run."""
    rectification = sample_scene().rectification
    pair, names, depths = rectification.pair, [], []
    for side in ("left", "right"):
        (folder / "images" / side).mkdir(parents=True)
    rays = pair.points_from_range(np.ones(pair.image_size[::-1], np.float32))
    for path in sorted((SAMPLE / "left").iterdir()):
        other = SAMPLE / "right" / path.name
        left = rectification.apply_left(cv2.imread(str(path)))
        right = rectification.apply_right(cv2.imread(str(other)))
        cv2.imwrite(str(folder / "images" / "left" / path.name), left)
        cv2.imwrite(str(folder / "images" / "right" / path.name), right)
        range_m = cv2.imread(str(out / "range" / f"{path.stem}.tiff"), cv2.IMREAD_UNCHANGED)
        depths.append(np.nan_to_num(range_m * rays[..., 2]).astype(np.float32))
        names.append(path.name)
    np.save(folder / "depth.npy", np.stack(depths))
    camera = {"fx": pair.focal_px, "cx": pair.cx_left_px, "cy": pair.cy_px}
    (folder / "dive.json").write_text(
        json.dumps(camera | {"baseline_m": pair.baseline_m, "names": names})
    )


if __name__ == "__main__":
    main()
