"""Points that lie outside the ranges looked for are said before a run, with the setting that takes
them.
"""

import dataclasses

import numpy as np
import pytest

from calibration.formats import load_rig, write_rig
from stereo_seecolor.checks.range_limits import range_limits
from stereo_seecolor.commands.inspect import inspect
from stereo_seecolor.config import MatchingConfig

RNG = np.random.default_rng(0)
SCENES = {
    "reef": (RNG.uniform(1, 5, 300), []),
    "reef with mismatches": (np.concatenate([RNG.uniform(1, 5, 300), RNG.uniform(20, 500, 9)]), []),
    "street": (RNG.uniform(4, 80, 300), ["matching.max_range_m=100"]),
    "distant wall": (RNG.uniform(38, 42, 300), ["matching.max_range_m=60"]),
    "macro": (RNG.uniform(0.19, 0.25, 300), ["matching.min_range_m=0.1"]),
    "no features": (np.zeros(0), []),
}


@pytest.mark.parametrize("scene", SCENES)
def test_settings_that_take_all_points(scene: str) -> None:
    range_m, options = SCENES[scene]
    assert [limit.option for limit in range_limits(range_m, MatchingConfig())] == options


@pytest.mark.slow
def test_a_run_says_what_lies_beyond_its_ranges(make_dive, cli, tmp_path) -> None:
    dive = make_dive(1)
    code, printed, said = cli(*dive.command(tmp_path / "out"), "--set", "matching.max_range_m=1.5")
    assert code == 0
    assert (
        "features lie beyond matching.max_range_m (1.5 m) and get no range: --set "
        "matching.max_range_m=" in printed + said
    )


@pytest.mark.slow
def test_inspect_sets_the_range_that_a_dive_needs(make_dive) -> None:
    dive = make_dive(2)
    rig = load_rig(dive.root / "cam.yaml")
    T = rig.T_right_left.copy()
    T[0, 3] *= 19  # what lay at 1 to 2 m lies at 19 to 38
    write_rig(dataclasses.replace(rig, T_right_left=T), dive.root / "cam.yaml")
    found = inspect([dive.root])
    assert found.run_command.endswith("--set matching.max_range_m=60")
    assert any(
        "get no range: --set matching.max_range_m=60" in problem for problem in found.problems
    )
    assert found.measured is not None
    assert found.measured.median_range_m == pytest.approx(19 * np.median(dive.range_m), rel=0.1)
