"""Room on the disk: what a run needs is told before it begins, and refused where it cannot end."""

import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from conftest import Cli, Dive

from stereo_seecolor.config import OutputConfig
from stereo_seecolor.errors import OutputError
from stereo_seecolor.run_folder import disk_space
from stereo_seecolor.run_folder.disk_space import check_disk, need_bytes

PIXELS = 1280 * 1024


def free(monkeypatch: pytest.MonkeyPatch, free_bytes: float) -> None:
    monkeypatch.setattr(disk_space.shutil, "disk_usage", lambda _: SimpleNamespace(free=free_bytes))


@pytest.mark.parametrize(
    ("output", "corrected", "megabytes"),
    [
        (OutputConfig(), True, 31),
        (OutputConfig(preset="lean"), True, 6.8),
        (OutputConfig(), False, 10.8),
    ],
)
def test_the_need_is_that_of_the_table_in_the_documentation(
    output: OutputConfig, corrected: bool, megabytes: float
) -> None:
    assert need_bytes(output, PIXELS, corrected) == pytest.approx(megabytes * 1e6, rel=0.05)


def test_a_disk_that_is_too_small_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    free(monkeypatch, 1e9)
    with pytest.raises(
        OutputError,
        match=r"disk: 2000 pairs need about 62 GB, and 1 GB are free: set output\.preset=lean",
    ):
        check_disk(tmp_path, 2000, 31e6, OutputConfig())
    with pytest.raises(OutputError, match="are free: choose an --out on another disk"):
        check_disk(tmp_path, 2000, 31e6, OutputConfig(preset="lean"))


def test_one_that_may_be_too_small_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    free(monkeypatch, 50e9)
    line, is_low = check_disk(tmp_path, 2000, 31e6, OutputConfig())
    assert is_low
    assert line == "disk: 2000 pairs need about 62 GB, and 50 GB are free"
    assert not check_disk(tmp_path, 1000, 31e6, OutputConfig())[1]


@pytest.mark.slow
def test_the_need_is_printed_before_the_work_begins(
    make_dive: Callable[..., Dive], cli: Cli, tmp_path: Path
) -> None:
    dive = make_dive(2)
    _, _, said = cli(*dive.command(tmp_path / "out", command="range"))
    assert re.match(
        r"disk: 2 pairs need about [\d.e-]+ GB, and [\d.e+]+ GB are free\nranges: 0 of 2\n", said
    )
    _, _, said = cli(*dive.command(tmp_path / "out", command="range"))
    assert "disk:" not in said  # nothing more is needed
