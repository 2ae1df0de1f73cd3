"""Another user of the machine reaches every port that a run with workers opens: none of them serves
who lacks the run's keys.
"""

import asyncio
import gc
import os
import pickle
import ssl
import stat
import urllib.error
import urllib.request
import warnings
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from distributed.comm import connect as connect_to
from distributed.security import Security

from stereo_seecolor.errors import ClusterError
from stereo_seecolor.extras.fleet.cluster import connect
from stereo_seecolor.extras.fleet.cluster.connect import cluster
from stereo_seecolor.extras.fleet.cluster.dask_compute import DaskCompute
from stereo_seecolor.extras.fleet.cluster.ticket import Ticket
from stereo_seecolor.extras.fleet.cluster.worker import SharedFile, do_batch

pytestmark = [pytest.mark.slow, pytest.mark.posix]
WAIT_S = 3


@pytest.fixture(scope="module")
def local() -> Iterator[DaskCompute]:
    with cluster("local:1") as compute:
        assert list(compute.each(abs, [-1, 2])) == [1, 2]
        yield compute


@pytest.fixture(autouse=True)
def no_sockets_for_the_next_test() -> Iterator[None]:
    """Sockets of refused connections are closed where they are collected, with a warning: here."""
    yield
    with warnings.catch_warnings(action="ignore", category=ResourceWarning):
        gc.collect()


def open_ports() -> list[tuple[str, int]]:
    """Address and port of every socket that this process and its children listen on."""
    here = psutil.Process()
    found = [
        connection.laddr
        for process in (here, *here.children(recursive=True))
        for connection in process.net_connections("tcp")
        if connection.status == psutil.CONN_LISTEN
    ]
    return [(place.ip, place.port) for place in found]


def test_a_stranger_is_refused_at_every_port(local: DaskCompute) -> None:
    ports = open_ports()
    assert len(ports) >= 2  # of the scheduler and of the worker
    assert {ip for ip, _ in ports} == {"127.0.0.1"}
    places = [f"{ip}:{port}" for ip, port in ports]
    for refused in asyncio.run(_greet_all(places)):
        assert isinstance(refused, OSError | TimeoutError), refused


async def _greet_all(places: list[str]) -> list[object]:
    """What comes of plain and encrypted greetings of all places, at the same time."""
    greetings = [
        _greeted(f"{kind}://{place}", keys())
        for place in places
        for kind, keys in (("tcp", Security), ("tls", Security.temporary))
    ]
    return await asyncio.gather(*greetings, return_exceptions=True)


async def _greeted(address: str, keys: Security) -> str:
    comm = await asyncio.wait_for(
        connect_to(address, timeout=WAIT_S, **keys.get_connection_args("client")), 2 * WAIT_S
    )
    comm.abort()
    return f"{address} answers"


def test_no_port_serves_pages(local: DaskCompute) -> None:
    for ip, port in open_ports():
        for page in (
            "",
            "status",
            "json/identity.json",
            "metrics",
            "info/main/workers.html",
            "api/v1/retire_workers",
        ):
            with pytest.raises((OSError, ssl.SSLError, urllib.error.HTTPError)) as refused:
                urllib.request.urlopen(f"http://{ip}:{port}/{page}", timeout=WAIT_S).read()
            assert getattr(refused.value, "code", 404) == 404, (port, page)


def test_keys_of_batch_jobs_lie_in_files_of_this_user_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "cluster.yaml"
    file.write_text(
        f"{{jobs: 1, cores: 1, memory: 1GB, interface: lo, log_directory: {tmp_path / 'logs'}}}"
    )
    seen: list[Path] = []

    def look(started, *_: object) -> None:  # type: ignore[no-untyped-def]
        assert started.scheduler_address.startswith("tls://")
        assert "--tls-key" in started.job_script()
        seen.extend((tmp_path / "logs").rglob("*"))
        for path in seen:
            assert stat.S_IMODE(path.stat().st_mode) & 0o077 == 0, path
            assert path.stat().st_uid == os.getuid()

    monkeypatch.setattr(connect, "_submit", look)
    with connect._jobs("slurm", file):
        assert any("key" in path.name for path in seen if path.is_file())
    assert not any(path.exists() for path in seen)


def test_work_that_was_exchanged_in_the_shared_folder_is_not_run(tmp_path: Path) -> None:
    done = tmp_path / "done"
    work = SharedFile.write(tmp_path / "work", pickle.dumps(abs))
    assert do_batch(Ticket.mine(()), work, pickle.dumps([-1])).results == [1]
    other = SharedFile.write(tmp_path / "other", pickle.dumps(abs))
    other.path.write_bytes(pickle.dumps(_Touches(done)))
    with pytest.raises(ClusterError, match="was changed or truncated; its code was not run"):
        do_batch(Ticket.mine(()), other, pickle.dumps([-1]))
    assert not done.exists()


class _Touches:
    """Makes a file where it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (self.path,)
