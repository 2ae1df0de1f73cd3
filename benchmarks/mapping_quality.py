"""How true the map of a long survey is, with given poses and with its own odometry, in one table.

    python benchmarks/mapping_quality.py FOLDER [pairs]

Renders a survey of 4 lines over a reef (640x512, altitude 1.7 to 2.6 m, a textureless sand patch,
fish in every frame), matches and color-corrects it with the defaults, maps it both ways, and holds
all against the truth. Rendering takes a second or more a pair; FOLDER keeps what was rendered,
matched and corrected, and the maps.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
import rasterio
from arguments import words_of
from map_errors import nearest_distance_m, surface_points, trajectory_error
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibration import RectifiedPair
from calibration.transforms import rigid_alignment
from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.config import ColorConfig, MappingConfig, MatchingConfig
from stereo_seecolor.extras.evaluation.measures import angle_deg
from stereo_seecolor.extras.synthetic.reef import CELL_M
from stereo_seecolor.extras.synthetic.render import Scene
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.files.ply import read_vertices
from stereo_seecolor.files.srgb import decode_srgb
from stereo_seecolor.inputs.trajectories import read_trajectory
from stereo_seecolor.mapping.raster.reef_metrics import measure
from stereo_seecolor.mapping.survey_map import build_map
from stereo_seecolor.matching.matcher import Matcher
from stereo_seecolor.records import StereoFrame, SurveyFrame, Trajectory

GRID_M = 0.02
REACH_M = 0.1
"""A point of the cloud with no truth this near counts as off by as much."""
SAMPLE = 50
Rows = dict[str, str]


class Survey(Sequence[SurveyFrame]):
    """The survey's frames as the map sees them, from FOLDER; what is missing is made."""

    def __init__(self, folder: Path, spec: SurveySpec) -> None:
        self.folder, self.spec = folder, spec
        self.scene = Scene.from_spec(spec)
        self.pair: RectifiedPair = self.scene.rectification.pair
        self.trajectory: Trajectory = self.scene.trajectory
        folder.mkdir(parents=True, exist_ok=True)
        matcher, corrector = (
            Matcher(self.pair, MatchingConfig()),
            Corrector(ColorConfig(lock="survey")),
        )
        for i in range(spec.pairs):
            if not self._path(i, "").exists():
                p = self.scene.render(i)
                truth = {"truth": p.range_map.range_m, "color": p.color_image, "moving": p.moving}
                np.savez(self._path(i, ""), left=p.rectified.left, right=p.rectified.right, **truth)
            if not self._path(i, "m").exists():
                z = np.load(self._path(i, ""))
                found = matcher.match(StereoFrame(self.trajectory.names[i], z["left"], z["right"]))
                np.savez(
                    self._path(i, "m"),
                    range_m=found.measured_m,
                    std=found.range_std_m,
                    confidence=found.confidence,
                )
        if not self._path(spec.pairs - 1, "c").exists():
            tables = [
                corrector.measure(self.load(i)["left"], self.load(i, "m")["range_m"])
                for i in range(0, spec.pairs, 4)
            ]
            water = corrector.fit(sum(tables[1:], tables[0]))
            first = corrector.apply(self.load(0)["left"], self.load(0, "m")["range_m"], water)
            water = replace(water, exposure=first.exposure, highlights=first.highlights)
            for i in range(spec.pairs):
                done = corrector.apply(self.load(i)["left"], self.load(i, "m")["range_m"], water)
                np.savez(self._path(i, "c"), image=done.image, unrecoverable=done.unrecoverable)

    def __len__(self) -> int:
        return self.spec.pairs

    def __getitem__(self, i: int) -> SurveyFrame:  # type: ignore[override]
        ranges, colors, name = self.load(i, "m"), self.load(i, "c"), self.trajectory.names[i]
        time_s = float(self.trajectory.timestamps_s[i])
        confidence = np.rint(255 * np.nan_to_num(ranges["confidence"])).astype(np.uint8)
        return SurveyFrame(
            name,
            time_s,
            colors["image"],
            ranges["range_m"],
            ranges["std"],
            confidence,
            colors["unrecoverable"],
        )

    def load(self, i: int, what: str = "") -> dict[str, NDArray]:
        """Rendered (""), matched ("m") or corrected ("c")."""
        with np.load(self._path(i, what)) as content:
            return dict(content)

    @cached_property
    def surface(self) -> NDArray[np.float64]:
        """The whole reef as points."""
        return surface_points(self.scene.reef.height_m, self.scene.reef.origin_m, CELL_M)

    @cached_property
    def seen(self) -> NDArray[np.float64]:
        """Points of the reef that some frame saw, one a 5 mm cell, thinned out."""
        points = []
        for i in range(len(self)):
            z = self.load(i)
            range_m = np.where(z["moving"], np.float32(np.nan), z["truth"])
            local = self.pair.points_from_range(range_m)[::7, ::7].reshape(-1, 3)
            T = self.trajectory.T_world_camera[i]
            points.append(local[np.isfinite(local).all(axis=1)] @ T[:3, :3].T + T[:3, 3])
        everything = np.concatenate(points)
        return everything[
            np.unique(np.floor(everything / 0.005).astype(int), axis=0, return_index=True)[1]
        ]

    def _path(self, i: int, what: str) -> Path:
        return self.folder / f"{what}{i:04d}.npz"


