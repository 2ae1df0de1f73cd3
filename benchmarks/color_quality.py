"""Every color method on known truth and on white cards in the sea: the tables of
docs/color-quality.md and docs/lab/color.md.

    python benchmarks/color_quality.py [--cases 24] [--first-seed 100] [--data FOLDER]
    python benchmarks/color_quality.py --table [--write]

--table makes the one table of docs/color-quality.md, with a row for each data set; --write puts it
into the page.

Seeds below 100 were looked at while the method was made; those from 100 on were not.
"""

import argparse
import itertools
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
from color_cases import Case, make_case

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.commands.fuse import RawImages
from stereo_seecolor.commands.run import run
from stereo_seecolor.config import ColorConfig, RunConfig
from stereo_seecolor.extras.evaluation.baselines import METHODS, expose
from stereo_seecolor.extras.evaluation.charts.scores import correct_by_all, score_target
from stereo_seecolor.extras.evaluation.charts.search import seen_chart, spread_over_charts
from stereo_seecolor.extras.evaluation.charts.targets import neutral, read_targets, targets_of
from stereo_seecolor.extras.evaluation.measures import clipped, score_neutral, score_truth
from stereo_seecolor.extras.evaluation.truth import evaluate_spread
from stereo_seecolor.files.srgb import LUMINANCE, decode_srgb, encode_srgb
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.records import Water
from stereo_seecolor.run_folder.finished_run import open_run

Result = np.ndarray
Method = Callable[[Case], Result]
PAGE = Path(__file__).resolve().parents[1] / "docs/color-quality.md"
TABLE_BEGIN, TABLE_END = (
    "<!-- table: written by benchmarks/color_quality.py --table --write -->",
    "<!-- end of table -->",
)
WATERS = ("blue-ocean", "coastal-green", "turbid")


def bins_of_range(
    image: np.ndarray, range_m: np.ndarray, fraction: float, norm: float, bins: int = 20
) -> np.ndarray:
    """The darkest hundredth of each bin of range, or a fraction of it, subtracted; one gain a
    channel and bin, from the norm of its colors, log-linear in range; exposed like the other
    baselines.
    """
    known = np.isfinite(range_m)
    edges = np.quantile(range_m[known], np.linspace(0, 1, bins + 1))
    bin_of = np.clip(np.digitize(range_m, edges) - 1, 0, bins - 1)
    direct, ranges, levels = np.full(image.shape, np.nan), [], []
    for b in range(bins):
        inside = known & (bin_of == b)
        if inside.sum() < 20:
            continue
        direct[inside] = np.maximum(
            image[inside] - fraction * np.quantile(image[inside], 0.01, axis=0), 0
        )
        ranges.append(range_m[inside].mean())
        levels.append(np.log((direct[inside] ** norm).mean(axis=0) ** (1 / norm) + 1e-4))
    slope = len(ranges) > 1 and np.ptp(ranges) > 1e-3
    fit = (
        np.polyfit(ranges, np.array(levels), 1)
        if slope
        else np.stack([np.zeros(3), np.mean(levels, axis=0)])
    )
    return expose(direct / np.exp(range_m[..., None] * fit[0] + fit[1]), known)


def by_config(**settings: object) -> Method:
    """Our corrector under some settings, as a user gets it."""

    def correct(case: Case) -> Result:
        corrector = Corrector(ColorConfig.model_validate(settings))
        done = corrector.apply(
            case.image, case.range_m, corrector.fit_frame(case.image, case.range_m)
        )
        return np.where(done.unknown[..., None], np.nan, done.image / 255.0)

    return correct


def true_water(case: Case) -> Result:
    """The same correction by the water that the picture was made with."""
    water = case.water
    light = np.maximum(decode_srgb(case.image / 255.0) - water.backscatter(case.range_m), 0)
    return encode_srgb(light / (water.attenuation(case.range_m) * water.white))


def baseline(name: str) -> Method:
    return lambda case: METHODS[name](case.image / 255.0, case.range_m.astype(np.float64))


def in_linear_light(name: str) -> Method:
    """A baseline on decoded values, as its authors ran it on raw images."""

    def correct(case: Case) -> Result:
        return encode_srgb(
            METHODS[name](decode_srgb(case.image / 255.0), case.range_m.astype(np.float64))
        )

    return correct


