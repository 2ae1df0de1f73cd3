"""Lengths that users write with their units."""

from calibration.errors import CalibrationError

UNITS_M = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


def length_m(text: str, where: str) -> float:
    """Parse ``24.23mm``, ``3cm`` or ``1.5m`` to meters. where: what is read, for the message. Raises CalibrationError."""
    number = text.rstrip("cm")
    try:
        return float(number) * UNITS_M[text[len(number) :]]
    except (ValueError, KeyError):
        raise CalibrationError(f"{where}: {text!r} must be a length with its unit, such as 24.23mm") from None
