"""Metadata of a campaign for archives: iFDO of each dive's images, STAC of all dives."""

import json
import logging
import os
from collections.abc import Mapping
from pathlib import Path

from calibration import CalibrationError
from stereo_seecolor.errors import SeeColorError
from stereo_seecolor.extras.export import ifdo, stac
from stereo_seecolor.extras.fleet.campaign_files import write_own
from stereo_seecolor.run_folder.finished_map import open_map
from stereo_seecolor.run_folder.posed_run import open_posed_run

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
