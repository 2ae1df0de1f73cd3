"""Given poses with the errors taken out that the images show: a camera turned on its vehicle,
headings turned against positions, a lever arm.
"""

from dataclasses import dataclass, replace

import numpy as np

from calibration.transforms import rigid_transform
from stereo_seecolor.config import MappingConfig
from stereo_seecolor.mapping.frame_index import FrameIndex
from stereo_seecolor.mapping.navigation.deviations import without_jumps
from stereo_seecolor.mapping.navigation.motions import Motions
from stereo_seecolor.mapping.navigation.mount import (
    North,
    Turn,
    constant_turn,
    lever_arm,
    mount_with,
    north_of,
)
from stereo_seecolor.mapping.navigation.seen_motion import SeenMotion
from stereo_seecolor.records import Array

TURN_HELPS = 0.9
"""A constant turn must leave at most this fraction of the misfit."""
ALIKE_MISFIT = 1.15
"""Two explanations are alike where one leaves at most so much more."""
ARM_LEAVES = 0.75
"""Of the cost an arm must leave less: of that of a drift, which is none, it leaves 0.87 and more on
synthetic tracks, and arms of half a meter leave 0.65 and less.
"""
MAX_TURN_RAD = np.radians(20.0)
"""No compass or gyroscope is off by this much between neighbors."""


@dataclass(frozen=True, eq=False)
class CorrectedPoses:
    """Given poses with the errors taken out that the images show. T: (N, 4, 4). advice: a line
    for each error; none where nothing was corrected.
    """

    T: Array
    misfit: float
    advice: tuple[str, ...] = ()


def corrected(
    T: Array, seen: SeenMotion, plain: float, index: FrameIndex, config: MappingConfig
) -> CorrectedPoses:
    """The camera turned on its vehicle, headings turned against positions, a lever arm: the fewest
    that explain the most. Turns of both kinds are named where both fit, and no arm is where one
    jump of the positions explains as much.
    """
    edges = [*seen.edges, *seen.spans]
    turn, north = constant_turn(Motions.of(T, edges)), north_of(T, seen.spans or seen.edges)
    turned = T.copy()
    turned[:, :3, :3] = T[:, :3, :3] @ turn.R
    is_compass = abs(north.angle_rad) < MAX_TURN_RAD
    both = [
        (believed, CorrectedPoses(undone, seen.misfit(undone), (advice,)))
        for believed, undone, advice in (
            (turn.believed, turned, _turn_advice(turn, config)),
            (north.believed and is_compass, north.undone(T), _north_advice(north)),
        )
    ]
    both = [one for one in both if one[1].misfit < TURN_HELPS * plain]
    found = min((one for is_sure, one in both if is_sure), key=lambda one: one.misfit, default=None)
    if found is not None:  # the other may be as likely where it alone is not sure
        most = ALIKE_MISFIT * found.misfit
        rivals = [one.advice[0] for _, one in both if one is not found and one.misfit < most]
        found = replace(found, advice=("; or, as likely, ".join([*found.advice, *rivals]),))
    chains = [
        _with_lever_arm(one, seen, index)
        for one in (CorrectedPoses(T, plain), found)
        if one is not None
    ]
    return min(chains, key=lambda one: one.misfit * ALIKE_MISFIT ** len(one.advice))


def _with_lever_arm(before: CorrectedPoses, seen: SeenMotion, index: FrameIndex) -> CorrectedPoses:
    """The poses of the camera where they are of another point of the vehicle."""
    arm = lever_arm(Motions.of(before.T, seen.spans or seen.edges))
    if arm is None:
        return before
    T = before.T @ rigid_transform(np.eye(3), -arm[0])
    after = CorrectedPoses(T, seen.misfit(T), (*before.advice, _lever_advice(*arm)))
    left = seen.cost(after.T)
    if not (after.misfit < before.misfit and left < ARM_LEAVES * seen.cost(before.T)):
        return before
    with_one_jump = seen.cost(without_jumps(before.T, seen.edges, index, most=1))
    return after if left < with_one_jump else before


def _lever_advice(arm_m: Array, std_m: Array) -> str:
    parts = zip(arm_m, std_m, ("right", "down", "forward"), strict=True)
    where = ", ".join(f"{along:+.2f} ± {std:.2f} {axis}" for along, std, axis in parts)
    return (
        f"the given positions are of a point {np.linalg.norm(arm_m):.2f} m from the camera "
        f"({where}), which was taken into account: if they are positions of a vehicle, set "
        "mapping.mount.xyz_m"
    )


def _north_advice(north: North) -> str:
    return (
        f"the given headings are turned by {np.degrees(north.angle_rad):+.1f} +- "
        f"{np.degrees(north.std_rad):.1f} degrees against the directions in which the positions "
        "move (magnetic declination, convergence of a grid, a compass or camera mounted so): the "
        "map is oriented by the positions"
    )


def _turn_advice(turn: Turn, config: MappingConfig) -> str:
    return (
        f"the camera is rotated by {turn.angle_deg:.1f} degrees relative to the given poses, "
        "which was taken into account: if they are poses of a vehicle, set "
        f"{mount_with(turn, config.mount)}"
    )
