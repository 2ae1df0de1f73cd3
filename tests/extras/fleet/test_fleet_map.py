"""A map whose frames, pairs of frames and tiles are work for the processes of a cluster: the same
bytes as on threads.
"""

import shutil
from pathlib import Path

import pytest
from mapping_scene import CONFIG, ReefFrames, write_run

from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.compute.threads import Threads
from stereo_seecolor.config import RunConfig
from stereo_seecolor.errors import MappingError
from stereo_seecolor.extras.fleet.cluster import dask_compute
from stereo_seecolor.extras.fleet.cluster.connect import cluster
from stereo_seecolor.extras.synthetic.survey import SurveySpec


def map_files(out: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(out)): path.read_bytes()
        for path in (out / "map").rglob("*")
        if path.is_file()
    }


@pytest.mark.slow
def test_a_map_is_made_on_workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dask_compute, "LARGE_BYTES", 0)  # work travels as a file
    frames = ReefFrames(SurveySpec(pairs=8, lines=2, image_size=(240, 192)), noise_px=0.05)
    write_run(tmp_path / "cluster", frames, frames.pair)
    (tmp_path / "cluster/range" / f"{frames[5].name}.tiff").unlink()
    shutil.copytree(tmp_path / "cluster", tmp_path / "threads")
    config = RunConfig(mapping=CONFIG)
    on_threads = fuse(tmp_path / "threads", None, config, compute=Threads(2))
    with cluster("local:2") as compute:
        on_cluster = fuse(tmp_path / "cluster", None, config, compute=compute)
    assert (on_cluster.placed, [lost.name for lost in on_cluster.unplaced]) == (7, [frames[5].name])
    assert on_cluster.placed == on_threads.placed
    assert map_files(tmp_path / "cluster") == map_files(tmp_path / "threads")
    assert not list((tmp_path / "cluster").rglob(".writing-*"))
    assert not (tmp_path / "cluster/.state/fusion").exists()


@pytest.mark.slow
def test_a_map_that_was_stopped_goes_on_from_the_features_and_tiles_that_were_done(
    tmp_path: Path,
) -> None:
    frames = ReefFrames(SurveySpec(pairs=6, lines=2, image_size=(240, 192)), noise_px=0.05)
    write_run(tmp_path / "out", frames, frames.pair)
    config = RunConfig(mapping=CONFIG)

    class Stops:
        """Stops the map after the first tile."""

        def begin(self, stage: str, total: int) -> None:
            self.stage = stage

        def advance(self, row: object) -> None:
            if self.stage == "fusing tiles":
                raise MappingError("stopped")

    with pytest.raises(MappingError, match="stopped"):
        fuse(tmp_path / "out", None, config, Stops())
    kept = {
        path: path.stat().st_mtime_ns for path in (tmp_path / "out/.state/fusion").rglob("*.npz")
    }
    assert {path.parts[-3] for path in kept} == {"features", "0"}  # 0: tiles of the first component
    seen: set[str] = set()

    class Looks:
        """Notes which of the kept files are still as they were."""

        def begin(self, stage: str, total: int) -> None:
            pass

        def advance(self, row: object) -> None:
            seen.update(
                path.name
                for path in kept
                if path.exists() and path.stat().st_mtime_ns == kept[path]
            )

    fuse(tmp_path / "out", None, config, Looks())
    assert seen == {path.name for path in kept}
