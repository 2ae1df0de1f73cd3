"""Keys made for one run: scheduler, workers and client of a cluster that this program starts know
each other by them.

Without, whoever reaches a port of Dask's, as every user does, sends it pickled code to run.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from stereo_seecolor.errors import ClusterError, library_for

NO_PAGES: dict[str, Any] = {
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
}
WITHOUT_PAGES: dict[str, Any] = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
"""Settings and arguments of a scheduler: Dask's web pages have no keys, and none is served."""


def run_keys(name: str) -> Any:
    """Dask's ``Security`` with a key and a certificate, in memory alone. Raises ClusterError where
    no library makes them.
    """
    from distributed.security import Security

    with library_for(f"--cluster {name}", "cluster", ClusterError):  # cryptography
        return Security.temporary()  # type: ignore[no-untyped-call]


def workers_part(keys: Any) -> dict[str, str]:
    """What a worker needs of them, to be sent on a private way."""
    part = keys.get_tls_config_for_role("worker")
    return {name: part[name] for name in ("ca_file", "key", "cert")}


def of_worker(part: dict[str, str]) -> Any:
    """A worker's ``Security``."""
    return _security(("worker",), part)


def in_files(keys: Any, folder: Path) -> Any:
    """The same keys in files of ``folder``, which is this user's alone: jobs on other machines read
    them. Raises OSError.
    """
    part = {}
    for name, content in workers_part(keys).items():
        part[name] = str(folder / f"{name}.pem")
        with os.fdopen(
            os.open(part[name], os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w"
        ) as file:
            file.write(content)
    return _security(("client", "scheduler", "worker"), part)


def _security(roles: Sequence[str], part: dict[str, str]) -> Any:
    from distributed.security import Security

    own = {f"tls_{role}_{name}": part[name] for role in roles for name in ("key", "cert")}
    return Security(require_encryption=True, tls_ca_file=part["ca_file"], **own)  # type: ignore[no-untyped-call]
