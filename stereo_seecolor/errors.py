"""What can go wrong, as errors of our own. ``cli`` turns each into one line and exit code 1; all else keeps its traceback."""


class SeeColorError(Exception):
    """Base of all known errors. The message is one line: what is wrong, where, what to do."""


class InputError(SeeColorError):
    """An input folder, image, range map or trajectory that cannot be used."""


class FrameError(InputError):
    """One frame's files are gone or damaged; the others can go on without it. name: the frame's."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


class ConfigError(SeeColorError):
    """A configuration file or --set that cannot be used."""


class OutputError(SeeColorError):
    """An output folder or file that cannot be written."""


class DeviceError(SeeColorError):
    """A device asked for and absent, or a library that a stage needs and the machine lacks."""


class MatchingError(SeeColorError):
    """A pair that cannot be matched."""


class ColorError(SeeColorError):
    """A frame or a survey whose colors cannot be fitted."""


class MappingError(SeeColorError):
    """A survey that cannot be placed or fused."""
