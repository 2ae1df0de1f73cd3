"""Problems of how files became pairs, as ``inspect`` names them."""

import shlex

from calibration.errors import counted
from stereo_seecolor.inputs.pairing import Pairing
from stereo_seecolor.inputs.sides import Sides


def problems_of_images(sides: Sides, pairing: Pairing, doubtful: bool) -> tuple[str, ...]:
    """One line for each problem: notes of the pairing, sides that no name tells, files without a
    partner, folders left out.

    doubtful: sample pairs do not tell either which side is left.
    """
    problems = list(pairing.notes)
    if doubtful:
        problems.append(
            f"no name identifies the left images, and {sides.left} and {sides.right} have too "
            "little in common to be the two sides: name them yourself, with a folder for "
            "each or a pattern ('*/im0.png' and '*/im1.png')"
        )
    elif sides.guessed:
        problems.append("no name identifies the left side: the sides were used in order")
    if pairing.unpaired:
        first, count = pairing.unpaired[0], counted(len(pairing.unpaired), "file without a partner")
        problems.append(f"{count}, the first: {first.path.name} ({first.reason})")
    if sides.others:
        problems.append(
            f"{counted(len(sides.others), 'folder')} with the same names are left out, the "
            f"first: {sides.others[0]}: each pair of folders is a separate run; "
            f"stereo-seecolor campaign runs them one after the other{_together(sides)}"
        )
    return tuple(problems)


def _together(sides: Sides) -> str:
    """The options that run folders of the same names as one dive; "" where none do."""
    if not (patterns := sides.together):
        return ""
    return "; all of them as one dive: " + shlex.join(
        ["--left", str(patterns[0]), "--right", str(patterns[1])]
    )
