"""Data as scripts: a page opened from a file may load scripts and images, and nothing else."""

import json
from typing import Any


def script(receiver: str, *values: Any) -> bytes:
    """A script that hands values to the page: ``seecolor.RECEIVER(VALUE, ...)``, ASCII; NaN and infinity must be None."""
    texts = (json.dumps(value, ensure_ascii=True, allow_nan=False, separators=(",", ":")) for value in values)
    return f"seecolor.{receiver}({','.join(texts)});\n".encode("ascii")
