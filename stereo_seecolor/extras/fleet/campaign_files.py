"""The files of a campaign next to the folders of its dives: only unchanged files that the campaign
wrote are replaced.
"""

import csv
import hashlib
import io
import json
import logging
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Literal

from calibration import CalibrationError
from stereo_seecolor.errors import InputError, OutputError, SeeColorError
from stereo_seecolor.extras.export import ifdo, stac
from stereo_seecolor.files.atomic import Content, write_atomic
from stereo_seecolor.files.csv_tables import guarded
from stereo_seecolor.files.json_records import as_record, load_object
from stereo_seecolor.run_folder.finished_run import open_map
from stereo_seecolor.run_folder.own_paths import is_plain_name
from stereo_seecolor.run_folder.posed_run import open_posed_run

WRITTEN = ".campaign-files.json"
"""In the campaign's folder: SHA-256 of each file that it wrote, of what was there before and of the
new: a kill leaves either.
"""
FORMAT = "stereo-seecolor/campaign-files"


def refuse_files_of_others(root: Path, files: Iterable[Path]) -> None:
    """Raise OutputError where one of ``files`` in a campaign's folder is there and is not as the
    campaign wrote it.
    """
    written = _written(root)
    for file in files:
        if file.is_symlink() or (
            file.exists() and not _is_of(file, written.get(_name(root, file), ()))
        ):
            raise OutputError(
                f"{file}: was not written by this campaign, or was changed afterwards, and would "
                "be replaced: move it elsewhere"
            )


def write_own(root: Path, file: Path, content: Content) -> None:
    """Write a file of a campaign whose folder is ``root``. Raises OutputError, also where another's
    file is in its place.
    """
    refuse_files_of_others(root, [file])
    whole = bytes(content) if isinstance(content, bytes | memoryview) else b"".join(content)
    written, name = _written(root), _name(root, file)
    hashes = [*([_sha256(file.read_bytes())] if file.exists() else []), _sha256(whole)]
    write_atomic(
        root / WRITTEN, json.dumps({"format": FORMAT, "files": {**written, name: hashes}}).encode()
    )
    write_atomic(file, whole)


def _name(root: Path, file: Path) -> str:
    return file.relative_to(root).as_posix()


def _is_of(file: Path, hashes: Iterable[str]) -> bool:
    return file.is_file() and _sha256(file.read_bytes()) in hashes


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _written(root: Path) -> dict[str, list[str]]:
    file = root / WRITTEN
    try:
        content = load_object(file)
        if content["format"] != FORMAT:
            raise ValueError("another format")
        return dict(content["files"])
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OutputError(
            f"{file}: does not have the form that this program writes: move it elsewhere; nothing "
            "was changed"
        ) from error


# Metadata of a campaign for archives and catalogs: iFDO of the images of each dive with a map,
# STAC of all dives.

RECORDS, COLLECTION = "records", "collection.json"

log = logging.getLogger(__name__)


def write_records(root: Path, dives: Mapping[str, Path]) -> Path:
    """Write records/ in ``root``: collection.json and NAME.json (STAC), and NAME.ifdo.yaml for
    dives with a map.

    dives: name -> output folder. A dive that cannot be read is named in the log and left out.
    Raises OutputError.
    """
    folder, items = root / RECORDS, []
    for name, out in dives.items():
        try:
            item = stac.item(out, name, folder)
            images = _image_record(out, folder) if open_map(out) else None
        except (SeeColorError, CalibrationError) as error:
            log.warning("%s: has no record: %s", name, error)
            continue
        if images:
            write_own(root, folder / f"{name}.ifdo.yaml", images)
            item["assets"]["ifdo"] = {
                "href": f"{name}.ifdo.yaml",
                "type": "application/yaml",
                "title": "metadata of the images",
            }
        write_own(
            root, folder / f"{name}.json", json.dumps(item, indent=1, allow_nan=False).encode()
        )
        items.append(item)
    whole = stac.collection(items, root.resolve().name)
    write_own(root, folder / COLLECTION, json.dumps(whole, indent=1, allow_nan=False).encode())
    return folder


def _image_record(out: Path, folder: Path) -> bytes:
    posed = open_posed_run(out)
    images = [frame.products["corrected"] for frame in posed.frames]
    corrected = out / "corrected"
    return ifdo.document(
        posed, images, corrected, Path(os.path.relpath(corrected, folder)).as_posix()
    )


# The outcome of the dives of a campaign: campaign.csv for users, campaign.json for the next run
# of the campaign.

TABLE, STATES = "campaign.csv", "campaign.json"
State = Literal["not begun", "done", "some pairs failed", "failed", "stopped"]


@dataclass(frozen=True)
class DiveState:
    """The outcome of a dive. ok, failed: numbers of pairs. error: why the dive as a whole, or its
    map, failed.
    """

    name: str
    state: State
    ok: int = 0
    failed: int = 0
    seconds: float = 0.0
    out: str = ""
    error: str = ""


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
    table = csv.DictWriter(text, [field.name for field in fields(DiveState)], lineterminator="\n")
    table.writeheader()
    table.writerows(
        {key: guarded(value) for key, value in asdict(state).items()} for state in states.values()
    )
    write_own(root, root / TABLE, text.getvalue().encode())
