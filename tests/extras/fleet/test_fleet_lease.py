"""Who writes into a folder that many machines see: nobody beside another, and nobody's place is
taken without a word.
"""

import json
import os
import subprocess
import sys
import threading
from dataclasses import asdict, replace
from pathlib import Path

import pytest

from stereo_seecolor.errors import OutputError
from stereo_seecolor.run_folder import lease
from stereo_seecolor.run_folder.lease import Holder, LeaseTimes, check_lease, hold_lease, writer


@pytest.fixture
def out(tmp_path: Path) -> Path:
    (tmp_path / ".state").mkdir()
    return tmp_path


def hold(out: Path, holder: Holder, age_s: float = 0.0) -> None:
    file = out / ".state/lease.json"
    file.write_text(json.dumps(asdict(holder)))
    time_s = file.stat().st_mtime - age_s
    os.utime(file, (time_s, time_s))


ELSEWHERE = Holder("ana", "node7", 4242, "t")


def test_a_holder_on_another_machine_is_named(out: Path) -> None:
    hold(out, ELSEWHERE, age_s=60)
    assert writer(out) == "ana@node7, process 4242"
    with (
        pytest.raises(OutputError, match=r"writes into it now \(ana@node7, process 4242\)"),
        hold_lease(out, locked=True),
    ):
        pass


def test_a_stale_lease_is_named_and_not_taken(out: Path) -> None:
    hold(out, ELSEWHERE, age_s=1200)
    assert writer(out) == ""
    stale = r"node7, process 4242, which has shown no activity for 20 min.*remove .*lease"
    with pytest.raises(OutputError, match=stale), hold_lease(out, locked=True):
        pass
    (out / ".state/lease.json").unlink()
    with hold_lease(out, locked=True) as me:
        assert writer(out) == str(me)
    assert not (out / ".state/lease.json").exists()


def test_a_process_of_this_machine_that_is_gone_holds_nothing(out: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    hold(out, replace(Holder.me(), process=gone.pid))
    assert writer(out) == ""
    with hold_lease(out, locked=False):
        pass


def test_a_live_process_of_this_machine_is_refused_where_the_system_has_no_locks(out: Path) -> None:
    hold(out, replace(Holder.me(), process=os.getppid()))
    with pytest.raises(OutputError, match="another run writes"), hold_lease(out, locked=False):
        pass


def test_a_lease_gives_signs_of_life_and_notices_that_it_was_lost(
    out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lease, "TIMES", LeaseTimes(beat_s=0.01))
    beaten, utime = threading.Event(), os.utime
    monkeypatch.setattr(lease.os, "utime", lambda *of: (utime(*of), beaten.set()))
    with hold_lease(out, locked=True) as me:
        assert beaten.wait(60)
        check_lease(out, me.token)
        hold(out, ELSEWHERE)
        with pytest.raises(
            OutputError,
            match=r"no longer locked by this run: ana@node7, process 4242 writes into it now",
        ):
            check_lease(out, me.token)
    assert Holder.load(out) == ELSEWHERE
    (out / ".state/lease.json").unlink()
    with pytest.raises(OutputError, match=r"lease\.json was removed"):
        check_lease(out, me.token)


def test_a_network_that_fails_for_a_moment_costs_no_lease(
    out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with hold_lease(out, locked=True) as me:
        with monkeypatch.context() as failing:
            failing.setattr(Path, "read_bytes", stale_handle)
            check_lease(out, me.token)
            assert lease._beat(out, me)
            assert writer(out) == ""
        assert lease._beat(out, me)
    assert not (out / ".state/lease.json").exists()


def stale_handle(path: Path) -> bytes:
    raise OSError(116, "Stale file handle")


def test_where_the_file_system_has_no_locks_the_lease_alone_guards_the_folder(
    tmp_path: Path, monkeypatch
) -> None:
    def no_locks(self) -> None:
        raise OSError(lease.errno.ENOLCK, "No locks available")

    monkeypatch.setattr(lease.FileLock, "_acquire", no_locks)
    with lease.held(tmp_path), pytest.raises(OutputError), lease.held(tmp_path):
        pass
