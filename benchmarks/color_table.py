"""The one table of docs/color-quality.md: every method on every data set, real or synthetic.

    python benchmarks/color_table.py [PART ...] [--write] [--data FOLDER]

Prints the rows of the parts named, or of all. --write puts each part into the page as soon as it is
measured: a row of the same data and measure is replaced, others stay; rows that the README shows
are replaced there, too. A part that fails is named,
and the rest goes on.
"""

import itertools
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from arguments import add_data, parser_of
from benthic_scenes import GROUPS, SPLIT, prior_without
from benthic_scenes import drawn as benthic_scene
from color_cases import Case, make_case
from color_quality import METHODS_COMPARED, Method, card_frames, picture_cases, reef_cases, score
from independent_waters import KINDS
from photographs_in_water import OPTICAL_DEPTHS, cases_of
from photographs_in_water import score as score_photograph
from skimage import data as photographs

from stereo_seecolor.commands.run import run
from stereo_seecolor.config import RunConfig
from stereo_seecolor.extras.evaluation.charts.chart_spread import seen_chart, spread_over_charts
from stereo_seecolor.extras.evaluation.charts.scores import score_target
from stereo_seecolor.extras.evaluation.charts.targets import targets_of
from stereo_seecolor.extras.evaluation.evaluate_run import evaluate_spread
from stereo_seecolor.extras.evaluation.measures import (
    angle_deg,
    clipped,
    score_neutral,
    score_truth,
)
from stereo_seecolor.extras.synthetic.dive import synthesize
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.files.srgb import LUMINANCE, decode_srgb, encode_srgb
from stereo_seecolor.inputs.images import read_image, read_range_map
from stereo_seecolor.report.frame_files import FrameFiles
from stereo_seecolor.run_folder.finished_run import open_run

ROOT = Path(__file__).resolve().parents[1]
PAGE, README = ROOT / "docs/color-quality.md", ROOT / "README.md"
TABLE_BEGIN, TABLE_END = (
    "<!-- table: written by benchmarks/color_table.py --write -->",
    "<!-- end of table -->",
)
OURS = "stereo-seecolor"
COLUMNS: dict[str, tuple[str, ...]] = {
    "raw": ("raw",),
    "gray world": ("gray world", "gray world, linear light"),
    "log-linear gray world": ("half of it, 8-norm log-linear",),
    "Sea-thru": ("sea-thru", "sea-thru, linear light"),
    "DeepSeeColor": ("the paper's objective",),
    OURS: (OURS,),
}
"""Column -> variants of a method, of which each row gives the better one."""
VARIANTS = tuple(itertools.chain.from_iterable(COLUMNS.values()))
FIRST_SEED, SCENES, BENTHIC_WATERS = 100, 12, 12
STRONG = ("coffee", "astronaut", "chelsea")
"""Photographs with strong colors."""
REEF_PAIRS = 10
"""Of the reef dive: the paper's method takes a minute for each."""
NIGHT = SurveySpec(seed=FIRST_SEED, pairs=8, image_size=(320, 256), lamp_intensity=200)

REEF = RunConfig.model_validate({"input": {"refine": True}, "output": {"preset": "no-clouds"}})

Row = tuple[str, str, str, list[str]]
"""What was measured on, real or synthetic, the measure, and a cell for each of COLUMNS."""


def cells_of(numbers: Mapping[str, Sequence[float]]) -> list[str]:
    """A cell for each column, of the numbers by each variant: of the one whose first is lowest."""
    best = [min((numbers[v] for v in of if v in numbers), key=first) for of in COLUMNS.values()]
    return [", ".join(f"{number:.1f}" for number in of_method) for of_method in best]


def first(numbers: Sequence[float]) -> float:
    return numbers[0]


def by_column(result_of: Callable[[Method], Sequence[float]]) -> list[str]:
    """A cell for each column, of what is measured on a method."""
    return cells_of({name: result_of(METHODS_COMPARED[name]) for name in VARIANTS})


