"""The form of a line of the log, by which a file is known as a log of this program."""

import re
from pathlib import Path

FORM = "%(asctime)s %(levelname)s %(name)s: %(message)s"
_LINE = re.compile(rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} [A-Z]+ (stereo_seecolor|calibration)[.:]")


def is_log(path: Path) -> bool:
    """Tell whether a file begins as a log of this program does."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return bool(_LINE.match(file.read(200)))
