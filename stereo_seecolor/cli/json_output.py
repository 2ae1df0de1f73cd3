"""Results as JSON (docs/json.md): one object on standard output, always valid, whatever a command found."""

import json
from collections.abc import Mapping
from typing import Any

from stereo_seecolor.files.json_values import plain


def json_line(content: Mapping[str, Any]) -> str:
    """One object on one line of ASCII text; numbers that are not finite become null."""
    return json.dumps(plain(content), allow_nan=False) + "\n"
