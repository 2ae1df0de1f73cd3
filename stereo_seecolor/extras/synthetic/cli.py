"""Commands that render a synthetic dive with ground truth: synthesize, demo."""

from pathlib import Path
from typing import Annotated

from calibration.errors import counted
from stereo_seecolor.cli import options as opt
from stereo_seecolor.cli.command import command
from stereo_seecolor.cli.report import Report
from stereo_seecolor.cli.result_texts import run_text
from stereo_seecolor.cli.results import run_content, run_exit_code
from stereo_seecolor.extras.evaluation.score_texts import truth_text

PairCount = Annotated[int, opt.option("--pairs", "N", "Number of stereo pairs.", min=1)]


LineCount = Annotated[int, opt.option("--lines", "N", "Number of parallel survey lines.", min=1)]


ImageSize = Annotated[str, opt.option("--size", "WIDTHxHEIGHT", "Image size in pixels.")]


WaterName = Annotated[
    str, opt.option("--water", "NAME", "Kind of water: blue-ocean, coastal-green or turbid.")
]


Seed = Annotated[
    int, opt.option("--seed", "N", "Random seed; each seed gives another reef and track.", min=0)
]


@command("Accuracy", "synthesize --out dive --pairs 20 --lines 2 --water turbid")
def synthesize(
    out: opt.Out = Path("dive"),
    pairs: PairCount = 12,
    lines: LineCount = 2,
    size: ImageSize = "640x512",
    water: WaterName = "blue-ocean",
    seed: Seed = 7,
    *,
    report: Report,
) -> None:
    """Render a dive over a synthetic reef, with ground truth (docs/synthetic.md)."""
    from stereo_seecolor.extras.synthetic.dive import parse_spec
    from stereo_seecolor.extras.synthetic.dive import synthesize as render

    with report.working() as listener:
        spec = parse_spec(pairs=pairs, lines=lines, size=size, water=water, seed=seed)
        render(spec, out, listener)
    text = (
        f"{counted(pairs, 'pair')} in {out}: left/, right/, cam.yaml, trajectory.tum, and the "
        "truth in truth/\n"
    )
    report.end({"out": out, "spec": spec}, text)


@command("Accuracy", "demo --out demo")
def demo(
    out: opt.Out = Path("demo"), workers: opt.Workers = opt.DEFAULT_WORKERS, *, report: Report
) -> None:
    """Render a small reef, run all stages on it, and compare the result with the ground truth."""
    from stereo_seecolor.dive.run_options import RunOptions
    from stereo_seecolor.extras.synthetic.demo import demo as show

    with report.working() as listener:
        result = show(out, RunOptions(workers, listener=listener))
    text = run_text(result.summary, result.out) + (truth_text(result.truth) if result.truth else "")
    content = {**run_content(result.summary, result.out), "truth": result.truth}
    report.end(content, text, run_exit_code(result.summary))
