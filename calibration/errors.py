"""The errors that this package raises, and words for its messages."""


class CalibrationError(ValueError):
    """Error: a rig, a calibration file or a calibration target cannot be used.

    The message is one line: what is wrong, where (file, key, value), what to do.
    """


class SizeMissingError(CalibrationError):
    """A file that stores no image size, read without the size of its images."""


SIZE_MISSING = (
    "stores no image size: give the size of the images (--size WIDTHxHEIGHT), or add the keys "
    "image_width and image_height"
)


def counted(number: int, noun: str) -> str:
    """Write a number with its noun: ``1 pair``, ``3 pairs``. noun: in the singular, alone or before
    more words: ``file without a partner``.
    """
    first, _, rest = noun.partition(" ")
    return f"{number} {first}{'' if number == 1 else 's'} {rest}".rstrip()


UNITS_M = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


def length_m(text: str, where: str) -> float:
    """Parse ``24.23mm``, ``3cm`` or ``1.5m`` to meters. where: what is read, for the message.
    Raises CalibrationError.
    """
    number = text.rstrip("cm")
    try:
        return float(number) * UNITS_M[text[len(number) :]]
    except (ValueError, KeyError):
        raise CalibrationError(
            f"{where}: {text!r} must be a length with its unit, such as 24.23mm"
        ) from None
