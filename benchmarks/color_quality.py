"""Every color method on known truth and on white cards in the sea: tables of docs/lab/color.md.
color_table.py makes the one table of docs/color-quality.md.

    python benchmarks/color_quality.py [--cases 24] [--first-seed 100] [--data FOLDER]

Seeds below 100 were looked at while the method was made; those from 100 on were not.
"""

import argparse
import itertools
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from arguments import add_data
from color_cases import Case, make_case
from numpy.typing import NDArray

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.response.measure import measure_response
from stereo_seecolor.config import ColorConfig, RunConfig
from stereo_seecolor.extras.evaluation.baselines import METHODS, expose
from stereo_seecolor.extras.evaluation.charts.scores import correct_by_all, score_target
from stereo_seecolor.extras.evaluation.charts.targets import neutral, read_targets, targets_of
from stereo_seecolor.extras.evaluation.measures import score_neutral, score_truth
from stereo_seecolor.files.srgb import decode_srgb, encode_srgb
from stereo_seecolor.inputs.images import read_image
from stereo_seecolor.records import Map, Water

Result = np.ndarray
Method = Callable[[Case], Result]
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
SWITCHES: dict[str, Method] = {
    "as shipped": by_config(),
    "input_encoding: as-is": by_config(input_encoding="as-is"),
    "white_point: none": by_config(robust={"white_point": "none"}),
    "white_point: gray": by_config(robust={"white_point": "gray"}),
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


def pictures(data: Path) -> Iterator[tuple[str, NDArray[np.float64], Map]]:
    """Two pictures with their geometry: Middlebury's teddy, OpenCV's aloe. Name, light, range."""
    for name, disparity in (("teddy", "disparity_x4.pgm"), ("aloe", "disparity.png")):
        values = cv2.imread(str(data / name / disparity), cv2.IMREAD_GRAYSCALE).astype(np.float64)
        nearest = np.quantile(values[values > 5], 0.98)
        range_m = np.where(values > 5, nearest / np.maximum(values, 1), np.nan).astype(np.float32)
        yield name, decode_srgb(cv2.imread(str(data / name / "left.png"))[..., ::-1] / 255), range_m


def picture_cases(data: Path) -> Iterator[Case]:
    """The pictures through three waters, at and below the surface."""
    from stereo_seecolor.extras.synthetic.waters import lit_water

    rng = np.random.default_rng(100)
    for name, truth, range_m in pictures(data):
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
    """Frames of FLSea with white targets, and the mask of each target.

    Every method gets them as the response of all frames, measured, encodes them.
    """
    files = sorted((flsea / "rgb").glob("*.tiff"))
    response = measure_response([read_image(file) for file in files]).response
    for stem, targets in read_targets(flsea / "neutral_targets.json").items():
        raw = read_image(flsea / "rgb" / f"{stem}.tiff")
        image = response.of_frame(raw).standard(raw)
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--first-seed", type=int, default=100)
    parser.add_argument("--reef-seed", type=int, default=100)
    add_data(parser)
    parser.add_argument("--methods", help="only methods whose name holds this")
    asked = parser.parse_args()
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
