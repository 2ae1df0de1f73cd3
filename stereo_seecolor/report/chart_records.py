"""Color charts and differences between views, kept for later pages of the same frames."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from stereo_seecolor.files.json_records import load_object
from stereo_seecolor.files.json_values import plain
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import PAGE

FILE = f"{PAGE}/charts.json"


@dataclass(frozen=True)
class ShownChart:
    """A chart in a frame. published, before, after: colors of its patches as CSS, after one
    exposure gain; published, and before and after correction.

    before_ciede2000, after_ciede2000: median over patches, None where the input image is missing.
    """

    frame: str
    kind: str
    published: list[str]
    before: list[str]
    after: list[str]
    before_ciede2000: float | None
    after_ciede2000: float


def write_charts(folder: RunFolder, charts: Sequence[ShownChart], spread: Any) -> None:
    """Keep charts and differences between views (plain values, or None) for pages of the same
    frames. Raises OutputError.
    """
    content = plain({"charts": charts, "spread": spread})
    folder.dive.write(FILE, json.dumps(content).encode(), made_from=folder.dive.digest("corrected"))


def kept_charts(folder: RunFolder) -> dict[str, Any]:
    """The content that ``write_charts`` kept; empty where it is of other corrected frames."""
    path = folder.root / FILE
    if not path.is_file() or folder.dive.record.made_from.get(FILE) != folder.dive.digest(
        "corrected"
    ):
        return {}
    try:
        return load_object(path)
    except ValueError:  # changed since: the page is made without
        return {}
