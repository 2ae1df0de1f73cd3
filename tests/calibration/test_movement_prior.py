"""A prior of what has moved in a rig: what rows show well is kept, what they do not is shrunk, and
where neither is clear the standard error holds both.
"""

import numpy as np
import pytest

from calibration.movement_prior import PRIOR, Weighed

UNIT = np.full(4, 1e-3)


def weighed(value_px: float, std_px: float) -> tuple[float, float]:
    """A yaw, and its standard error, pixels; the other parameters are certain."""
    estimates, errors = np.array([2.0, 0.2, 0.2, value_px]), np.array([0.01, 0.01, 0.01, std_px])
    found = Weighed.of(estimates * UNIT, np.diag(errors * UNIT) ** 2, UNIT)
    values, std = found.gain @ estimates, found.std / UNIT
    assert values[:3] == pytest.approx(estimates[:3], abs=0.001)
    assert std[:3] == pytest.approx(errors[:3], rel=0.01)
    return float(values[3]), float(std[3])


@pytest.mark.parametrize("value_px", [0.1, 0.5, 8.0])
def test_what_rows_show_well_is_kept(value_px: float) -> None:
    assert weighed(value_px, 0.01) == pytest.approx((value_px, 0.01), rel=0.02)


def test_what_rows_do_not_show_stays_as_calibrated() -> None:
    value, std = weighed(3.0, 30.0)
    assert value == pytest.approx(0, abs=0.1)
    assert PRIOR.calibrated_px[3] < std < PRIOR.moved_px / 4


def test_a_parameter_that_has_moved_far_is_found_though_rows_show_it_poorly() -> None:
    value, std = weighed(9.0, 1.5)
    assert value == pytest.approx(8.3, abs=0.3)
    assert std == pytest.approx(1.5, abs=0.2)


def test_no_small_change_of_the_rows_changes_a_value_by_more_than_its_error() -> None:
    """A choice between moved and not did, where both were as likely."""
    values, stds = np.array([weighed(px, 1.5) for px in np.arange(0, 12, 0.1)]).T
    assert (np.diff(values) < 0.25 * stds[1:]).all()
    assert values[0] == pytest.approx(0, abs=1e-9) and values[-1] > 10
    both = np.abs(values - 2).argmin()
    assert stds[both] > 1.5  # more than the rows' alone