def flsea_rows(data: Path) -> Iterator[Row]:
    """White targets."""
    frames = list(card_frames(data / "flsea"))

    def psi(method: Method) -> list[float]:
        results = [(np.minimum(method(case), 1), masks) for case, masks in frames]
        return [np.mean([score_neutral(of[m]).psi_deg for of, masks in results for m in masks])]

    yield "FLSea, 5 white targets", "real", "psi", by_column(psi)


def chart_rows(data: Path) -> Iterator[Row]:
    """Charts at several ranges in one frame."""
    image = read_image(data / "seathru/3374.png")
    range_m = read_range_map(data / "seathru/3374_range.tiff")
    case = Case("3374", image, range_m, image / 255.0, None)
    targets, full = targets_of([], image, range_m), clipped(image / 255.0)

    def of(method: Method) -> list[float]:
        result = np.minimum(method(case), 1)
        psi = [score_target("3374", target, "", result, range_m).psi_deg for target in targets]
        seen = [seen_chart("", target, result, range_m, full) for target in targets]
        spread = spread_over_charts([chart for chart in seen if chart])[0].angle_deg
        return [float(np.nanmean(psi)), spread]

    name = f"Sea-thru 3374, {len(targets)} charts"
    numbers = {one: of(METHODS_COMPARED[one]) for one in VARIANTS}
    # the README compares each of the two by itself
    parts = [cells_of({one: [n[i]] for one, n in numbers.items()}) for i in (0, 1)]
    cells = [", ".join(both) for both in zip(*parts, strict=True)]
    yield name, "real", "psi; change of a patch over range", cells


def dive_results(
    left: Path, right: Path, rig: Path, out: Path, config: RunConfig, methods: Sequence[str]
) -> Iterator[tuple[str, np.ndarray, dict[str, np.ndarray]]]:
    """Run a dive into ``out``; name, measured range and the image by each method of every frame,
    all by the run's ranges.
    """
    run(left, right, rig, out, config)
    finished = open_run(out)
    files = FrameFiles.rectifying(finished)
    for frame in finished.frames:
        image, range_m = files.raw(frame), frame.measured_range_m()
        case = Case(frame.name, image, range_m, image / 255.0, None)
        results = {name: METHODS_COMPARED[name](case) for name in methods if name != OURS}
        yield frame.name, range_m, {**results, OURS: frame.read("corrected") / 255.0}


def reef_rows(data: Path) -> Iterator[Row]:
    """A reef dive: colors of sand, of parts of the picture, and of one spot between views."""
    dive = data / "acfr"
    columns = {variants[0]: column for column, variants in COLUMNS.items()}
    sand: dict[str, list[np.ndarray]] = {column: [] for column in COLUMNS}
    fifths: dict[str, list[np.ndarray]] = {column: [] for column in COLUMNS}
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        by = {column: Path(folder) / f"by {column}" for column in COLUMNS}
        for path in by.values():
            path.mkdir()
        sides = part_of(dive, slice(REEF_PAIRS), Path(folder))
        for name, range_m, results in dive_results(*sides, out, REEF, list(columns)):
            where, known = smooth_and_bright(results[OURS], range_m), np.isfinite(range_m)
            for method, result in results.items():
                column, shown = columns[method], np.clip(result, 0, 1)
                light = decode_srgb(shown)
                sand[column].append(light[where])
                fifths[column].append(
                    np.array(
                        [
                            np.nanmedian(light[:, part][known[:, part]], axis=0)
                            for part in np.array_split(np.arange(known.shape[1]), 5)
                        ]
                    )
                )
                pixels = np.round(np.nan_to_num(shown) * 255).astype(np.uint8)
                cv2.imwrite(str(by[column] / f"{name}.png"), pixels[..., ::-1])
        others = [path for column, path in by.items() if column not in ("raw", OURS)]
        report = evaluate_spread(out, others)
    of = {**{name.removeprefix("by "): spread for name, spread in report.others.items()}}
    of |= {"raw": report.raw, OURS: report.corrected}
    title = f"acfr, first {len(sand[OURS])} pairs"
    spreads = [of[column] for column in COLUMNS]
    medians = [np.nanmedian(np.concatenate(sand[column]), axis=0) for column in COLUMNS]
    reddest = [np.mean(fifths[column], axis=0) for column in COLUMNS]
    rows = {
        "sand: R/G, B/G (1.05 to 1.22, 0.70 to 0.92)": [
            f"{m[0] / m[1]:.2f}, {m[2] / m[1]:.2f}" for m in medians
        ],
        "R/G of five columns, largest by smallest": [
            f"{np.max(m[:, 0] / m[:, 1]) / np.min(m[:, 0] / m[:, 1]):.2f}" for m in reddest
        ],
        "one spot in different views: angle; log luminance": [
            f"{s.angle_deg:.1f}; {s.luminance:.2f}" for s in spreads
        ],
        "border against center: R/G, B/G, %": [
            ", ".join(f"{100 * s.border[i]:+.1f}±{100 * s.border_error[i]:.1f}" for i in (1, 2))
            for s in spreads
        ],
        "R/B of the farthest over the nearest": [f"{s.far_red_to_blue:.2f}" for s in spreads],
    }
    for measure, cells in rows.items():
        yield title, "real", measure, cells


