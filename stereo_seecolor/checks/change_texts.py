"""The lines that name what changes within a dive: what, where, and what to do."""

from collections.abc import Sequence

from calibration.verification.changes import Changes
from stereo_seecolor.inputs.pairing import Pair


def exchanged_line(first: str, last: str) -> str:
    """Write the line for pairs whose sides are exchanged: the first and the last of them."""
    return (
        f"{_named(first, last)}: left and right are exchanged: their rows fit the rig of the "
        "other pairs only with both sides exchanged: exchange the files of these pairs"
    )


def _named(first: str, last: str) -> str:
    return first if first == last else f"from {first} to {last}"


def step_line(pairs: Sequence[Pair], first: int, changes: Changes, side: str) -> str:
    """Write the line for a change at one pair. side: whose lens changed, "" if unknown."""
    here = pairs[first].name
    if changes.scale == changes.scale:
        larger = changes.scale - 1
        what = {
            "right": f"the right images are {_percent(larger)} than before",
            "left": f"the left images are {_percent(1 / changes.scale - 1)} than before",
            "": f"the right images are {_percent(larger)} than before, or the left ones "
            f"{_percent(1 / changes.scale - 1)}; the motion does not show which",
        }[side]
        cause = "the rows fit this, but no offset or roll: focus or zoom of a lens changed"
    else:
        what = (
            "the rows of the right images have moved relative to the left ones, by "
            f"{changes.spread_px:.1f} px (root mean square over the image)"
        )
        cause = (
            "an offset or a roll, but no enlargement and no exchange of sides, explains this: a "
            "camera was knocked or mounted again, images are cropped differently, pairs come from "
            "another rig, or one side lost images while the rig moved evenly from there"
        )
    return (
        f"from {here} on {what}: {cause}: ranges on one side of {here} are wrong by about "
        f"{changes.range_error:.0%}: process both parts separately, each with its own calibration"
    )


def _percent(larger: float) -> str:
    return f"{abs(larger):.1%} {'larger' if larger > 0 else 'smaller'}"


def drift_line(pairs: Sequence[Pair], changes: Changes) -> str:
    """Write the line for a steady change."""
    return (
        f"rows of the right images move steadily relative to the left ones, from {pairs[0].name} "
        f"to {pairs[-1].name}, by {changes.spread_px:.1f} px (root mean square over the image): a "
        "camera turns slowly in its mount, or a lens changes with temperature: if columns move "
        f"like rows, ranges at one end of the dive are wrong by about {changes.range_error:.0%}: "
        "process the dive in parts, each with run --refine or its own calibration"
    )


def each_line(pairs: Sequence[Pair], changes: Changes) -> str:
    """Write the line for a change in each pair."""
    where = f"from {pairs[0].name} to {pairs[-1].name}"
    amount = (
        f"rows of the right images change from frame to frame, {where}, by "
        f"{changes.spread_px:.1f} px (standard deviation)"
    )
    if changes.moments:
        cause = (
            "near and far points move by different amounts: the sides were not exposed at the "
            "same moment, or one moving camera took both"
        )
    elif changes.scale == changes.scale:
        cause = (
            "an enlargement of one side explains this, but no offset or roll: focus or zoom of a "
            "lens changes (autofocus)"
        )
    else:
        cause = (
            "a different offset and roll for each pair explain this, and near and far points "
            "move equally: stabilization of one or both sides, or a loose camera; sides "
            "exposed at different moments while the cameras rotate would look the same"
        )
    return (
        f"{amount}: {cause}: if columns move like rows, ranges are wrong by about "
        f"{changes.range_error:.0%}, by a different amount in each frame: record without "
        "stabilization and with fixed focus, and trigger both cameras together"
    )


def odd_line(first: str, last: str) -> str:
    """Write the line for pairs that are not of the rig of the others: the first and the last."""
    return (
        f"{_named(first, last)}: their rows do not fit the rig of the other pairs, exchanged or "
        "not: they come from another rig or dive, or their sides were not exposed at the "
        "same moment: not used for the refined rig, the light and the water; remove them, or "
        "process them separately"
    )


def shifted_line(first: str, last: str, shift: str) -> str:
    """Write the line for pairs that are out of step, the first and the last: by what shift."""
    return f"{_named(first, last)}: {shift}"
