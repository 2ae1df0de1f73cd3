"""What ``run`` says of a calibration before it starts: the same as ``check``."""

from dataclasses import replace
from pathlib import Path

import pytest

from calibration import StereoRig
from calibration.formats import load_rig
from stereo_seecolor.commands.dive_rig import pairs_of
from stereo_seecolor.commands.first_look import first_notes
from stereo_seecolor.config import RunConfig
from stereo_seecolor.pipeline import Pipeline

REEF = Path(__file__).resolve().parents[1] / "data_samples" / "reef"


def lowered(rig: StereoRig, by_px: float) -> StereoRig:
    """The rig with the right camera's center lower than it is."""
    K = rig.right.K.copy()
    K[1, 2] += by_px
    return replace(rig, right=replace(rig.right, K=K))


@pytest.mark.slow
@pytest.mark.parametrize(("by_px", "said"), [(0.0, False), (0.35, True)])
def test_a_run_names_rows_that_check_would_not_accept(by_px: float, said: bool) -> None:
    pairs = pairs_of(REEF / "left", REEF / "right", RunConfig().input).pairs
    notes = first_notes(Pipeline(lowered(load_rig(REEF / "cam.yaml"), by_px), RunConfig()), pairs)
    assert any("a vertical disparity of 0.3" in note and "run --refine" in note for note in notes) == said
    assert bool(notes) == said
