"""The files of a campaign: only unchanged ones that the campaign wrote are replaced."""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path

from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.atomic import Content, write_atomic
from stereo_seecolor.files.json_records import load_object

WRITTEN = ".campaign-files.json"
"""In the campaign's folder: SHA-256 of each file that it wrote, of what was there before and of the
new: a kill leaves either.
"""
FORMAT = "stereo-seecolor/campaign-files"


def refuse_files_of_others(root: Path, files: Iterable[Path]) -> None:
    """Raise OutputError where one of ``files`` is there and not as the campaign wrote it."""
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
    """Write a file of a campaign in ``root``. Raises OutputError, also for another's file."""
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
