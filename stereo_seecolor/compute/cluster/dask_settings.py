"""Settings of Dask for client, scheduler and the workers of this machine."""

from typing import Any

FAILURES_ALLOWED = 10
"""Workers that a batch may lose before it is given up: machines are taken away, but a batch that ends every worker ends the run."""
LOST_S = 60
"""Seconds that a lost worker has to come back by itself, before another is started in its place."""

DASK_SETTINGS: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": FAILURES_ALLOWED,
    "distributed.deploy.lost-worker-timeout": LOST_S,
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.memory.monitor-interval": "500ms",
}
"""What Dask does by itself, many times a second on each process, costs a twentieth of a core: here it does so seldom."""
