"""Does a dive of any length end as it should? Kills at random instants, and memory over thousands
of pairs.

    python benchmarks/endurance.py kills --pairs 40 --kills 50
    python benchmarks/endurance.py soak --pairs 2000

kills: SIGKILL at random instants, resumed each time; the final outputs must be those of an
uninterrupted run, byte for byte, and at no instant may anything but a whole file be seen. soak:
resident memory after 100 pairs and at the end.
"""

import argparse
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from arguments import sides
from throughput import make_dive

PRODUCTS = ("corrected", "range", "range_std", "confidence", "mask", "clouds")


def command(dive: Path, out: Path) -> list[str]:
    program = str(Path(sys.executable).parent / "stereo-seecolor")
    given = sides(dive, dive / "rendered/cam.yaml")
    return [program, "run", *given, "--out", str(out), "--set", "color.lock=survey"]


def contents(out: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(out)): p.read_bytes()
        for product in PRODUCTS
        for p in (out / product).glob("*")
        if p.name[0] != "."
    }


def kills(dive: Path, count: int) -> None:
    start = time.perf_counter()
    subprocess.run(command(dive, dive / "whole"), check=True, stdout=subprocess.DEVNULL)
    whole_s = time.perf_counter() - start
    truth, killed = contents(dive / "whole"), dive / "killed"
    rng = random.Random(1)
    landed = ended = partial = leftovers = 0
    differ: set[str] = set()
    while landed < count:
        process = subprocess.Popen(
            command(dive, killed), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        time.sleep(rng.uniform(0.3, 1.0 + 0.3 * whole_s))
        process.kill()
        process.communicate()
        final = contents(killed)
        partial += sum(content != truth[name] for name, content in final.items())
        if process.returncode == -signal.SIGKILL:
            landed += 1
            continue
        ended += 1  # this run was done before its kill: it is judged, and the next begins anew
        differ |= {
            name for name in truth.keys() | final.keys() if truth.get(name) != final.get(name)
        }
        leftovers += len(list(killed.rglob(".writing-*")))
        shutil.rmtree(killed)
    print(f"{landed} kills in {ended} runs of {len(truth)} outputs that ended in the end")
    print(
        f"outputs that differ from an uninterrupted run's: {len(differ)} {sorted(differ)[:3]}; "
        f"temporary files left: {leftovers}"
    )
    print(f"files that were not whole, or not the same, at any kill: {partial}")


def soak(dive: Path, out: Path) -> None:
    process = subprocess.Popen(command(dive, out), stdout=subprocess.DEVNULL)
    samples: list[tuple[int, float]] = []
    while process.poll() is None:
        time.sleep(0.5)
        done = len(list((out / "range").glob("*.tiff"))) + len(
            list((out / "corrected").glob("*.png"))
        )
        try:
            pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
        except (OSError, IndexError):
            break
        if pages:
            samples.append((done, pages * 4096 / 2**20))
    at_100 = next(mib for done, mib in samples if done >= 100)
    print(
        f"{samples[-1][0] // 2} pairs, both passes: {at_100:.0f} MiB after 100 pairs, "
        f"{samples[-1][1]:.0f} MiB at the end, ",
        end="",
    )
    print(f"{max(mib for _, mib in samples):.0f} MiB at most; exit code {process.returncode}")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("kills", "soak"))
    parser.add_argument("--pairs", type=int, default=40)
    parser.add_argument("--kills", type=int, default=50)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        dive = Path(folder)
        make_dive(dive, options.pairs, (320, 256) if options.what == "kills" else (160, 128))
        kills(dive, options.kills) if options.what == "kills" else soak(dive, dive / "out")


if __name__ == "__main__":
    main()
