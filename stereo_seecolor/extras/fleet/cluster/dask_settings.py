"""Settings of Dask for the client, the scheduler and the workers."""

from typing import Any

from stereo_seecolor.extras.fleet.cluster.run_keys import NO_PAGES

FAILURES_ALLOWED = 10
"""Workers that a batch may lose before it is given up: machines may be withdrawn, but a batch that
kills every worker must not.
"""
LOST_S = 60
"""Seconds for a lost worker to connect again, before another is started in its place."""
DASK_SETTINGS: dict[str, Any] = {
    "distributed.scheduler.allowed-failures": FAILURES_ALLOWED,
    "distributed.deploy.lost-worker-timeout": LOST_S,
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.memory.monitor-interval": "500ms",
    **NO_PAGES,
}
"""Dask's monitoring takes a twentieth of a core by default: here it is infrequent."""
