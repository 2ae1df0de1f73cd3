"""All numbers of a site."""

from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.metrics.colony import Colony
from stereo_seecolor.metrics.cover import Cover
from stereo_seecolor.metrics.structure import StructureAtScale


@dataclass(frozen=True)
class SiteMetrics:
    """structure: at each scale. colonies: each outline that was seen. cover: by label. unseen: outlines of which nothing was seen.

    height_std_m: median standard error of the terrain. files: what was written.
    """

    structure: tuple[StructureAtScale, ...]
    colonies: tuple[Colony, ...]
    cover: tuple[Cover, ...]
    unseen: tuple[str, ...]
    cell_m: float
    area_m2: float
    height_std_m: float
    files: tuple[Path, ...] = ()
