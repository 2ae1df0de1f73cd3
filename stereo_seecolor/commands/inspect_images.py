"""Problems of how files became pairs, as ``inspect`` names them."""

import shlex

from calibration.wording import counted
from stereo_seecolor.inputs.pairing import Pairing
from stereo_seecolor.inputs.sides import Sides


def problems_of_images(sides: Sides, pairing: Pairing, doubtful: bool) -> tuple[str, ...]:
    """One line for each problem: notes of the pairing, sides that no name tells, files without a partner, folders left out.

    doubtful: sample pairs do not tell either which side is left.
    """
    problems = list(pairing.notes)
    if doubtful:
        problems.append(
            f"no name says which images are left and which right, and {sides.left} and {sides.right} show too little in common to "
            "be the two sides: give them by hand, a folder for each or a pattern ('*/im0.png' and '*/im1.png')"
        )
    elif sides.guessed:
        problems.append("no name says which side is left and which right: they were taken in order")
    if pairing.unpaired:
        first, count = pairing.unpaired[0], counted(len(pairing.unpaired), "file without a partner")
        problems.append(f"{count}, the first: {first.path.name} ({first.reason})")
    if sides.others:
        problems.append(
            f"{counted(len(sides.others), 'folder')} of the same names are left out, the first: {sides.others[0]}: each pair of "
            f"them is a run of its own, which stereo-seecolor campaign does one after the other{_together(sides)}"
        )
    return tuple(problems)


def _together(sides: Sides) -> str:
    """The options that run folders of the same names as one dive; "" where none do."""
    if not (patterns := sides.together):
        return ""
    return "; all of them as one dive: " + shlex.join(["--left", str(patterns[0]), "--right", str(patterns[1])])