def score(survey: Survey, out: Path) -> Rows:
    """All numbers of one map."""
    track = read_trajectory(out / "trajectory.tum")
    chosen = [
        int(np.argmin(np.abs(survey.trajectory.timestamps_s - t))) for t in track.timestamps_s
    ]
    truth = survey.trajectory.T_world_camera[chosen]
    T = rigid_alignment(track.T_world_camera[:, :3, 3], truth[:, :3, 3])
    error = trajectory_error(track.T_world_camera[:, :3, 3], truth[:, :3, 3])
    rows: Rows = {"frames placed": f"{len(chosen)} of {len(survey)}"}
    rows["track: RMS error, fraction of the path"] = (
        f"{1000 * error.rms_m:.1f} mm, {100 * error.fraction:.3f} % of {error.path_m:.0f} m"
    )
    vertices = read_vertices(out / "cloud.ply")
    cloud = np.asarray(vertices["position"], np.float64) @ T[:3, :3].T + T[:3, 3]
    rows |= (
        cloud_rows(survey, cloud)
        | length_rows(survey, track, chosen, truth)
        | terrain_rows(survey, out, T)
    )
    return rows | color_rows(survey, cloud, np.asarray(vertices["color"]))


def cloud_rows(survey: Survey, cloud: NDArray) -> Rows:
    off_m = np.minimum(nearest_distance_m(cloud[::23], survey.surface, REACH_M), REACH_M)
    missing = nearest_distance_m(survey.seen, cloud, 0.03) > 0.03
    return {
        "cloud to surface: median, 95 %": f"{1000 * np.median(off_m):.1f} mm, "
        f"{1000 * np.quantile(off_m, 0.95):.1f} mm",
        "completeness (within 3 cm)": f"{100 * (1 - missing.mean()):.1f} %",
    }


def length_rows(survey: Survey, track: Trajectory, chosen: list[int], truth: NDArray) -> Rows:
    """Lengths between things on the bottom in the middle of two frames, 5 m apart and more, as
    mapped and as they are.
    """
    mapped, true = [], []
    row, column = survey.pair.image_size[1] // 2, survey.pair.image_size[0] // 2
    for k, i in enumerate(chosen):
        z, m = survey.load(i), survey.load(i, "m")
        if np.isfinite(m["range_m"][row, column]) and not z["moving"][row, column]:
            ray = survey.pair.points_from_range(np.ones_like(z["truth"]))[row, column]
            mapped.append(track.T_world_camera[k] @ [*(ray * m["range_m"][row, column]), 1])
            true.append(truth[k] @ [*(ray * z["truth"][row, column]), 1])
    a, b = np.triu_indices(len(true), 1)
    lengths, real = (
        np.linalg.norm((p := np.array(points)[:, :3])[a] - p[b], axis=1)
        for points in (mapped, true)
    )
    off = (lengths / real - 1)[real > 5]
    return {
        "control lengths over 5 m: mean, 95 % error": f"{100 * off.mean():+.3f} %, "
        f"{100 * np.quantile(np.abs(off), 0.95):.3f} "
        "%"
    }