def halves_rows(data: Path) -> Iterator[Row]:
    """Halves of the reef dive that are solved apart, on the frame that both hold, and the dive
    encoded by sRGB before the run. Other methods correct each frame alone.
    """
    dive, nothing = data / "acfr", ["" for _ in COLUMNS][1:]
    with tempfile.TemporaryDirectory() as folder:
        made = []
        for part in (slice(REEF_PAIRS + 1), slice(REEF_PAIRS, None)):
            sides = part_of(dive, part, Path(folder) / f"{part.start or 0}")
            run(*sides, Path(folder) / f"out {part.start or 0}", REEF)
            made.append(open_run(Path(folder) / f"out {part.start or 0}"))
        (name,) = {frame.name for frame in made[0].frames} & {f.name for f in made[1].frames}
        first, second = (decode_srgb(one.frame(name).read("corrected") / 255.0) for one in made)
        seen = (np.minimum(first, second) > 0.01).all(-1) & (np.maximum(first, second) < 0.9).all(
            -1
        )
        ratio = np.log(first[seen]) - np.log(second[seen])
        of = {
            "R/G": ratio[:, 0] - ratio[:, 1],
            "B/G": ratio[:, 2] - ratio[:, 1],
            "luminance": ratio.mean(axis=1),
        }
        cell = ", ".join(f"{np.exp(np.median(values)):.2f}" for values in of.values())
        title = "acfr, two halves solved apart"
        yield title, "real", "first over second: R/G, B/G, brightness", [*nothing, cell]
        encoded = Path(folder) / "encoded"
        for side in ("left", "right"):
            (encoded / side).mkdir(parents=True)
            for file in sorted((dive / side).iterdir()):
                image = cv2.imread(str(file))
                shown = np.round(255 * encode_srgb(image / 255.0)).astype(np.uint8)
                cv2.imwrite(str(encoded / side / f"{file.stem}.png"), shown)
        rig = dive / "stereo_calib.mat"
        runs = []
        for source, out in ((dive, "linear"), (encoded, "as sRGB")):
            run(source / "left", source / "right", rig, Path(folder) / out, REEF)
            runs.append(open_run(Path(folder) / out))
        difference = np.mean(
            [
                np.abs(
                    frame.read("corrected").astype(np.float64)
                    - runs[1].frame(frame.name).read("corrected")
                ).mean()
                for frame in runs[0].frames
            ]
        )
        title = f"acfr, {len(runs[0].frames)} pairs"
        measure = "encoded by sRGB before the run: mean difference, of 255"
        yield title, "real", measure, [*nothing, f"{difference:.1f}"]