METHODS_COMPARED: dict[str, Method] = {
    **{name: baseline(name) for name in METHODS},
    **{
        f"{name}, linear light": in_linear_light(name)
        for name in ("gray world", "simple model", "sea-thru")
    },
    "darkest 1 % a bin, gray world log-linear": lambda case: bins_of_range(
        case.image / 255.0, case.range_m, 1.0, 1.0
    ),
    "half of it, 8-norm log-linear": lambda case: bins_of_range(
        case.image / 255.0, case.range_m, 0.5, 8.0
    ),
    "the paper's objective": by_config(method="paper"),
    "stereo-seecolor": by_config(),
}
COLUMNS = {
    "raw": "raw",
    "gray world": "gray world",
    "log-linear gray world": "darkest 1 % a bin, gray world log-linear",
    "paper": "the paper's objective",
    "Sea-thru": "sea-thru",
    "stereo-seecolor": "stereo-seecolor",
}
"""Column of the one table -> method."""
SWITCHES: dict[str, Method] = {
    "as shipped": by_config(),
    "input_encoding: as-is": by_config(input_encoding="as-is"),
    "attenuation: constant": by_config(robust={"attenuation": "constant"}),
    "white_point: none": by_config(robust={"white_point": "none"}),
    "scene_colors: gray": by_config(robust={"scene_colors": "gray"}),
}


def reef_cases(
    seed: int,
    size: tuple[int, int] = (320, 256),
    altitudes_m: tuple[float, ...] = (1.0, 2.0, 3.0, 4.0),
) -> Iterator[Case]:
    """The synthetic reef in three waters from some altitudes."""
    from stereo_seecolor.extras.synthetic.render import Scene
    from stereo_seecolor.extras.synthetic.survey import SurveySpec

    for name, altitude_m in itertools.product(WATERS, altitudes_m):
        scene = Scene.from_spec(
            SurveySpec(
                seed,
                pairs=2,
                lines=1,
                image_size=size,
                altitude_m=(altitude_m, altitude_m),
                water=name,
            )
        )
        pair = scene.render(1)
        truth = np.clip(pair.color.astype(np.float64), 0, 1)
        yield Case(
            f"{name} {altitude_m:g} m",
            pair.rectified.left,
            pair.range_map.range_m,
            truth,
            scene.water.water,
        )


def picture_cases(data: Path) -> Iterator[Case]:
    """Two pictures with their geometry (Middlebury's teddy, OpenCV's aloe) through three waters, at
    and below the surface.
    """
    from stereo_seecolor.extras.synthetic.waters import lit_water

    rng = np.random.default_rng(100)
    for name, disparity, picture in (
        ("teddy", "disparity_x4.pgm", "left.png"),
        ("aloe", "disparity.png", "left.png"),
    ):
        values = cv2.imread(str(data / name / disparity), cv2.IMREAD_GRAYSCALE).astype(np.float64)
        nearest = np.quantile(values[values > 5], 0.98)
        range_m = np.where(values > 5, nearest / np.maximum(values, 1), np.nan).astype(np.float32)
        truth = decode_srgb(cv2.imread(str(data / name / picture))[..., ::-1] / 255.0)
        for water_name, depth_m in itertools.product(WATERS, (0.01, 4.0, 9.0)):
            water = lit_water(water_name, depth_m, max(depth_m - 1, 0.0), 1.5).water
            light = truth * water.white * water.attenuation(range_m) + water.backscatter(range_m)
            gain = 0.9 / np.nanquantile(light.max(axis=-1), 0.99)
            noisy = (
                encode_srgb(np.clip(np.nan_to_num(light * gain), 0, 1))
                + rng.standard_normal(light.shape) / 255
            )
            image = np.round(np.clip(noisy, 0, 1) * 255).astype(np.uint8)
            lit = Water(
                **{**vars(water), "white": water.white * gain, "gamma_inf": water.gamma_inf * gain}
            )
            yield Case(f"{name} {water_name} {depth_m:.0f} m", image, range_m, truth, lit)


def score(case: Case, result: Result) -> tuple[float, float, float]:
    """Mean angle, the same after the best gain a channel, CIEDE2000, where the camera has not
    clipped.
    """
    usable = (case.image < 254).all(axis=-1) & np.isfinite(case.range_m)
    truth = encode_srgb(case.truth / np.quantile(case.truth.max(axis=-1), 0.995))
    result = np.where(usable[..., None], result, np.nan)
    scores = score_truth(result, truth, case.range_m)
    return scores.angle_deg, scores.angle_after_gains_deg, scores.ciede2000


