"""All words of the page, from one file, so that it can be translated."""

import json
from functools import cache
from importlib.resources import files
from typing import Any

STATIC = files("stereo_seecolor.report") / "static"


class Texts:
    """The page's texts by key; a text may hold {names} of values."""

    def __init__(self, content: dict[str, str]) -> None:
        self.content = content

    def __call__(self, key: str, **values: Any) -> str:
        """The text of a key, filled in. Raises KeyError for an unknown key."""
        return self.content[key].format(**values)


@cache
def english() -> Texts:
    """The page's texts."""
    return Texts(json.loads((STATIC / "texts.json").read_text(encoding="utf-8")))
