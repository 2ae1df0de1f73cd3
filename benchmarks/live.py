"""How long live pairs take from their arrival: to the corrected image, and until range and cloud
are written.

    python benchmarks/live.py --size 1280 1024 --rates 4 5 15 --pairs 100

Eight pairs are rendered and played again and again from a bag at each rate; every rate is a process
of its own, with all products kept in a folder. Prints median and 95th percentile of both latencies,
pairs done and passed over, and processor time a pair.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from arguments import parser_of

RENDERED = 8
START_NS = 1_700_000_000_000_000_000


def write_bag(dive: Path, bag: Path, pairs: int, rate_hz: float, jpeg: bool) -> None:
    """Both sides as sensor_msgs/Image (bgr8), or as JPEG in sensor_msgs/CompressedImage; chunks are
    not compressed.
    """
    from mcap.writer import CompressionType, Writer

    from stereo_seecolor.extras.streams import ros_messages as ros

    kind = "CompressedImage" if jpeg else "Image"
    with bag.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="benchmark")
        schema = writer.register_schema(
            ros.type_name(kind), "ros2msg", ros.definition(kind).encode()
        )
        sides = {
            side: writer.register_channel(f"/{side}/image_raw", "cdr", schema)
            for side in ("left", "right")
        }
        images = {
            side: [cv2.imread(str(path)) for path in sorted((dive / side).iterdir())]
            for side in sides
        }
        for number in range(pairs):
            stamp_ns = START_NS + round(number * 1e9 / rate_hz)
            for side, channel in sides.items():
                message = _message(ros, stamp_ns, images[side][number % RENDERED], jpeg)
                writer.add_message(channel, stamp_ns, ros.serialize(kind, message), stamp_ns)
        writer.finish()


def _message(ros: Any, stamp_ns: int, image: np.ndarray, jpeg: bool) -> Any:
    if jpeg:
        return ros.compressed_image(
            stamp_ns, bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1]), ".jpg"
        )
    height, width = image.shape[:2]
    return ros.make(
        "Image",
        ros.header(stamp_ns, "camera"),
        height,
        width,
        "bgr8",
        0,
        3 * width,
        image.reshape(-1),
    )


def play(dive: Path, bag: Path, keep: str, budget_ms: float) -> None:
    """One rate, in this process; prints JSON."""
    from stereo_seecolor.compute.process import tune_malloc
    from stereo_seecolor.extras.streams.live.command import LiveInputs, LiveOptions, live

    tune_malloc()  # as the command does
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out" if keep == "files" else None
        record = Path(folder) / "live.mcap" if keep == "mcap" else None
        options = LiveOptions(out, record=record, budget_s=budget_ms / 1000 if budget_ms else None)
        began_s = time.process_time()
        found = live(LiveInputs(bag=bag, calib=dive / "cam.yaml"), options=options)
        seconds = time.process_time() - began_s
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(
        json.dumps(
            {**vars(found), "processor_s": seconds / max(found.done, 1), "peak_mib": peak_mib}
        )
    )


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 1024))
    parser.add_argument("--rates", type=float, nargs="+", default=(4, 5, 15), help="pairs a second")
    parser.add_argument("--pairs", type=int, default=100)
    parser.add_argument("--keep", choices=("files", "mcap", "nothing"), default="files")
    parser.add_argument("--jpeg", action="store_true", help="JPEG in the bag instead of raw pixels")
    parser.add_argument("--budget-ms", type=float, default=0.0)
    parser.add_argument("--dive", type=Path, help="a dive rendered before (left, right, cam.yaml)")
    parser.add_argument("--bag", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.bag:
        play(given.dive, given.bag, given.keep, given.budget_ms)
        return
    with tempfile.TemporaryDirectory() as folder:
        dive = given.dive or rendered(Path(folder) / "dive", given.size)
        for rate_hz in given.rates:
            bag = Path(folder) / "dive.mcap"
            write_bag(dive, bag, given.pairs, rate_hz, given.jpeg)
            words = [
                sys.executable,
                __file__,
                "--bag",
                bag,
                "--dive",
                dive,
                "--keep",
                given.keep,
                "--budget-ms",
                given.budget_ms,
            ]
            printed = subprocess.run(
                [str(word) for word in words], capture_output=True, text=True, check=True
            ).stdout
            show(rate_hz, json.loads(printed.splitlines()[-1]))


def rendered(folder: Path, size: tuple[int, int]) -> Path:
    """Eight pairs and their calibration."""
    from stereo_seecolor.extras.synthetic.dive import synthesize
    from stereo_seecolor.extras.synthetic.survey import SurveySpec

    synthesize(SurveySpec(pairs=RENDERED, lines=1, image_size=tuple(size)), folder)
    return folder


def show(rate_hz: float, found: dict[str, Any]) -> None:
    """One line."""
    image, products = (
        [1000 * (found[f"{kind}_{q}_s"] or 0) for q in ("median", "p95")]
        for kind in ("latency", "products")
    )
    print(
        f"{rate_hz:g} Hz: image {image[0]:.0f} / {image[1]:.0f} ms, products {products[0]:.0f} / "
        f"{products[1]:.0f} ms (median / p95); {found['done']} done, {found['dropped']} passed "
        f"over, {found['failed']} failed; {1000 * found['processor_s']:.0f} ms of processor a "
        f"pair; {found['peak_mib']:.0f} MiB {found['reduced']}",
        flush=True,
    )


if __name__ == "__main__":
    main()