def table(title: str, cases: list[Case], methods: dict[str, Method]) -> None:
    """One row a method: means over the cases, and the worst of them."""
    methods = {**methods, "the true water": true_water}
    print(f"\n### {title}: {len(cases)} cases\n")
    print(
        "| method | angle, degrees | after gains | CIEDE2000 | worst angle | worst after gains | "
        "worst CIEDE2000 |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name, method in methods.items():
        scores = np.array([score(case, method(case)) for case in cases])
        cells = " | ".join(f"{value:.1f}" for value in (*scores.mean(axis=0), *scores.max(axis=0)))
        print(f"| {name} | {cells} |", flush=True)


def card_table(data: Path, methods: dict[str, Method]) -> None:
    """psi and clipped fraction on FLSea's white cards."""
    flsea = data / "flsea"
    print(
        "\n### White cards of FLSea\n\n| method | psi, degrees, card by card | mean | most "
        "clipped |\n| --- | --- | --- | --- |"
    )
    frames = list(card_frames(flsea))
    for name, method in methods.items():
        scores = []
        for case, masks in frames:
            result = np.minimum(method(case), 1)
            scores += [score_neutral(result[mask]) for mask in masks]
        angles = ", ".join(f"{s.psi_deg:.1f}" for s in scores)
        print(
            f"| {name} | {angles} | {np.mean([s.psi_deg for s in scores]):.1f} | "
            f"{max(s.clipped_fraction for s in scores):.0%} |",
            flush=True,
        )


def card_frames(flsea: Path) -> Iterator[tuple[Case, list[np.ndarray]]]:
    """Frames of FLSea with white targets, and the mask of each target."""
    for stem, targets in read_targets(flsea / "neutral_targets.json").items():
        image = cv2.imread(str(flsea / "rgb" / f"{stem}.tiff"))[..., ::-1].copy()
        range_m = cv2.imread(str(flsea / "range" / f"{stem}.tif"), cv2.IMREAD_UNCHANGED)
        range_m = np.where(range_m > 0, range_m, np.nan).astype(np.float32)
        case = Case(stem, image, range_m, image / 255.0, None)
        yield case, [neutral("", target["polygon"], image, range_m).mask for target in targets]


def chart_table() -> None:
    """CIEDE2000 and psi on the chart that stands on the synthetic reef, found by OpenCV as a user's
    would be.
    """
    cases = list(reef_cases(7, (640, 512), (1.0, 2.5)))
    print(
        "\n### The chart on the reef\n\n| | "
        + " | ".join(case.name for case in cases)
        + " |\n|"
        + " --- |" * (len(cases) + 1)
    )
    scores = []
    for case in cases:
        (target,) = targets_of([], case.image, case.range_m)
        results = correct_by_all(case.image, case.range_m, RunConfig())
        scores.append(
            {
                name: score_target(case.name, target, name, result, case.range_m)
                for name, result in results.items()
            }
        )
    for measure, method in itertools.product(
        ("ciede2000", "psi_deg", "clipped_fraction"), scores[0]
    ):
        print(
            f"| {measure}: {method} | "
            + " | ".join(f"{getattr(of[method], measure):.3f}" for of in scores)
            + " |"
        )


Row = tuple[str, str, str, list[str]]
"""What was measured on, real or drawn, the measure, and a cell for each of COLUMNS."""


def by_column(result_of: Callable[[Method], list[float]], style: str = ".1f") -> list[str]:
    """A cell for each column, of the numbers of its method."""
    numbers = [result_of(METHODS_COMPARED[method]) for method in COLUMNS.values()]
    return [", ".join(format(number, style) for number in of_method) for of_method in numbers]


def truth_row(data: str, cases: list[Case]) -> Row:
    """Mean angle to the truth, and CIEDE2000."""
    return (
        data,
        "drawn",
        "angle, CIEDE2000",
        by_column(lambda method: list(np.mean([score(c, method(c)) for c in cases], 0)[[0, 2]])),
    )


def water_rows() -> Iterator[Row]:
    """Photographs with strong colors under waters of measured absorption and scattering."""
    from independent_waters import KINDS
    from photographs_in_water import OPTICAL_DEPTHS, cases_of, score
    from skimage import data

    names = ("coffee", "astronaut", "chelsea")
    pictures = [
        (name, decode_srgb(getattr(data, name)()[::2, ::2] / 255.0), None) for name in names
    ]
    for depth, kind in itertools.product(OPTICAL_DEPTHS[1:], KINDS):
        cases = cases_of(pictures, kind, range(1), depth)
        row = (
            f"photographs ({', '.join(names)}), {kind} water, optical depth {depth[0]:g} to "
            f"{depth[1]:g}"
        )
        yield (
            row,
            "drawn",
            "angle, after gains",
            by_column(
                lambda method, of=cases: list(np.median([score(c, method(c)) for c in of], 0))
            ),
        )


def flsea_row(data: Path) -> Row:
    """White targets of FLSea."""
    frames = list(card_frames(data / "flsea"))

    def psi(method: Method) -> list[float]:
        return [
            np.mean(
                [
                    score_neutral(np.minimum(method(case), 1)[mask]).psi_deg
                    for case, masks in frames
                    for mask in masks
                ]
            )
        ]

    return "FLSea, 5 white targets", "real", "psi", by_column(psi)


def seathru_row(data: Path) -> Row:
    """Charts at several ranges in one frame."""
    image, range_m = (
        read_image(data / "seathru/3374.png"),
        read_range_map(data / "seathru/3374_range.tiff"),
    )
    case, targets, full = (
        Case("3374", image, range_m, image / 255.0, None),
        targets_of([], image, range_m),
        clipped(image / 255.0),
    )

    def of(method: Method) -> list[float]:
        result = np.minimum(method(case), 1)
        psi = [score_target("3374", target, "", result, range_m).psi_deg for target in targets]
        seen = [seen_chart("", target, result, range_m, full) for target in targets]
        return [
            float(np.nanmean(psi)),
            spread_over_charts([chart for chart in seen if chart])[0].angle_deg,
        ]

    return (
        f"Sea-thru 3374, {len(targets)} charts at 4.7 to 9.8 m",
        "real",
        "psi, change of a patch over range",
        by_column(of),
    )


def reef_rows(data: Path, pairs: int) -> Iterator[Row]:
    """The first pairs of a reef dive: colors of sand, and differences of one spot between views."""
    with tempfile.TemporaryDirectory() as folder:
        out, sides = Path(folder) / "out", {side: Path(folder) / side for side in ("left", "right")}
        for side, path in sides.items():
            path.mkdir()
            for file in sorted((data / "acfr" / side).iterdir())[:pairs]:
                (path / file.name).symlink_to(file.resolve())
        config = RunConfig.model_validate({"input": {"refine": True}, "output": {"clouds": False}})
        run(sides["left"], sides["right"], data / "acfr/stereo_calib.mat", out, config)
        finished, others = (
            open_run(out),
            [name for name in COLUMNS if name not in ("raw", "stereo-seecolor")],
        )
        raw, sand = RawImages(finished), {name: [] for name in COLUMNS}
        for frame in finished.frames:
            image, range_m, ours = (
                raw.rectified(frame.name),
                frame.measured_range_m(),
                frame.read("corrected"),
            )
            case, where = (
                Case(frame.name, image, range_m, image / 255.0, None),
                smooth_and_bright(ours, range_m),
            )
            results = {"raw": image / 255.0, "stereo-seecolor": ours / 255.0}
            results |= {
                name: np.clip(METHODS_COMPARED[COLUMNS[name]](case), 0, 1) for name in others
            }
            for name, result in results.items():
                sand[name].append(decode_srgb(result[where]))
                path = Path(folder) / f"by {name}"
                path.mkdir(exist_ok=True)
                shown = np.round(np.nan_to_num(result) * 255).astype(np.uint8)
                cv2.imwrite(str(path / f"{frame.name}.png"), shown[..., ::-1])
        report = evaluate_spread(out, [Path(folder) / f"by {name}" for name in others])
    medians = [np.nanmedian(np.concatenate(sand[name]), axis=0) for name in COLUMNS]
    dive = f"acfr, {pairs} pairs of a reef dive"
    yield (
        f"{dive}: sand is 1.05 to 1.22, 0.70 to 0.92",
        "real",
        "R/G, B/G",
        [f"{m[0] / m[1]:.2f}, {m[2] / m[1]:.2f}" for m in medians],
    )
    spreads = {"by raw": report.raw, "by stereo-seecolor": report.corrected, **report.others}
    of = [spreads[f"by {name}"] for name in COLUMNS]
    cells = [f"{spread.angle_deg:.1f}, {spread.luminance:.2f}" for spread in of]
    yield f"{dive}: one spot in different views", "real", "angle, log luminance", cells


def smooth_and_bright(image: np.ndarray, range_m: np.ndarray) -> np.ndarray:
    """(H, W) the brightest tenth of the smoother half of the pixels of known range: sand,
    mostly.
    """
    light = cv2.blur(decode_srgb(image / 255.0) @ LUMINANCE, (9, 9))
    rough = np.sqrt(
        np.maximum(cv2.blur((decode_srgb(image / 255.0) @ LUMINANCE) ** 2, (9, 9)) - light**2, 0)
    ) / (light + 1e-3)
    known = np.isfinite(range_m)
    smooth = known & (rough < np.median(rough[known]))
    return smooth & (light > np.quantile(light[smooth], 0.9))


def one_table(data: Path, first_seed: int, cases: int, reef_pairs: int) -> Iterator[str]:
    """The lines of the table, as they are measured."""
    made: list[Callable[[], Iterable[Row]]] = [
        lambda: [truth_row("drawn reef, three waters, 1 to 4 m", list(reef_cases(first_seed)))],
        lambda: [
            truth_row(
                "drawn scenes (dead leaves)",
                [make_case(seed) for seed in range(first_seed, first_seed + cases)],
            )
        ],
        water_rows,
    ]
    if data.is_dir():
        made[:0] = [
            lambda: [flsea_row(data)],
            lambda: [seathru_row(data)],
            lambda: reef_rows(data, reef_pairs),
        ]
        made.append(lambda: [truth_row("two rooms in drawn waters", list(picture_cases(data)))])
    yield f"| data | real or drawn | measure | {' | '.join(COLUMNS)} |"
    yield "| --- " * (3 + len(COLUMNS)) + "|"
    for row, kind, measure, cells in itertools.chain.from_iterable(rows() for rows in made):
        yield f"| {row} | {kind} | {measure} | {' | '.join(cells)} |"


def write_table(lines: list[str]) -> None:
    """Put the table into docs/color-quality.md."""
    before, rest = PAGE.read_text().split(TABLE_BEGIN)
    PAGE.write_text(
        f"{before}{TABLE_BEGIN}\n\n"
        + "\n".join(lines)
        + f"\n\n{TABLE_END}{rest.split(TABLE_END)[1]}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--first-seed", type=int, default=100)
    parser.add_argument("--reef-seed", type=int, default=100)
    parser.add_argument(
        "--data",
        type=Path,
        default=Path(os.environ.get("STEREO_SEECOLOR_DATA", ".")),
        help="of real frames: tests/DATA.md",
    )
    parser.add_argument("--methods", help="only methods whose name holds this")
    parser.add_argument("--table", action="store_true", help="only the one table of all data")
    parser.add_argument("--write", action="store_true", help="write it into docs/color-quality.md")
    parser.add_argument(
        "--reef-pairs", type=int, default=8, help="of the reef dive, for the one table"
    )
    asked = parser.parse_args()
    if asked.table:
        lines = []
        for line in one_table(asked.data, asked.first_seed, asked.cases, asked.reef_pairs):
            print(line, flush=True)
            lines.append(line)
        if asked.write:
            write_table(lines)
        return
    start = time.perf_counter()
    drawn = [make_case(seed) for seed in range(asked.first_seed, asked.first_seed + asked.cases)]
    reef = list(reef_cases(asked.reef_seed))
    if asked.methods:
        for name in [name for name in METHODS_COMPARED if asked.methods not in name]:
            del METHODS_COMPARED[name]
        SWITCHES.clear()
    table("Synthetic scenes in drawn waters", drawn, METHODS_COMPARED)
    table("Synthetic reef, three waters, 1 to 4 m", reef, METHODS_COMPARED)
    chart_table()
    if asked.data.is_dir():
        table(
            "Pictures of rooms in three waters", list(picture_cases(asked.data)), METHODS_COMPARED
        )
        card_table(asked.data, METHODS_COMPARED)
    table("Switches: synthetic scenes", drawn, SWITCHES)
    table("Switches: synthetic reef", reef, SWITCHES)
    if asked.data.is_dir():
        card_table(asked.data, SWITCHES)
    print(f"\n{time.perf_counter() - start:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