def part_of(dive: Path, part: slice, folder: Path) -> tuple[Path, Path, Path]:
    """Left and right folder and calibration of some pairs of a dive."""
    left, right = (folder / side for side in ("left", "right"))
    for path in (left, right):
        path.mkdir(parents=True)
        for file in sorted((dive / path.name).iterdir())[part]:
            (path / file.name).symlink_to(file.resolve())
    return left, right, dive / "stereo_calib.mat"


def smooth_and_bright(image: np.ndarray, range_m: np.ndarray) -> np.ndarray:
    """(H, W) the brightest tenth of the smoother half of the pixels of known range: sand,
    mostly.
    """
    luminance = decode_srgb(image) @ LUMINANCE
    light = cv2.blur(luminance, (9, 9))
    rough = np.sqrt(np.maximum(cv2.blur(luminance**2, (9, 9)) - light**2, 0)) / (light + 1e-3)
    known = np.isfinite(range_m)
    smooth = known & (rough < np.median(rough[known]))
    return smooth & (light > np.quantile(light[smooth], 0.9))


def synthetic_dive_rows(data: Path) -> Iterator[Row]:
    """Synthetic dives, run as a user runs them: the sample dive by day, another by night with
    lamps.
    """
    with tempfile.TemporaryDirectory() as folder:
        night = Path(folder) / "night"
        synthesize(NIGHT, night)
        for title, dive in (("sample dive", ROOT / "data_samples/reef"), ("by night", night)):
            config = RunConfig.model_validate({"output": {"preset": "no-clouds"}})
            out = Path(folder) / f"out {title}"
            sides = (dive / "left", dive / "right", dive / "cam.yaml")
            scores: dict[str, list[tuple[float, float]]] = {
                variants[-1]: [] for variants in COLUMNS.values()
            }
            for name, range_m, results in dive_results(*sides, out, config, list(scores)):
                truth = read_image(dive / "truth/color" / f"{name}.png") / 255.0
                for method, result in results.items():
                    known = np.where(np.isfinite(range_m)[..., None], result, np.nan)
                    of = score_truth(known, truth)
                    scores[method].append((of.angle_deg, of.ciede2000))
            cells = cells_of({name: np.mean(of, axis=0) for name, of in scores.items()})
            frames = f"synthetic dive, {title}, {len(scores[OURS])} pairs"
            yield frames, "synthetic", "angle, CIEDE2000", cells


def truth_row(title: str, cases: list[Case]) -> Row:
    """Mean angle to the truth, and CIEDE2000."""
    cells = by_column(lambda method: np.mean([score(c, method(c)) for c in cases], 0)[[0, 2]])
    return f"{title}, {len(cases)} images", "synthetic", "angle, CIEDE2000", cells


def scene_rows(data: Path) -> Iterator[Row]:
    """Single pictures through synthetic waters, with their true ranges."""
    yield truth_row("synthetic reef, three waters, 1 to 4 m", list(reef_cases(FIRST_SEED)))
    seeds = range(FIRST_SEED, FIRST_SEED + SCENES)
    yield truth_row("dead leaves, synthetic waters", [make_case(seed) for seed in seeds])
    if data.is_dir():
        yield truth_row("two rooms, three waters at 4 m", list(picture_cases(data))[1::3])


def photograph_rows(data: Path) -> Iterator[Row]:
    """Photographs with strong colors under waters of measured absorption and scattering."""
    pictures = [
        (name, decode_srgb(getattr(photographs, name)()[::2, ::2] / 255.0), None) for name in STRONG
    ]
    for depth, kind in itertools.product(OPTICAL_DEPTHS[1:], KINDS):
        cases = cases_of(pictures, kind, range(1), depth)
        yield (
            f"photographs, {kind}, {depth[0]:g}-{depth[1]:g}",
            "synthetic",
            "angle; after scaling",
            by_column(
                lambda method, of=cases: np.median([score_photograph(c, method(c)) for c in of], 0)
            ),
        )


