"""``demo``: a small dive is rendered, run, and compared with its truth."""

from dataclasses import dataclass, replace
from pathlib import Path

from stereo_seecolor.commands.run import run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.extras.evaluation.evaluate_run import evaluate
from stereo_seecolor.extras.evaluation.truth import TruthReport
from stereo_seecolor.extras.synthetic.dive import synthesize
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.run_folder.frame_table import RunSummary

DEMO_PAIRS = 4


@dataclass(frozen=True)
class DemoResult:
    """The run over the rendered dive, in ``out``. truth: its errors, None if interrupted."""

    out: Path
    summary: RunSummary
    truth: TruthReport | None


def demo(out: Path, options: RunOptions | None = None) -> DemoResult:
    """Render a dive into ``out``/dive, run it into ``out``/out, replacing an earlier demo, and
    compare it with the truth.

    Raises OutputError, and all that run raises.
    """
    options = replace(options or RunOptions(), overwrite=True)
    dive, done = out / "dive", out / "out"
    synthesize(SurveySpec(pairs=DEMO_PAIRS, lines=1), dive, options.listener)
    config = load_config(None, ["color.lock=survey"])
    summary = run(dive / "left", dive / "right", dive / "cam.yaml", done, config, options)
    return DemoResult(done, summary, None if summary.stopped else evaluate(done, dive / "truth"))
