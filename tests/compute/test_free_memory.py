"""No more pairs at once than fit into the memory that is free."""

from pathlib import Path

import pytest

from stereo_seecolor.compute import free_memory
from stereo_seecolor.compute.free_memory import at_once, free_bytes
from stereo_seecolor.dive.run_options import RunOptions

GIB = 1 << 30


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A machine with 16 GiB to be had; its control groups lie in the folder given."""
    meminfo = tmp_path / "meminfo"
    meminfo.write_text(
        "MemTotal:       33554432 kB\nMemFree:         1048576 kB\nMemAvailable:   16777216 kB\n"
    )
    monkeypatch.setattr(free_memory, "_MEMINFO", meminfo)
    monkeypatch.setattr(free_memory, "_GROUPS", tmp_path)
    return tmp_path


def test_memory_is_that_of_the_machine_or_of_its_container(machine: Path) -> None:
    assert free_bytes() == 16 * GIB
    (machine / "memory.max").write_text("max\n")
    assert free_bytes() == 16 * GIB
    (machine / "memory.max").write_text(f"{4 * GIB}\n")
    assert free_bytes() == 4 * GIB


@pytest.mark.parametrize(
    ("folder", "names", "cached"),
    [
        ("", ("memory.max", "memory.current", "memory.stat"), "inactive_file"),
        (
            "memory",
            ("memory.limit_in_bytes", "memory.usage_in_bytes", "memory.stat"),
            "total_inactive_file",
        ),
    ],
)
def test_what_a_container_uses_is_not_free_but_copies_of_files_are(
    machine: Path, folder: str, names: tuple[str, str, str], cached: str
) -> None:
    home = machine / folder
    home.mkdir(exist_ok=True)
    limit, usage, statistics = (home / name for name in names)
    limit.write_text(f"{8 * GIB}\n")
    usage.write_text(f"{5 * GIB}\n")
    assert free_bytes() == 3 * GIB
    statistics.write_text(f"anon {3 * GIB}\n{cached} {2 * GIB}\nactive_file 0\n")
    assert free_bytes() == 5 * GIB
    usage.write_text(f"{11 * GIB}\n")
    assert free_bytes() == 0
    assert at_once(8, GIB) == 1


@pytest.mark.usefixtures("machine")
def test_so_many_pieces_of_work_as_fit_and_at_least_one() -> None:
    assert [at_once(8, size * GIB) for size in (1, 3, 5, 100)] == [8, 4, 2, 1]


@pytest.mark.usefixtures("machine")
def test_fewer_pairs_at_once_are_said_once_and_enough_memory_nothing() -> None:
    said: list[str] = []
    options = RunOptions(workers=4, notice=said.append)
    assert options.within_memory(1e9) is options
    assert said == []
    assert options.within_memory(5 * GIB).workers == 2
    assert said == [
        "memory: a pair takes about 5.4 GB during processing: 2 at once instead of 4, because "
        "more memory is not free"
    ]


def test_where_the_system_does_not_say_all_are_done_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(free_memory, "_MEMINFO", tmp_path / "absent")
    monkeypatch.setattr(free_memory, "_GROUPS", tmp_path)
    assert at_once(6, 1e15) == 6
