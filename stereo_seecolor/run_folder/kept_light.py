"""Record of the dive's light, and of what it was solved from, kept in OUT so that a rerun does not solve it again."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stereo_seecolor.compute.names import Names
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.json_records import load_object
from stereo_seecolor.files.json_values import JsonText, StreamedList
from stereo_seecolor.run_folder.layout import light_file


@dataclass(frozen=True)
class KeptLight:
    """A solved light.

    key: hash of all that it was solved from. note: what the run reported of it. light: the content of a Light, None = not used.
    linked: frames that show the same as the one before them.
    """

    key: str
    note: str
    light: dict[str, Any] | None
    linked: Collection[str]

    def save(self, root: Path) -> None:
        """Write the record. Raises OutputError."""
        content = {"key": self.key, "note": self.note, "light": self.light, "linked": StreamedList(lambda: self.linked)}
        write_atomic(light_file(root), JsonText(content))

    @classmethod
    def load(cls, root: Path) -> "KeptLight | None":
        """Read the record of an earlier run; None where there is none, or it is damaged."""
        try:
            content = load_object(light_file(root))
            return cls(**{**content, "linked": Names(content["linked"])})
        except (OSError, ValueError, TypeError, KeyError):
            return None
