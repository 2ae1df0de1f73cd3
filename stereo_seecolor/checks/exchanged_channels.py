"""A check for a dive whose images all have red and blue exchanged, from its colors over range.

Each of the two orders is fitted with the same prior of waters, daylight, cameras and sea floors.
The difference of the costs is the logarithm of the odds of the two orders.
"""

from collections.abc import Mapping
from dataclasses import replace

from stereo_seecolor.color.sharing.survey import usual_exposure
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.config import ColorConfig

LEAST_EVIDENCE = 5.0
"""Logarithm of the odds, 150 to 1. Right files: at most -2.3 in FLSea (real, eight frames), 1.2 on
a strobe-lit reef and 0.8 at a pile in green water (real), 1.1 in 148 synthetic scenes of Jerlov's
waters; beyond it in one of 72 whose waters were drawn freely. Exchanged ones are beyond it in
seven frames of FLSea and in a third of the scenes; others look like another water.
"""


def exchanged_channels_notes(
    classes: Mapping[int, MomentTable], config: ColorConfig, other: str
) -> tuple[str, ...]:
    """A note where the colors of a dive fit known waters only with red and blue exchanged. classes:
    sums of moment tables of some of its frames, by class of brightness. other: the setting that
    exchanges them.
    """
    if not classes:
        return ()
    # these load torch
    from stereo_seecolor.color.fitting.robust import fit_all
    from stereo_seecolor.color.table.range_quantiles import quantiles_by_range

    table = usual_exposure(classes)[1]
    given = quantiles_by_range(table, config.encoding)
    exchanged = replace(given, light=given.light[::-1].copy(), clipped=given.clipped[::-1].copy())
    # to the minimum: a fit of costs alone may end ten above it
    costs = fit_all([given, exchanged], config)[1]
    if costs[0] - costs[1] < LEAST_EVIDENCE:
        return ()
    return (
        "water: the colors and their change with range fit known waters better with red and blue "
        f"exchanged (odds of more than 150 to 1): if blue water looks brown in the images, set "
        f"{other}; otherwise the water is brown, or white balance or saturation was changed",
    )
