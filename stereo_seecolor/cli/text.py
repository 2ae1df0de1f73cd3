"""Lines and tables of text without color, the same on a terminal and in a file."""

import io
from collections.abc import Iterable, Sequence

from stereo_seecolor.errors import printable

_WIDEST = 1_000_000
"""Width of a line: more than any table has. A terminal's would cut the names of frames."""


def lines(*texts: str) -> str:
    """The texts, each on a line of its own, whatever names they hold."""
    return "".join(f"{printable(text)}\n" for text in texts)


def table(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table without a frame, as wide as its content."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    drawn = Table(*columns, box=None, header_style="")
    for row in rows:
        drawn.add_row(*(Text(printable(cell)) for cell in row))
    text = io.StringIO()
    Console(file=text, width=_WIDEST, color_system=None).print(drawn)
    return lines(*(line.rstrip() for line in text.getvalue().splitlines()))


def duration(seconds: float) -> str:
    """A duration as text, in seconds, minutes, hours or days."""
    for unit, length in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.1f} {unit}"
    return f"{seconds:.0f} s"
