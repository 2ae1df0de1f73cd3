"""Compiling before a first run: what a run needs, by several processes, and only once."""

from pathlib import Path

import pytest

from stereo_seecolor.commands import warm_up
from stereo_seecolor.compute.compiled import call_in_processes
from stereo_seecolor.config import MatchingConfig, RunConfig
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.progress import Silence

CALLED = """
from pathlib import Path
def good(): Path("good").touch()
def bad(): raise ValueError
"""


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is called in other processes, which are not started."""
    found: list[str] = []
    monkeypatch.setattr(warm_up, "call_in_processes", lambda works: [found.extend(works) or works])
    return found


def cold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warm_up, "is_first_run", lambda: True)
    monkeypatch.setattr(warm_up, "cores", lambda: 2)


def test_each_function_is_called_and_one_that_fails_stops_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "called.py").write_text(CALLED)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    names = ["called:good", "called:bad"]
    monkeypatch.setattr("stereo_seecolor.compute.compiled.cores", lambda: 2)
    assert sorted(name for share in call_in_processes(names) for name in share) == sorted(names)
    assert (tmp_path / "good").exists()


def test_a_copy_of_the_package_in_the_present_folder_is_not_what_is_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "stereo_seecolor").mkdir()
    (tmp_path / "stereo_seecolor/__init__.py").write_text(
        "from pathlib import Path\nPath('imported').touch()\n"
    )
    monkeypatch.chdir(tmp_path)
    assert list(call_in_processes(["stereo_seecolor.compute.process:tune_gc"]))
    assert not (tmp_path / "imported").exists()


@pytest.mark.parametrize("work", warm_up.WORKS)
def test_works_run(work: str) -> None:
    module, _, function = work.partition(":")
    getattr(__import__(module, fromlist=[function]), function)()


def test_a_first_run_says_that_it_compiles(
    calls: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    cold(monkeypatch)
    said: list[tuple[str, int]] = []

    class Listener(Silence):
        def begin(self, stage: str, total: int) -> None:
            said.append((stage, total))

    warm_up.compile_for(RunConfig(), RunOptions(listener=Listener()))
    assert said == [("compiling for this machine, once", len(warm_up.WORKS))]
    assert tuple(calls) == warm_up.WORKS


def test_nothing_is_compiled_twice_or_for_another_engine(
    calls: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    cold(monkeypatch)
    warm_up.compile_for(RunConfig(matching=MatchingConfig(engine="opencv")), RunOptions())
    monkeypatch.setattr(warm_up, "is_first_run", lambda: False)
    warm_up.compile_for(RunConfig(), RunOptions())
    assert calls == []


def test_a_later_run_begins_to_load_what_it_needs_unless_it_may_have_to_compile(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun: list[object] = []
    monkeypatch.setattr(warm_up.Alongside, "put", lambda _, work: begun.append(work))
    cold(monkeypatch)
    warm_up.load_in_background(RunConfig(), RunOptions())
    assert not begun
    monkeypatch.setattr(warm_up, "is_first_run", lambda: False)
    warm_up.load_in_background(RunConfig(matching=MatchingConfig(engine="opencv")), RunOptions())
    assert not begun
    warm_up.load_in_background(RunConfig(), RunOptions())
    assert len(begun) == 1
