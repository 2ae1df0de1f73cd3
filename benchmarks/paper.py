"""The two tables of the DeepSeeColor paper, as far as data here allow, beside its numbers: psi on
gray patches, and time.

    python benchmarks/paper.py [--data FOLDER]

psi: the grays of the four charts in Sea-thru's frame 3374 of set D5 (8 bits, where the paper had
raw images), and FLSea's white targets.
Time: milliseconds of the processor, median, on one thread, on drawn frames; the paper's are of an
NVIDIA RTX A6000.
"""

import statistics
import time
from collections.abc import Callable
from pathlib import Path

import color_speed
import torch
from arguments import add_data, parser_of

from stereo_seecolor.color.corrector import Corrector
from stereo_seecolor.color.fitting.paper import Training
from stereo_seecolor.compute.threads import limit_cores
from stereo_seecolor.config import ColorConfig, PaperConfig, RunConfig
from stereo_seecolor.extras.evaluation.charts.scores import evaluate_charts

PRINTED_D5 = {"raw": "17, 16, 15, 17", "sea-thru": "4, 3, 5, 3", "paper": "9, 10, 10, 11"}
"""Table I of the paper, row D5_3374."""
PRINTED_MS = {"0.7 M": "6.2 + 9.9 = 16.1", "2.4 M": "6.4 + 10.5 = 16.9"}
"""Table II: backscatter and attenuation, one iteration."""
SIZES = {"0.7 M": (968, 720), "1.3 M": (1280, 1024), "2.4 M": (1952, 1242)}
STEPS = 100


def angles(
    title: str, images: Path, ranges: Path, targets: Path | None, printed: dict[str, str]
) -> None:
    """psi of each method on each target, and of the paper's method with the final sigmoid as
    printed.
    """
    print(
        f"\n| {title} | psi, degrees, target by target | mean | in the paper |\n| --- | --- | --- "
        "| --- |"
    )
    as_printed = RunConfig(color=ColorConfig(paper=PaperConfig(final_sigmoid=True)))
    for config, chosen in ((RunConfig(), None), (as_printed, "paper")):
        rows = evaluate_charts(images, ranges, targets, config).rows
        for method in dict.fromkeys(row.method for row in rows):
            if chosen in (None, method):
                psi = [row.psi_deg for row in rows if row.method == method]
                name = f"{method}, final sigmoid" if chosen else method
                each = ", ".join(f"{angle:.1f}" for angle in psi)
                print(
                    f"| {name} | {each} | {statistics.mean(psi):.1f} | {printed.get(name, '')} |",
                    flush=True,
                )


def milliseconds(work: Callable[[], object]) -> float:
    seconds = []
    for _ in range(STEPS):
        start = time.process_time()
        work()
        seconds.append(time.process_time() - start)
    return 1000 * statistics.median(seconds)


def times() -> None:
    """Time of one step of both networks, and of a whole frame with one step, from pixels to the
    corrected image.
    """
    print(
        "\n| pixels | count | a step of both networks | apply | frame with one step | a step in "
        "the paper |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    corrector = Corrector(ColorConfig(method="paper", paper=PaperConfig(iterations_per_frame=1)))
    for name, (width, height) in SIZES.items():
        color_speed.SIZE = (height, width)
        image, range_m = color_speed.frame(0)
        table = corrector.measure(image, range_m)
        water, training = corrector.fit(table), Training(table, corrector.config.paper, "srgb")

        def frame(image=image, range_m=range_m, water=water) -> None:
            counted = corrector.measure(image, range_m)
            corrector.apply(image, range_m, corrector.fit(counted, water), counted)

        def apply(image=image, range_m=range_m, water=water, table=table) -> None:
            corrector.apply(image, range_m, water, table)

        def count(image=image, range_m=range_m) -> None:
            corrector.measure(image, range_m)

        each = " | ".join(
            f"{milliseconds(work):.1f}" for work in (count, training.step, apply, frame)
        )
        print(f"| {name} | {each} | {PRINTED_MS.get(name, '')} |", flush=True)


def main() -> None:
    parser = parser_of(__doc__)
    add_data(parser, "data")
    data = parser.parse_args().data
    torch.set_num_threads(1)
    limit_cores(1)
    if (data / "seathru").is_dir():
        angles(
            "Sea-thru D5 3374",
            data / "seathru" / "*.png",
            data / "seathru" / "*.tiff",
            None,
            PRINTED_D5,
        )
    if (data / "flsea").is_dir():
        flsea = data / "flsea"
        angles("FLSea", flsea / "rgb", flsea / "range", flsea / "neutral_targets.json", {})
    times()


if __name__ == "__main__":
    main()
