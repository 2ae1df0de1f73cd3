"""The one error that this package raises for bad calibration input."""


class CalibrationError(ValueError):
    """A rig, a calibration file or a calibration target that cannot be used.

    The message is one line: what is wrong, where (file, key, value), what to do.
    """
