"""Compiling before a first run: what a run needs, and only once."""

import pytest

from stereo_seecolor.commands import fuse, warm_up
from stereo_seecolor.compute import kernel_cache
from stereo_seecolor.config import MatchingConfig, RunConfig
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.progress import Silence


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The works that are called, which do nothing."""
    found: list[str] = []
    monkeypatch.setattr(warm_up, "_call", found.append)
    return found


def cold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(warm_up, "is_first_run", lambda: True)
    monkeypatch.setattr(warm_up, "cores", lambda: 2)


@pytest.mark.parametrize("work", warm_up.WORKS)
def test_works_run(work: str) -> None:
    warm_up._call(work)


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


def test_a_map_says_which_of_its_stages_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    counted = iter((3, 3, 4, 4, 6, 6))
    monkeypatch.setattr(kernel_cache, "compilations", lambda: next(counted))
    said: list[str] = []

    class Listener(Silence):
        def begin(self, stage: str, total: int) -> None:
            said.append(stage)

    progress = fuse._stages_of(Listener())
    for stage in ("reading", "finding", "finding", "fusing", "painting"):
        progress(stage, 1, 1)
    once = "(compiling for this machine, once)"
    assert said == ["reading", f"finding {once}", f"fusing {once}", "painting"]
