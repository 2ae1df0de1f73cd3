"""Exposure and gain of each frame from a table: for cameras that log them elsewhere."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import numpy as np

from stereo_seecolor.errors import InputError
from stereo_seecolor.files.csv_tables import dict_reader
from stereo_seecolor.files.text_documents import read_text
from stereo_seecolor.records import Capture

NAMES = (
    "name", "file", "filename", "file_name", "image", "image_name", "path", "relative_path",
    "source_file",
)  # fmt: skip
EXPOSURES = ("exposure_s", "exposure_ms", "exposure_us", "exposure_time", "shutter_speed")
"""Usual names; without a unit seconds, as in EXIF."""
_SECONDS = {
    "s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "milliseconds": 1e-3, "us": 1e-6,
    "µs": 1e-6, "microseconds": 1e-6,
}  # fmt: skip
_FRACTION = re.compile(r"\s*(\d+(?:\.\d+)?)\s*/\s*(\d+(?:\.\d+)?)\s*(?:(?:s|sec)\s*)?")
"""``1/400``, as exiftool writes a time."""
_SAME = {"source_file": "file_name", "exposure_time": "shutter_speed"}
"""Columns of exiftool -> what it writes again beside each."""
LONGEST_UNNAMED_S = 1.0
"""Exposures of a column without a unit that are longer are in milli- or microseconds."""

MOST_CHARACTERS = 10_000
"""Of a line; more is another file."""

GAINS = ("gain", "gain_db", "iso")


@dataclass(frozen=True)
class ExposureTable:
    """Exposure and gain by file: its name, its stem, or either after the name of its folder."""

    rows: Mapping[str, Capture]

    @classmethod
    def read(cls, path: Path) -> "ExposureTable":
        """Read a CSV with a header: a column of file names; exposure_s (or _ms, _us); gain (a
        factor), gain_db or iso.

        A file's name may lack its suffix, and needs its folder (``left/0001.png``) only where both
        sides use the same names.
        Raises InputError for a file that cannot be read or has no such columns, and for a bad
        value or a file named twice with other values, naming the line.
        """
        text = read_text(path)
        if max(map(len, text.splitlines()), default=0) > MOST_CHARACTERS:
            raise InputError(
                f"{path}: has a line of more than {MOST_CHARACTERS} characters: is it a table of "
                "exposures?"
            )
        reader = dict_reader(text)
        reader.fieldnames = [_plain(name) for name in reader.fieldnames or ()]
        again = {other for name, other in _SAME.items() if name in reader.fieldnames}
        header = [name for name in reader.fieldnames if name not in again]
        units_s = {name: unit for name in header if (unit := _unit_s(name))}
        name, exposure, gain = (
            _column(path, header, known) for known in (NAMES, tuple(units_s), GAINS)
        )
        if "exposure" in header and not exposure:
            raise InputError(
                f"{path}: column 'exposure' has no unit: name it exposure_s, exposure_ms or "
                "exposure_us"
            )
        if not name or not (exposure or gain):
            raise InputError(
                f"{path}: needs a header with a column of file names ({', '.join(NAMES)}) and "
                f"exposure or gain ({', '.join((*EXPOSURES, *GAINS))}), as exiftool -csv writes it"
            )
        is_bare = not exposure or not {*exposure.split("_")} & _SECONDS.keys()
        rows = dict[str, Capture]()
        for row in reader:
            where = f"{path}: line {reader.line_num}"
            exposure_s = (
                _positive_exposure(where, row, exposure) * units_s[exposure] if exposure else None
            )
            if exposure_s and exposure_s > LONGEST_UNNAMED_S and is_bare:
                raise InputError(
                    f"{where}: {exposure} is {exposure_s:g} s: name its unit: exposure_s, "
                    "exposure_ms or exposure_us"
                )
            file = _key(row[name] or "")
            capture = Capture(exposure_s, _gain(where, row, gain) if gain else None)
            if rows.setdefault(file, capture) != capture:
                raise InputError(
                    f"{where}: {row[name]!r} has other values in a line above: leave one, or give "
                    "the folders of both (left/0001.png)"
                )
        return cls(rows)

    def applied(self, capture: Capture, image: Path) -> Capture:
        """``capture`` with what the table says of ``image`` in place of what the camera wrote."""
        folder = image.parent.name
        keys = (f"{folder}/{image.name}", f"{folder}/{image.stem}", image.name, image.stem)
        row = next((self.rows[key] for key in keys if key in self.rows), Capture())
        exposure_s = capture.exposure_s if row.exposure_s is None else row.exposure_s
        return replace(
            capture, exposure_s=exposure_s, gain=capture.gain if row.gain is None else row.gain
        )


def _plain(name: str) -> str:
    """``Exposure Time [ms]`` as exposure_time_ms, ``SourceFile`` as source_file."""
    found = re.findall(r"dB|[µμ]s|[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)
    return "_".join(word.lower().replace("μ", "µ") for word in found)


def _unit_s(name: str) -> float | None:
    """Seconds of the unit of a column of exposure times; None for another column, and for
    ``exposure`` alone, whose unit is open.
    """
    words = set(name.split("_"))
    what = words & {"exposure", "shutter", "integration", "exposuretime"}
    rest = words - what - {"time", "speed"}
    if not what or len(rest) > 1 or words == {"exposure"}:
        return None
    return _SECONDS.get(rest.pop()) if rest else 1.0


def _column(path: Path, header: Sequence[str], known: Sequence[str]) -> str:
    """The one column of the header that is known, "" where there is none."""
    found = [name for name in header if name in known]
    if len(found) > 1:
        raise InputError(f"{path}: has the columns {' and '.join(found)}: leave one")
    return found[0] if found else ""


def _key(name: str) -> str:
    """The file with its folder, if that is given."""
    return "/".join(PurePosixPath(name.strip().replace("\\", "/")).parts[-2:])


def _gain(where: str, row: Mapping[str, str], column: str) -> float:
    """As a factor: 1 is 0 dB or ISO 100."""
    if column == "gain_db":
        return float(10 ** (_number(where, row, column) / 20))
    return _positive_exposure(where, row, column) / (100 if column == "iso" else 1)


def _positive_exposure(where: str, row: Mapping[str, str], column: str) -> float:
    number = _number(where, row, column)
    if number <= 0:
        raise InputError(f"{where}: {column} must be more than 0, got {number:g}")
    return number


def _number(where: str, row: Mapping[str, str], column: str) -> float:
    text = row[column] or ""
    if (fraction := _FRACTION.fullmatch(text)) and float(fraction[2]):
        text = str(float(fraction[1]) / float(fraction[2]))
    try:
        number = float(text)
    except ValueError as error:
        raise InputError(
            f"{where}: {column} must be a number, got {row[column] or ''!r}"
        ) from error
    if not np.isfinite(number) or abs(number) > 1e9:
        raise InputError(f"{where}: {column} is {number:g}, which no camera has")
    return number
