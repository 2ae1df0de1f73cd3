"""The records of a campaign's dives: iFDO that its own library reads, STAC with all that its
specification asks for.
"""

import json
from pathlib import Path

import ifdo
import pytest
from mapping_scene import PAIR, flat_frames, write_map, write_run

from stereo_seecolor.extras.export import stac
from stereo_seecolor.extras.fleet.campaign_records import write_records


@pytest.mark.slow
def test_dives_have_records(tmp_path: Path) -> None:
    write_map(tmp_path / "mapped", flat_frames(4))
    write_run(tmp_path / "frames", flat_frames(4), PAIR)
    folder = write_records(
        tmp_path, {name: tmp_path / name for name in ("mapped", "frames", "gone")}
    )
    assert {path.name for path in folder.iterdir()} == {
        "collection.json",
        "mapped.json",
        "frames.json",
        "mapped.ifdo.yaml",
    }
    read = ifdo.iFDO.load(folder / "mapped.ifdo.yaml")
    assert len(read.image_set_items) == 4
    where = folder / read.image_set_header.image_set_local_path
    assert all((where / image).is_file() for image in read.image_set_items)
    item = json.loads((folder / "mapped.json").read_text())
    assert (item["type"], item["stac_version"], item["id"], item["geometry"]) == (
        "Feature",
        "1.0.0",
        "mapped",
        None,
    )
    assert item["properties"]["start_datetime"].endswith("Z")
    assert {"frames.csv", "map/cloud.ply", "ifdo"} <= item["assets"].keys()
    assert all((folder / asset["href"]).is_file() for asset in item["assets"].values())
    whole = json.loads((folder / "collection.json").read_text())
    assert {(folder / link["href"]).name for link in whole["links"]} == {
        "mapped.json",
        "frames.json",
    }


def test_a_collection_spans_its_items() -> None:
    times = {
        "start_datetime": "2026-01-01T00:00:00.000Z",
        "end_datetime": "2026-01-02T00:00:00.000Z",
    }
    items = [
        {"id": name, "bbox": box, "properties": times}
        for name, box in (("a", [1, 2, 3, 4]), ("b", [0, 3, 2, 5]))
    ]
    extent = stac.collection(items, "site")["extent"]
    assert extent == {
        "spatial": {"bbox": [[0, 2, 3, 5]]},
        "temporal": {"interval": [[times["start_datetime"], times["end_datetime"]]]},
    }
