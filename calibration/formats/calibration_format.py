"""The records that describe a calibration format: it recognizes its files by their content and
makes a rig from them.

Packages add formats by entry points of the group ``calibration.formats``; this package's own of few
users (``calibration/extras``) are added in the same way. See docs/extending.md.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from calibration import plugins
from calibration.errors import CalibrationError
from calibration.formats.reading.section import Section
from calibration.rig import StereoRig

GROUP = "calibration.formats"
NATIVE = "stereo-seecolor/rig"
"""In every native file, which no other format is asked about."""
Size = tuple[int, int]
Decode = Callable[[bytes], dict[str, Any] | None]
"""Makes keys and values of the bytes of a file, and None of a file of another format.

Only for a notation of the format's own: YAML, JSON, XML, TOML, INI, MAT, NPZ and tables are read
already. Files of more than 256 kB are not asked.
"""


@dataclass(frozen=True)
class RigFormat:
    """A format whose file contains both cameras.

    matches: tells whether a document, the keys and values of a file, is of this format.
    parse: makes the rig of a document that matches; (width, height) of the images, pixels, for
    files that store none, None where it is not known. Raises CalibrationError.
    """

    matches: Callable[[Section], bool]
    parse: Callable[[Section, Size | None], StereoRig]
    decode: Decode | None = None


@dataclass(frozen=True)
class CameraFormat:
    """A format whose file contains one camera.

    title: of the format, in messages. matches: tells whether a document is of this format.
    parse: makes the rig of the left and the right camera's document. Raises CalibrationError.
    """

    title: str
    matches: Callable[[Section], bool]
    parse: Callable[[Section, Section], StereoRig]
    decode: Decode | None = None


def added_formats() -> dict[str, RigFormat | CameraFormat]:
    """The formats that packages add, by name. Raises CalibrationError for a broken package."""
    return {
        name: plugins.load(GROUP, name, CalibrationError, (RigFormat, CameraFormat))
        for name in plugins.added(GROUP)
    }
