"""The known errors of the program. ``cli`` prints each as one line, with exit code 1; other
exceptions keep their traceback.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager

_NOT_PRINTABLE = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")

_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")


def printable(text: str) -> str:
    """``text`` as one line of valid UTF-8: control characters and other bytes become %XX."""
    return _NOT_PRINTABLE.sub(lambda match: _percent(match[0]), text)


def printable_lines(text: str) -> str:
    """``text`` for a terminal: control characters, which it would obey, become %XX."""
    return _CONTROL.sub(lambda match: _percent(match[0]), text)


def _percent(character: str) -> str:
    undecoded_byte = "\udc80" <= character <= "\udcff"  # what surrogateescape makes of it
    return "".join(
        f"%{byte:02X}"
        for byte in character.encode(
            errors="surrogateescape" if undecoded_byte else "surrogatepass"
        )
    )


class SeeColorError(Exception):
    """Base class of all known errors. The message is one line: what is wrong, where, what to do."""

    def __str__(self) -> str:
        return printable(super().__str__())


class InputError(SeeColorError):
    """An input folder, image, range map or trajectory that cannot be used."""


class FrameError(InputError):
    """Missing or damaged files of one frame; the others can be used. name: the frame's."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name

    def __reduce__(self) -> tuple[type["FrameError"], tuple[str, str]]:
        return type(self), (self.name, self.args[0])


class ConfigError(SeeColorError):
    """A configuration file or --set that cannot be used."""


class OutputError(SeeColorError):
    """An output folder or file that cannot be written."""


class DeviceError(SeeColorError):
    """A device that was asked for and is absent, or a missing library that a stage needs."""


class ClusterError(SeeColorError):
    """A cluster that cannot be reached, or whose workers cannot do the work."""


class PluginError(SeeColorError):
    """A part of the program that no installed package adds, or that cannot be loaded."""


class MatchingError(SeeColorError):
    """A pair that cannot be matched."""


class ColorError(SeeColorError):
    """A frame or a survey whose colors cannot be fitted."""


class MappingError(SeeColorError):
    """A survey that cannot be placed or fused."""


class ComparingError(SeeColorError):
    """Two surveys that cannot be compared."""


@contextmanager
def library_for(what: str, extra: str, kind: type[SeeColorError] = DeviceError) -> Iterator[None]:
    """Raise ``kind`` where a library that the block imports is missing.

    what: what needs it. extra: of this package, which installs it.
    """
    try:
        yield
    except ImportError as error:
        raise kind(
            f"{what} needs a library that is missing ({error}): pip install "
            f"'stereo-seecolor[{extra}]'"
        ) from error
