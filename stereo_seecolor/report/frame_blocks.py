"""Plots and poses of the frames, a thousand to a script: the page loads those that it needs."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.report.facts import DiveFacts
from stereo_seecolor.report.page_columns import Column, plots
from stereo_seecolor.report.templates import script
from stereo_seecolor.run_folder.layout import PAGE

FOLDER = f"{PAGE}/frames"
FRAMES = 1000
"""Of a script of some 160 kB. The web program knows it, too (web/src/blocks.ts)."""
TRACK_POINTS = 2000
"""Of the whole track, as it is drawn until parts of it are near."""


def frame_blocks(facts: DiveFacts) -> tuple[dict[str, Any], dict[str, bytes]]:
    """What the page knows of all blocks at once, and their scripts, by their paths in OUT. The
    former: the curves of each plot, and ``blocks_of``'s places.
    """
    columns = plots(facts)
    places, scripts = blocks_of(_poses(facts), columns)
    return {
        "plots": {plot: [*curves] for plot, curves in columns.items()},
        "blocks": places,
    }, scripts


def blocks_of(
    poses: NDArray[np.float64], columns: dict[str, dict[str, Column]]
) -> tuple[list[dict[str, Any] | None], dict[str, bytes]]:
    """Of each block, how many of its frames are in the map, the least and largest coordinates of
    their cameras and some of their places, meters, in the map's own coordinates (None without any);
    and all scripts, by their paths in OUT.

    poses: (N, 3, 4), upper rows of poses in the map, else NaN. columns: plot -> curve -> N values.
    """
    step = -(-len(poses) // TRACK_POINTS) or 1
    places, scripts = list[dict[str, Any] | None](), dict[str, bytes]()
    for number in range(-(-len(poses) // FRAMES)):
        part = slice(number * FRAMES, (number + 1) * FRAMES)
        places.append(_place(poses[part, :, 3], step))
        of_block = {
            plot: {name: column[part] for name, column in curves.items()}
            for plot, curves in columns.items()
        }
        content = {"poses": poses[part].astype("<f4").tobytes(), "plots": of_block}
        scripts[f"{FOLDER}/{number}.js"] = script("block", number, content)
    return places, scripts


def _poses(facts: DiveFacts) -> NDArray[np.float64]:
    """(N, 3, 4) the upper rows of the pose of each row's frame in the map; NaN without one."""
    found = np.full((len(facts.rows), 3, 4), np.nan)
    if facts.posed is not None:
        place = {row.name: number for number, row in enumerate(facts.rows)}
        for frame, T in zip(facts.posed.frames, facts.posed.T_map_camera, strict=True):
            if frame.name in place:
                found[place[frame.name]] = T[:3]
    return found


def _place(places_m: NDArray[np.float64], step: int) -> dict[str, Any] | None:
    known = places_m[np.isfinite(places_m[:, 0])]
    if not len(known):
        return None
    some = known[np.unique([*range(0, len(known), step), len(known) - 1])]
    low, high = known.min(axis=0), known.max(axis=0)
    return {
        "frames": len(known),
        "low_m": low.tolist(),
        "high_m": high.tolist(),
        "track": some.round(3).tolist(),
    }
