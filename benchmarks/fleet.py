"""Runs on a cluster of this machine: kills while they work, and what a batch costs beside its work.

python benchmarks/fleet.py WHAT, one of:

kills: same bytes as threads, after kills of workers, clients and schedulers
batches --number 2000: processor time of client and scheduler a batch, and their memory
million --folder OUT: a million pairs on 200 workers, simulated; OUT: a run with tables
client --number 1000000: memory of the client through all passes; 20 minutes, /proc of Linux
scheduler --number 1000000: memory of a scheduler with 200 workers; 15 minutes, free port 18786
growth: docs/images/fleet_growth.svg
"""

import tempfile
import time
from pathlib import Path

import psutil
from arguments import parser_of
from fleet_client import client
from fleet_kills import Harm, kills
from fleet_million import growth, million
from fleet_scheduler import measure_scheduler

from stereo_seecolor.extras.fleet.cluster import batches
from stereo_seecolor.extras.fleet.cluster.connect import cluster


def overhead(number: int) -> None:
    batches.SETTINGS = batches.BatchSettings(most=1)
    with cluster("local:2") as compute:
        list(compute.each(abs, range(20)))
        start_s, begun = time.process_time(), time.monotonic()
        list(compute.each(abs, range(number)))
        cost_ms = 1000 * (time.process_time() - start_s) / number
        memory = psutil.Process().memory_info().rss / 1e6
        print(
            f"{number} batches: {cost_ms:.1f} ms of client and scheduler each, {memory:.0f} MB, "
            f"{time.monotonic() - begun:.0f} s"
        )


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument(
        "what", choices=("kills", "batches", "million", "growth", "client", "scheduler")
    )
    parser.add_argument("--kills", type=int, default=30, help="of workers")
    parser.add_argument("--clients", type=int, default=5, help="clients killed")
    parser.add_argument("--schedulers", type=int, default=3, help="schedulers killed")
    parser.add_argument(
        "--every-s",
        type=float,
        default=8.0,
        help="seconds between two kills of workers, on average",
    )
    parser.add_argument("--pairs", type=int, default=40)
    parser.add_argument(
        "--number", type=int, default=2000, help="of batches, or of pairs for client and scheduler"
    )
    parser.add_argument(
        "--recorded", action="store_true", help="client: with exposures that the camera recorded"
    )
    parser.add_argument("--folder", type=Path, help="of the dive and the runs; it stays")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        if options.what == "kills":
            after_s = [
                options.every_s * (2 + number)
                for number in range(max(options.clients, options.schedulers))
            ]
            harm = Harm(
                options.kills,
                after_s[: options.clients],
                after_s[: options.schedulers],
                options.every_s,
            )
            kills(folder, options.pairs, harm)
        elif options.what == "batches":
            overhead(options.number)
        elif options.what == "client":
            client(options.number, options.recorded)
        elif options.what == "scheduler":
            measure_scheduler(options.number, 200)
        elif options.what == "growth":
            growth(Path(__file__).resolve().parents[1] / "docs" / "images" / "fleet_growth.svg")
        else:
            million(1_000_000, 200, options.folder)


if __name__ == "__main__":
    main()
