"""Detects images with red and blue exchanged, by the water that was fitted to them."""

from collections.abc import Mapping

import numpy as np

from stereo_seecolor.records import Water

REDDER = 1.1
"""Red over green of the backscatter. Of three real dives, by day and by strobe: at most 0.92; exchanged: 1.3 to 3.9."""


def channel_order_notes(waters: Mapping[str, Water]) -> tuple[str, ...]:
    """A note where backscatter is reddest and red is attenuated least; none otherwise.

    Brown water, of peat or mud, has this order, too. In green water exchanged channels look like another green water: no note.
    """
    different = list({id(water): water for water in waters.values()}.values())
    if not different:
        return ()
    red, green, blue = np.median([water.gamma_inf for water in different], axis=0)
    beta = np.median([water.beta for water in different], axis=0)
    reddest = red > REDDER * green and green > blue
    if not (reddest and beta[0] < beta[1] < beta[2]):
        return ()
    found = "the veiling light is reddest, and red is attenuated least, as in brown water alone"
    return (f"water: {found}: if it was not brown, the files hold blue in the place of red: set input.channels=bgr",)
