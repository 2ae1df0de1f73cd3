"""Numbers as a person reads them."""

from stereo_seecolor.report.texts import Texts


def digits(value: float, count: int = 3) -> str:
    """With that many significant digits, never in powers of ten."""
    text = f"{value:.{count}g}"
    return f"{value:.0f}" if "e" in text and abs(value) >= 1 else f"{value:.6f}".rstrip("0") if "e" in text else text


def duration(seconds: float, texts: Texts) -> str:
    """In seconds, minutes or hours."""
    if seconds < 120:
        return texts("unit.s", value=digits(seconds))
    if seconds < 7200:
        return texts("unit.min", value=digits(seconds / 60))
    return texts("unit.h", value=digits(seconds / 3600))


def length(meters: float, texts: Texts) -> str:
    """In millimeters, centimeters or meters."""
    if meters < 0.02:
        return texts("unit.mm", value=digits(1000 * meters))
    if meters < 1:
        return texts("unit.cm", value=digits(100 * meters))
    return texts("unit.m", value=digits(meters))
