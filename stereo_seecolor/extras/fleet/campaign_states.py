"""The outcome of the dives of a campaign: campaign.csv for users, campaign.json for itself."""

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Literal

from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.fleet.campaign_files import write_own
from stereo_seecolor.files.csv_tables import guard_formula
from stereo_seecolor.files.json_records import as_record, load_object
from stereo_seecolor.run_folder.own_paths import is_plain_name

TABLE, STATES = "campaign.csv", "campaign.json"
State = Literal["not begun", "done", "some pairs failed", "problems", "failed", "stopped"]
"""problems: all pairs went through, but numbers or the map are not right."""


@dataclass(frozen=True)
class DiveState:
    """The outcome of a dive. ok, failed: numbers of pairs. error: why the dive as a whole, or its
    map, failed, or what its problems are. asked: hash of its inputs and settings in the campaign's
    file.
    """

    name: str
    state: State
    ok: int = 0
    failed: int = 0
    seconds: float = 0.0
    out: str = ""
    error: str = ""
    asked: str = ""


def load_states(root: Path) -> dict[str, DiveState]:
    """The outcome of each dive, by name, from campaign.json; empty where it is missing or damaged.

    Raises InputError where a dive's name leads out of ``root``.
    """
    try:
        states = {
            name: as_record(DiveState, state) for name, state in load_object(root / STATES).items()
        }
    except (OSError, ValueError):
        return {}
    for name in states:
        if not is_plain_name(name):
            raise InputError(
                f"{root / STATES}: it names a dive {name!r}, which is not in {root}: delete this "
                "file"
            )
    return states


def save_states(root: Path, states: Mapping[str, DiveState]) -> None:
    """Write both files. Raises OutputError."""
    write_own(
        root,
        root / STATES,
        json.dumps({name: asdict(state) for name, state in states.items()}, indent=1).encode(),
    )
    text = io.StringIO()
    columns = [field.name for field in fields(DiveState) if field.name != "asked"]
    table = csv.DictWriter(text, columns, extrasaction="ignore", lineterminator="\n")
    table.writeheader()
    table.writerows(
        {key: guard_formula(value) for key, value in asdict(state).items()}
        for state in states.values()
    )
    write_own(root, root / TABLE, text.getvalue().encode())
