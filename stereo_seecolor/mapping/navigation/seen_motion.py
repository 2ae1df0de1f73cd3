"""What the images show of the motion, that given poses are held against: between neighbors, and
over spans of the track.

Neighbors on a straight line at constant speed look alike whatever the clock, the direction or the
place of the next line; spans over the whole track do not.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from calibration.transforms import inverse
from stereo_seecolor.mapping.navigation.motions import Motions, misfit, misfits
from stereo_seecolor.mapping.survey import Placement
from stereo_seecolor.mapping.track.relative_pose import Edge
from stereo_seecolor.records import Array

Numbers = NDArray[np.intp]

SPAN_PARTS = (2, 3, 5)
"""Of a component's frames, that spans reach over."""
NEIGHBORS = (1, 2, 3)
"""Steps between fixes that are compared, as between frames."""
MOST_SPANS, MOST_EDGES = 300, 200
"""That a reading is judged by."""
WRONG, WRONG_BETWEEN = 0.5, 1.0
"""Of their median length, by which poses off over spans contradict the images, positions of their
own and positions between a few fixes,"""
GROWS = 1.5
"""where they are off by so many times as much as between neighbors: noise of single positions does
not grow.
"""


@dataclass(frozen=True, eq=False)
class SeenMotion:
    """Relative poses of frames that have a given one. edges: measured between neighbors. spans:
    over the track that the images alone give; () where it is not known.
    """

    edges: Sequence[Edge]
    spans: Sequence[Edge] = ()

    @classmethod
    def of(
        cls,
        T_world_camera: Array,
        edges: Sequence[Edge],
        own: Placement | None,
        order: Numbers,
        fixed: NDArray[np.bool_] | None = None,
    ) -> "SeenMotion":
        """The motion between frames that have a given pose (N, 4, 4). own: placed by the images
        alone. order: of the frames in time. fixed: (N,) frames whose position was measured, where
        the others' is interpolated between them: those that follow each other are neighbors.
        """
        known = np.asarray(np.isfinite(T_world_camera).all(axis=(1, 2)))
        if fixed is not None and own is not None:
            known &= fixed
            edges = spans_of(own, order, known, NEIGHBORS)
        spans = spans_of(own, order, known) if own is not None else []
        return cls([e for e in edges if known[[e.i, e.j]].all()], spans)

    def thinned(self, most: int) -> "SeenMotion":
        """Take so many of the edges and of the spans at most, evenly."""
        edges, spans = (one[:: -(-len(one) // most) or 1] for one in (self.edges, self.spans))
        return SeenMotion(edges, spans)

    def misfit(self, T_world_camera: Array) -> float:
        """How badly poses fit, in median lengths between neighbors and over spans; or infinite."""
        edges = self.edges[:: max(1, len(self.edges) // MOST_EDGES)]
        near = misfit(T_world_camera, edges)
        far = misfit(T_world_camera, self.spans) if self.spans else 0.0
        return near + (far if np.isfinite(far) else near)

    def cost(self, T_world_camera: Array) -> float:
        """How badly poses fit by all relative poses, outliers with little weight."""
        off = np.concatenate([misfits(T_world_camera, edges) for edges in (self.edges, self.spans)])
        return float(np.log1p(off**2).mean())

    def contradiction(self, T_world_camera: Array, step_m: float, wrong: float = WRONG) -> str:
        """What to say of poses that fit from frame to frame, and not over the dive; "" of others.

        step_m: what positions are rounded to. wrong: WRONG, or WRONG_BETWEEN.
        """
        if not self.spans:
            return ""
        near, far = (Motions.of(T_world_camera, edges) for edges in (self.edges, self.spans))
        near_m, far_m = float(np.median(near.position_m)), float(np.median(far.position_m))
        if far_m < max(wrong * far.step_m, GROWS * near_m, step_m):
            return ""
        return (
            f"the given positions are {far_m:.2f} m off over {far.step_m:.2f} m of the track "
            f"(medians; {near_m:.2f} m between neighbors), under every interpretation that was "
            "tested"
        )


def spans_of(
    own: Placement, order: Numbers, known: NDArray[np.bool_], steps: Sequence[int] = ()
) -> list[Edge]:
    """Relative poses of frames some steps apart on a track; known: (N,) the frames that count."""
    spans = []
    for component in range(len(own.sizes)):
        frames = [int(i) for i in order if own.components[i] == component and known[i]]
        pairs = (
            (i, j)
            for step in steps or sorted({len(frames) // part for part in SPAN_PARTS} - {0, 1})
            for i, j in zip(frames, islice(frames, step, None), strict=False)
        )
        T = own.T_world_camera
        spans += [Edge(i, j, inverse(T[i]) @ T[j], np.eye(6), 0) for i, j in pairs]
    return spans[:: -(-len(spans) // MOST_SPANS) or 1]
