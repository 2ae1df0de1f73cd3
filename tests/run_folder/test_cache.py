"""What a run keeps for a rerun: found again under its own key, and else as if it were not there."""

from pathlib import Path

import pytest

from calibration.formats import native
from stereo_seecolor.config import RunConfig
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.run_folder.cache import (
    KeptFit,
    KeptLight,
    KeptPlan,
    KeptRefinement,
    keep,
    kept,
)
from stereo_seecolor.run_folder.layout import cache_file
from tests.support.calibration_boards import pinhole_rig

KEY, OTHER = content_key("this"), content_key("other")
LOADERS = {"light": KeptLight.load, "fit": KeptFit.load, "refined_rig": KeptRefinement.load}


def test_content_is_found_under_its_own_key_alone(tmp_path: Path) -> None:
    file = tmp_path / "folder/thing.kept"
    assert kept(file, KEY) is None
    keep(file, KEY, [b"first ", b"second"])
    assert (kept(file, KEY), kept(file, OTHER)) == (b"first second", None)
    file.write_bytes(file.read_bytes()[:-3])
    assert kept(file, KEY) is None


def test_each_record_reads_back_as_it_was(tmp_path: Path) -> None:
    light = KeptLight("two lamps", {"log_gains": [0.0, 0.1]}, ["a", "b"])
    light.save(tmp_path, KEY)
    back = KeptLight.load(tmp_path, KEY)
    assert back
    assert (back.note, back.light, list(back.linked)) == (light.note, light.light, ["a", "b"])
    fit = KeptFit(("one note",), "0" * 64)
    fit.save(tmp_path, KEY)
    assert KeptFit.load(tmp_path, KEY) == fit
    rig = pinhole_rig()
    KeptRefinement(native.to_content(rig), {"a": {"left": "1"}}, "moved").save(tmp_path, KEY)
    found = KeptRefinement.load(tmp_path, KEY)
    assert found
    assert found.stereo_rig
    assert native.to_bytes(found.stereo_rig) == native.to_bytes(rig)
    plan, config = KeptPlan(3, 1.0, 2.0, 10, 20, {"ranges": 0.5}), RunConfig()
    plan.save(tmp_path, KeptPlan.key(3, config))
    assert KeptPlan.load(tmp_path, KeptPlan.key(3, config)) == plan
    assert KeptPlan.load(tmp_path, KeptPlan.key(4, config)) is None


@pytest.mark.parametrize("name", LOADERS)
@pytest.mark.parametrize(
    "content", [b"", b"[]", b"null", b"{}", b'{"note": 1}', b"{", b"\xff", b"[" * 100_000]
)
def test_a_record_of_another_form_is_as_if_it_were_not_there(
    name: str, content: bytes, tmp_path: Path
) -> None:
    keep(cache_file(tmp_path, name), KEY, [content])
    assert LOADERS[name](tmp_path, KEY) is None