def benthic_rows(data: Path) -> Iterator[Row]:
    """Scenes of spectra that the prior does not know, in waters of measured properties."""
    angles = {method: {group: [] for group in GROUPS} for method in VARIANTS}
    for shown, kind, seed in itertools.product(SPLIT, KINDS, range(BENTHIC_WATERS // len(KINDS))):
        scene = benthic_scene(shown, kind, seed)
        case = Case("", scene.image, scene.range_m, scene.truth, scene.water)
        truth = encode_srgb(scene.truth / scene.truth.max())
        for method in VARIANTS:
            with prior_without(shown):
                off = angle_deg(METHODS_COMPARED[method](case), truth)
            off[clipped(scene.image / 255.0)] = np.nan
            for group, words in GROUPS.items():
                things = [k for k in np.unique(scene.kind) if any(word in k for word in words)]
                inside = np.isin(scene.kind, things)
                if inside.sum() > 500:
                    angles[method][group].append(np.nanmedian(off[inside]))
    cells = cells_of(
        {method: [np.median(of[group]) for group in GROUPS] for method, of in angles.items()}
    )
    number = len(SPLIT) * BENTHIC_WATERS
    title = f"{number} benthic scenes, spectra not in the prior"
    yield title, "synthetic", f"angle: {', '.join(GROUPS)}", cells


PARTS: dict[str, Callable[[Path], Iterator[Row]]] = {
    "flsea": flsea_rows,
    "charts": chart_rows,
    "acfr": reef_rows,
    "halves": halves_rows,
    "dives": synthetic_dive_rows,
    "scenes": scene_rows,
    "benthic": benthic_rows,
    "photographs": photograph_rows,
}
REAL = ("flsea", "charts", "acfr", "halves")
"""Parts that need the frames of tests/DATA.md."""


def line_of(row: Row) -> str:
    data, kind, measure, cells = row
    return (
        f"| {data} | {'**real**' if kind == 'real' else kind} | {measure} | {' | '.join(cells)} |"
    )


def with_rows(page: str, rows: list[str]) -> str:
    """The page with these lines in its table: in place of those of the same data and measure, or at
    its end.
    """
    before, rest = page.split(TABLE_BEGIN)
    table, after = rest.split(TABLE_END)
    head = [f"| data | real or synthetic | measure | {' | '.join(COLUMNS)} |"]
    head += ["|" + "---|" * (3 + len(COLUMNS))]
    lines = {key(line): line for line in table.strip().splitlines()[2:]}
    lines |= {key(line): line for line in rows}
    return "\n".join([before + TABLE_BEGIN, "", *head, *lines.values(), "", TABLE_END + after])


def with_same_rows(readme: str, page: str) -> str:
    """The README with the rows of the page's table that it shows, as they are there now."""
    rows = {key(line): line for line in page.split(TABLE_BEGIN)[1].splitlines()}
    return "\n".join(rows.get(key(line), line) for line in readme.splitlines()) + "\n"


def key(line: str) -> tuple[str, ...]:
    """Data and measure of a row."""
    return tuple(line.split(" | ")[:3:2])


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--write", action="store_true", help="write them into the page")
    add_data(parser, "no data")
    asked = parser.parse_args()
    if unknown := set(asked.parts) - set(PARTS):
        parser.error(f"no such part: {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    failed = []
    for name in asked.parts or PARTS:
        if name in REAL and not asked.data.is_dir():
            failed.append(f"{name} (no --data)")
            continue
        rows = []
        try:
            for row in PARTS[name](asked.data):
                rows.append(line_of(row))
                print(rows[-1], flush=True)
        except Exception:  # the other parts are measured all the same
            traceback.print_exc()
            failed.append(name)
        if asked.write:
            page = with_rows(PAGE.read_text(encoding="utf-8"), rows)
            PAGE.write_text(page, encoding="utf-8")
            README.write_text(with_same_rows(README.read_text(encoding="utf-8"), page), "utf-8")
    if failed:
        sys.exit(f"not measured: {', '.join(failed)}")


if __name__ == "__main__":
    main()
