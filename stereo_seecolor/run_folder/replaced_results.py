"""What each command may delete or replace of results; inputs there are refused."""

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from stereo_seecolor.errors import OutputError
from stereo_seecolor.run_folder.layout import (
    DIVE_FILES,
    FRAMES_TABLE,
    INDEX,
    MAP,
    MEASURED_WATER,
    PAGE,
    PLAN,
    PRODUCTS,
    STATE,
)

RESULTS = (
    *dict.fromkeys(f"{name.partition('/')[0]}/" for name in (*PRODUCTS, MAP, PAGE)),
    *(INDEX, *DIVE_FILES),
)
"""All that the program writes into OUT for users; folders, with all in them, end in "/"."""


@dataclass(frozen=True)
class Replaces:
    """What a command may delete or replace.

    results: names in OUT as in RESULTS: only what the program wrote there, and as it wrote it.
    what: the same, and when, in words.
    """

    results: tuple[str, ...]
    what: str

    def includes(self, name: str) -> bool:
        """Whether it may delete or replace a file or folder. name: its path relative to OUT."""
        return any(
            f"{name}/".startswith(result if result.endswith("/") else f"{result}/")
            for result in self.results
        )


OF_STATE = f"{STATE}/"
ALL_RESULTS = Replaces(
    (*RESULTS, OF_STATE),
    "results that changed inputs or settings make stale; with `--overwrite` all results",
)
FUSED = ("corrected/", "original/corrected/", FRAMES_TABLE, f"{MAP}/", INDEX, f"{PAGE}/", OF_STATE)

REPLACES: dict[str, Replaces] = {
    "run": Replaces(
        ALL_RESULTS.results, f"{ALL_RESULTS.what}, and an earlier recording at `--out-mcap`"
    ),
    **dict.fromkeys(("range", "correct", "rectify", "merge"), ALL_RESULTS),
    "campaign": Replaces(
        ALL_RESULTS.results,
        "the same as `range` in the folder of each dive; also `campaign.csv`, `campaign.json`, "
        "`records/` and `waters/`, if unchanged since it wrote them",
    ),
    "demo": Replaces(ALL_RESULTS.results, "all results of an earlier demo"),
    "fuse": Replaces(
        FUSED, f"`{MAP}/`, `{FRAMES_TABLE}`, the page, the position in the EXIF of corrected images"
    ),
    "report": Replaces((INDEX, f"{PAGE}/", OF_STATE), f"the page: `{INDEX}`, `{PAGE}/`"),
    "water": Replaces((MEASURED_WATER,), f"`{MEASURED_WATER}`"),
    "plan": Replaces((f"{STATE}/{PLAN}",), f"`{STATE}/{PLAN}`"),
    **dict.fromkeys(
        (
            *(
                "calibrate",
                "convert-calib",
                "check",
                "export",
                "metrics",
                "compare",
                "markers",
                "evaluate",
                "synthesize",
                "live",
            ),
            *("inspect", "view", "measure", "bag-info", "sync", "status", "doctor", "config"),
        ),
        Replaces((), "nothing: they write only new files, or none"),
    ),
}
"""Command -> what it may delete or replace."""


def refuse_inputs(
    command: str, root: Path, inputs: Iterable[Path], unchanged: Iterable[str] = ()
) -> None:
    """Raise OutputError where an input lies in what a command may delete or replace in OUT.

    inputs: every file and folder that it reads, of any kind; links are followed. unchanged: names
    in OUT that this run leaves as they are, or writes again with the content that it reads.
    command: one that a package adds may replace all results.
    """
    home, replaces, safe = root.resolve(), REPLACES.get(command, ALL_RESULTS), set(unchanged)
    for given in inputs:
        for place in _places(given):
            name = place.relative_to(home).as_posix() if place.is_relative_to(home) else ""
            if name not in safe and replaces.includes(name):
                raise OutputError(
                    f"{given}: is an input of this run, and would be deleted or replaced in "
                    f"{root}: copy it elsewhere first, or choose another --out; nothing was changed"
                )


def _places(given: Path) -> Iterator[Path]:
    """Where an input lies: the file or folder itself, and where the links in a folder lead."""
    yield given.resolve()
    if given.is_dir():
        with os.scandir(given) as entries:
            yield from (Path(entry.path).resolve() for entry in entries if entry.is_symlink())
