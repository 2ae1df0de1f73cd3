"""``synthesize``: render a dive over a reef with known truth."""

from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.extras.synthetic import dive
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.progress import Listener, Silence
from stereo_seecolor.records import FrameRow


@dataclass(frozen=True)
class SynthesizedDive:
    """A rendered dive in ``out``: left/, right/, cam.yaml, trajectory.tum and truth/. spec: what it
    was rendered from.
    """

    out: Path
    spec: SurveySpec


def synthesize(spec: SurveySpec, out: Path, listener: Listener | None = None) -> SynthesizedDive:
    """Render the survey into ``out`` (docs/synthetic.md). Raises OutputError if the folder cannot
    be written.
    """
    listener = listener or Silence()
    listener.begin("render", spec.pairs)
    dive.synthesize(
        spec, out, lambda finished, pairs: listener.advance(FrameRow(f"pair {finished}"))
    )
    return SynthesizedDive(out, spec)
