"""What was measured on the page, and its random points, kept beside it: OUT/measures.json, which
the page saves, and which is a user's own file.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.json_records import as_record
from stereo_seecolor.files.text_documents import read_json

FILE = "measures.json"
FORMAT = "stereo-seecolor measures 1"


@dataclass(frozen=True)
class KeptMeasure:
    """One measure, as the page keeps it (web/src/kept.ts): of a frame, or (frame "") of the map.

    places: pixels of the frame. points: meters in its camera, or in the map's own coordinates.
    clicks_m: how well each point of the map was hit.
    """

    id: int
    frame: str
    kind: str
    label: str
    places: list[tuple[float, float]]
    points: list[tuple[float, float, float]]
    clicks_m: list[float] | None = None


@dataclass(frozen=True)
class KeptPoint:
    """A random point of the map. label: "" without one. spot_m: in map coordinates."""

    spot_m: tuple[float, float]
    label: str


@dataclass(frozen=True)
class KeptPoints:
    """The random points of the map. changed_ms: when one was labelled last, since 1970."""

    changed_ms: float
    points: list[KeptPoint]


@dataclass(frozen=True)
class KeptMeasures:
    """The content of such a file. dive: identifies the dive. offset_m: of the map's own coordinates
    in the world. content: the measures with all that the page knows of them. cover: the random
    points, None in a file of an earlier page.
    """

    dive: str
    offset_m: tuple[float, float, float]
    measures: list[KeptMeasure]
    content: list[dict[str, Any]]
    cover: KeptPoints | None = None


def read_kept_measures(path: Path) -> KeptMeasures:
    """Read what the page saved. Raises InputError for a file of something else."""
    content = read_json(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise InputError(f"{path}: is not a file of measures as the page saves it")
    try:
        read = as_record(KeptMeasures, {**content, "content": content.get("measures")})
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{path}: {where}: {first['msg']}: save it again on the page") from error
    for each in read.measures:
        if len(each.places if each.frame else each.clicks_m or ()) != len(each.points):
            raise InputError(f"{path}: measure {each.id} is damaged: save it again on the page")
    return read