def terrain_rows(survey: Survey, out: Path, T: NDArray) -> Rows:
    reef = survey.scene.reef
    with rasterio.open(out / "dem.tif") as dem:
        heights, place = dem.read(1), dem.transform
    rows, columns = np.nonzero(np.isfinite(heights))
    x, y = place * (columns + 0.5, rows + 0.5)
    points = np.stack([x, y, heights[rows, columns]], axis=-1) @ T[:3, :3].T + T[:3, 3]
    cells = ((points[:, :2] - reef.origin_m) / CELL_M).astype(np.float32)
    true = np.concatenate(
        [
            cv2.remap(reef.height_m, part[:, None], None, cv2.INTER_LINEAR).ravel()
            for part in np.array_split(cells, 1 + len(cells) // 30000)
        ]
    )
    off = points[:, 2] - true
    as_true = np.full(heights.shape, np.nan)
    as_true[rows, columns] = true
    mapped, real = measure(heights, place.a), measure(as_true, place.a)
    return {
        "terrain: bias, RMS error": f"{1000 * off.mean():+.1f} mm, "
        f"{1000 * np.sqrt((off**2).mean()):.1f} mm",
        "surface rugosity of the site: mapped, true": f"{mapped.surface_rugosity:.3f}, "
        f"{real.surface_rugosity:.3f} "
        f"({100 * (mapped.surface_rugosity / real.surface_rugosity - 1):+.1f} %)",
        "linear rugosity of the site: mapped, true": f"{mapped.linear_rugosity:.3f}, "
        f"{real.linear_rugosity:.3f} "
        f"({100 * (mapped.linear_rugosity / real.linear_rugosity - 1):+.1f} %)",
    }


def color_rows(survey: Survey, cloud: NDArray, colors: NDArray) -> Rows:
    """Angles to the true colors in linear light: of the map's nearest point and of the frame, at
    the same pixels of every third frame, as they are and after one white balance over the whole
    survey, which leaves what differs from view to view.
    And how the map's tint changes across the seams, on cells of 2 cm seen from above.
    """
    low = cloud[:, :2].min(axis=0) - 1
    shape = tuple(((cloud[:, :2].max(axis=0) + 1 - low) / GRID_M).astype(int)[::-1])
    mapped = gather(shape, low, cloud, decode_srgb(colors / 255))
    truth, single, fused, real = np.zeros((*shape, 4)), [], [], []
    tree, linear = cKDTree(cloud), decode_srgb(colors / 255)
    for i in range(0, len(survey), 3):
        z, image, ranges = (
            survey.load(i),
            survey.load(i, "c")["image"],
            survey.load(i, "m")["range_m"],
        )
        good = (
            ~z["moving"]
            & np.isfinite(z["truth"])
            & np.isfinite(ranges)
            & (image.max(axis=2) < 254)
            & (image.min(axis=2) > 0)
        )
        T = survey.trajectory.T_world_camera[i]
        points = survey.pair.points_from_range(z["truth"])[good] @ T[:3, :3].T + T[:3, 3]
        true = decode_srgb(z["color"][good] / 255)
        truth += gather(shape, low, points, true)
        distance_m, nearest = tree.query(points[::SAMPLE], distance_upper_bound=0.03)
        on = np.isfinite(distance_m)
        on[on] &= linear[nearest[on]].any(axis=1)  # black has no angle
        fused.append(linear[nearest[on]])
        single.append(decode_srgb(image[good] / 255)[::SAMPLE][on])
        real.append(true[::SAMPLE][on])
    both = (truth[..., 3] > 8) & (mapped[..., 3] > 1)
    steps = []
    for seam in np.arange(survey.spec.lines - 1) + 0.5:
        y = seam * survey.spec.line_spacing_m
        for x in np.arange(0.0, survey.spec.line_length_m, 1.0):
            sides = [tint(mapped, truth, both, low, x, y + shift) for shift in (-0.3, 0.1)]
            if all(np.isfinite(side).all() for side in sides):
                steps.append(float(angle_deg(sides[0][None], sides[1][None])[0]))
    true = np.concatenate(real)
    both_ways = [np.concatenate(colors) for colors in (fused, single)]
    off, alone = (angle_deg(c, true).mean() for c in both_ways)
    balanced, alone_balanced = (
        angle_deg(c * true.mean(axis=0) / c.mean(axis=0), true).mean() for c in both_ways
    )
    return {
        "color on the surface: mean angle to the truth": f"{off:.2f} deg (single frames "
        f"{alone:.2f} deg)",
        "the same after one white balance": f"{balanced:.2f} deg (single frames "
        f"{alone_balanced:.2f} deg)",
        "color step between lines: mean, largest": f"{np.mean(steps):.2f} deg, "
        f"{np.max(steps):.2f} deg",
    }


def gather(
    shape: tuple[int, ...], low: NDArray, points: NDArray, colors: NDArray
) -> NDArray[np.float64]:
    """(H, W, 4) sums of colors and counts."""
    column, row = ((points[:, :2] - low) / GRID_M).astype(int).T
    inside = (column >= 0) & (row >= 0) & (column < shape[1]) & (row < shape[0])
    cell = row[inside] * shape[1] + column[inside]
    sums = [
        np.bincount(cell, w, minlength=shape[0] * shape[1])
        for w in (*colors[inside].T, np.ones(inside.sum()))
    ]
    return np.stack(sums, axis=-1).reshape(*shape, 4)


def tint(
    mapped: NDArray, truth: NDArray, both: NDArray, low: NDArray, x: float, y: float
) -> NDArray[np.float64]:
    """Mean mapped color over mean true color in a window of 1 m along the line by 0.2 m across."""
    column, row = (np.array([x, y]) - low) / GRID_M
    window = slice(int(row), int(row + 0.2 / GRID_M)), slice(int(column), int(column + 1 / GRID_M))
    cells = both[window]
    if cells.sum() < 100:
        return np.full(3, np.nan)
    fraction = [
        (m[window][cells][:, :3] / m[window][cells][:, 3:]).mean(axis=0) for m in (mapped, truth)
    ]
    return np.asarray(fraction[0] / fraction[1])


def main(folder: Path, pairs: int) -> None:
    survey = Survey(
        folder, SurveySpec(pairs=pairs, lines=4, textureless_patch=True, fish=3, seed=11)
    )
    columns = {}
    for name, trajectory in (("given poses", survey.trajectory), ("own odometry", None)):
        out = folder / name.replace(" ", "_").replace(",", "")
        if not (out / "dem.tif").exists():
            summary = build_map(survey, survey.pair, out, MappingConfig(), trajectory)
            print(
                f"{name}: {summary.seconds:.0f} s, components {summary.components}, without a "
                f"place {[u.name for u in summary.unplaced]}, {summary.warnings}"
            )
        columns[name] = score(survey, out)
    print(f"| | {' | '.join(columns)} |\n|---|{'---|' * len(columns)}")
    for row in columns["given poses"]:
        print(f"| {row} | {' | '.join(column[row] for column in columns.values())} |")


if __name__ == "__main__":
    given = words_of(__doc__, "FOLDER [FRAMES]")
    main(Path(given[0]), int(given[1]) if len(given) > 1 else 160)
