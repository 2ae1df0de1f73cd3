"""Memory and processor time of the client over all passes of a long dive, with workers that are
simulated in its own process.

Real: two folders of as many files, their pairing, rows, tables, sums of light and water, the list
of records, reports and run.json.
Stand in: images, which are read by nobody; the work of a pair, whose rows and tables are those of
the sample dive, pickled and unpickled as from a worker; and the content of each frame's record,
which workers read. Their time is not counted.
"""

import os
import pickle
import random
import shutil
import tempfile
import time
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from stereo_seecolor.color.photometry.light_of_frames import MEAN, PART, Differences
from stereo_seecolor.color.photometry.observations import Observations
from stereo_seecolor.color.sharing.survey import CountedFrames
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.commands import run as commands
from stereo_seecolor.commands import run_session
from stereo_seecolor.commands.stereo_inputs import Opened, StereoInputs
from stereo_seecolor.compute.interface import Usage
from stereo_seecolor.config import ColorConfig, RunConfig
from stereo_seecolor.dive import light_search
from stereo_seecolor.dive.dive_run import Outcome
from stereo_seecolor.dive.pair_sequences import GROUP
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.inputs.pairing import Pair
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.folder import DiveRecord
from stereo_seecolor.run_folder.manifest import FrameRecord, Manifest

SAMPLE = Path(__file__).resolve().parents[1] / "data_samples" / "reef"
BATCH = 100


class Meter:
    """Says what the client has used since the last line: the most memory, and processor time."""

    def __init__(self) -> None:
        self._used_s = time.process_time()
        # what stands for another process's work, or is needed for the benchmark alone
        self.others_s = 0.0

    @contextmanager
    def aside(self) -> Iterator[None]:
        """What the block takes is none of the client's."""
        begun_s = time.process_time()
        try:
            yield
        finally:
            self.others_s += time.process_time() - begun_s

    def say(self, what: str) -> None:
        status = dict(
            line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines()
        )
        now, most = (int(status[name].split()[0]) / 1024 for name in ("VmRSS", "VmHWM"))
        used_s = time.process_time() - self._used_s - self.others_s
        print(f"{what:24s} {now:5.0f} MiB, at most {most:5.0f}; {used_s:6.1f} s", flush=True)
        Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
        self._used_s, self.others_s = time.process_time(), 0.0

    def after(self, place: Any, name: str) -> AbstractContextManager[Any]:
        """A line after each call of that function."""
        called = getattr(place, name)

        def measured(*arguments: Any, **named: Any) -> Any:
            found = called(*arguments, **named)
            self.say(name)
            return found

        return patch.object(place, name, measured)


class Sampled:
    """What the sample dive's workers sent: a frame's record, tables, and how frames differ."""

    def __init__(self, out: Path) -> None:
        self.windows: list[Observations] = []
        looked = light_search.LightSearch._examined

        def kept(search: Any, numbers: Any, look: Any, parts: int = 1) -> Iterator[Any]:
            for window in looked(search, numbers, look, parts):
                self.windows.append(window)
                yield window

        with (
            patch.object(light_search.LightSearch, "_examined", kept),
            patch.object(light_search, "is_short", lambda _: False),
        ):
            commands.run(SAMPLE / "left", SAMPLE / "right", SAMPLE / "cam.yaml", out)
        self.frame = next(iter(Manifest(out).frames()))
        files = sorted((out / ".state/tables").rglob("*.kept"))
        tables = [MomentTable.unpacked(zlib.decompress(file.read_bytes()[64:])) for file in files]
        self.counted = CountedFrames.of(
            ((str(k), tables[k % len(tables)]) for k in range(GROUP)), ColorConfig()
        )

    def record(self, name: str) -> FrameRecord:
        """As that of a frame of this name."""
        key = f"{hash(name) & (2**64 - 1):064x}"
        stages = {stage: replace(record, key=key) for stage, record in self.frame.stages.items()}
        return replace(
            self.frame,
            name=name,
            stages=stages,
            inputs={s: replace(i, sha256=key) for s, i in self.frame.inputs.items()},
        )


class Workers:
    """Two hundred that answer at once; also the listener, which is told of passes."""

    usage, parts = Usage(200), 200

    def __init__(self, sampled: Sampled, meter: Meter) -> None:
        self._sampled, self._meter, self._random = sampled, meter, random.Random(0)
        self.stage, self.seen, self._number = "", False, 0

    def sharing(self, folder: Path, inputs: Any) -> AbstractContextManager[None]:
        return nullcontext()

    def begin(self, stage: str, total: int) -> None:
        self.stage, self._number = stage, 0
        self._meter.say(f"before {stage}")

    def advance(self, row: FrameRow) -> None:
        pass

    def each(self, work: Any, items: Iterable[Any]) -> Iterator[Any]:
        batch: list[Any] = []
        for item in items:
            batch.append(item)
            if len(batch) * (len(item) if isinstance(item, list) else 1) >= BATCH:
                yield from self._sent(work, batch)
                batch = []
        yield from self._sent(work, batch)
        self.seen = True

    def _sent(self, work: Any, batch: list[Any]) -> Any:
        sent = pickle.dumps(batch)
        with self._meter.aside():
            do = (
                work
                if self.stage == "records"
                else lambda item: self._group(item) if isinstance(item, list) else self._one(item)
            )
            answer = pickle.dumps([do(item) for item in pickle.loads(sent)])
        return pickle.loads(answer)

    def _group(self, pairs: list[Pair]) -> tuple[list[Outcome[bool]], CountedFrames]:
        counted = self._sampled.counted
        frames = [(pair.name, *counted.frames[0][1:]) for pair in pairs]
        outcomes = [self._one(pair) for pair in pairs]
        brief = [
            replace(one, row=replace(one.row, hashes={}, facts={}, left="", right=""))
            for one in outcomes
        ]
        return brief, replace(counted, frames=frames)

    def _one(self, pair: Pair) -> Outcome[bool]:
        key, colors = f"{self._random.getrandbits(256):064x}", self.stage == "colors"
        facts = dict(self._sampled.frame.stages["corrected" if colors else "range"].facts)
        facts |= (
            {}
            if colors
            else {"camera_exposure_s": 0.01 * (1 + self._number % 5), "camera_gain": 100.0}
        )
        self._number += 1
        stages = (
            ("light", "color", "write", "read")
            if colors
            else ("read", "rectify", "match", "color", "write")
        )
        seconds = {stage: self._random.random() for stage in stages}
        files = {"left": str(pair.left), "right": str(pair.right), "timestamp_s": pair.timestamp_s}
        row = FrameRow(
            pair.name,
            **files,
            hashes={} if colors else {"left": key, "right": key},
            seconds=seconds,
            facts=facts,
        )
        return Outcome(row, True, None, ("range",), ())

    def looks(self, number: int) -> Callable[..., Iterator[Any]]:
        """In place of ``LightSearch._examined``: windows of the sample dive, then differences of
        frames with known gains.
        """
        rng = np.random.default_rng(0)
        gains = np.log(1 + np.arange(number) % 5) + 0.02 * rng.standard_normal(number)

        def looked(_: Any, numbers: Any, look: Any, parts: int = 1) -> Iterator[Any]:
            if look.func is light_search.windows_of:
                windows = self._sampled.windows
                for at, frame in enumerate(numbers):
                    window = windows[at % len(windows)]
                    back = window.frames[0] - window.frames
                    if at >= back.max() and frame - numbers[at - back.max()] == back.max():
                        yield replace(window, frames=frame - back)
                return
            for start in range(0, number, 64):
                with self._meter.aside():
                    answer = pickle.dumps(
                        [differing(i) for i in range(start, min(start + 64, number))]
                    )
                yield from pickle.loads(answer)
            self._meter.say("differences")

        def differing(i: int) -> tuple[Any, Any]:
            others = [i - back for back in (1, 2, 4) if i >= back]
            found = []
            for other in others:
                step = np.array([gains[i] - gains[other], 0.01, 0, -0.01])
                for held in (False, True):
                    value = step + 0.01 * rng.standard_normal(4)
                    found.append((i, other, (0, 30), (0, -30), value, 150, held))
            means = np.array([(i, (gains[i], 0.01, 0, -0.01))], MEAN)
            return np.array([i, *others]), Differences(np.array(found, PART), means)

        return looked


def dive_of(folder: Path, number: int) -> StereoInputs:
    """Two folders of so many files, of which the first few are images; both show the same ones."""
    left, image = folder / "left", min((SAMPLE / "left").iterdir())
    left.mkdir(parents=True)
    for k in range(number):
        seconds, quarter = divmod(k, 4)
        os.close(
            os.open(
                left / f"GX_{1_600_000_000 + seconds}_{250_000 * quarter:06d}.png",
                os.O_CREAT | os.O_WRONLY,
            )
        )
    for seconds in range(2):
        shutil.copy(image, left / f"GX_{1_600_000_000 + seconds}_000000.png")
    (folder / "right").symlink_to("left")
    return StereoInputs(left, folder / "right", str(SAMPLE / "cam.yaml"))


def stand_ins(
    sampled: Sampled, workers: Workers, meter: Meter, number: int, recorded: bool
) -> list[AbstractContextManager[Any]]:
    """What reads the images and the records of frames, replaced."""

    def closed(folder: Any, description: Any, *how: Any, close: Any = run_session.close_run) -> Any:
        with meter.aside():
            for name in description.names:
                record = folder.manifest._frame_file(name, "spread")
                record.parent.mkdir(parents=True, exist_ok=True)
                os.close(os.open(record, os.O_CREAT | os.O_WRONLY))
        workers.begin("records", len(description.names))
        return close(folder, description, *how)

    return [
        patch.object(Manifest, "frame", lambda _, name: sampled.record(name)),
        patch.object(DiveRecord, "is_current", lambda _, frame, stage: stage in frame.stages),
        patch.object(light_search.LightSearch, "_examined", workers.looks(number)),
        patch.object(Opened, "for_dive", lambda opened, *_: opened),
        patch.object(light_search, "explain", lambda _: recorded),
        patch.object(run_session, "need_bytes", lambda *_: 1),
        patch.object(run_session, "compile_for", lambda *_: None),
        patch.object(run_session, "close_run", closed),
    ]


MEASURED = (
    *((StereoInputs, "open"), (light_search.LightSearch, "solve")),
    *(
        (commands, name)
        for name in ("measure_ranges", "find_light", "fit_waters", "correct_frames")
    ),
    *((run_session, name) for name in ("close_run", "write_reports", "products")),
)
"""A line is printed after each call of these."""


def client(number: int, recorded: bool) -> None:
    """A line for each part of a run of so many pairs. recorded: whether the exposures that the
    camera recorded are used.
    """
    with tempfile.TemporaryDirectory() as temporary, ExitStack() as stack:
        folder, meter = Path(temporary), Meter()
        sampled = Sampled(folder / "sample")
        workers, inputs = Workers(sampled, meter), dive_of(folder, number)
        meter.say("folders made")
        for stand_in in stand_ins(sampled, workers, meter, number, recorded):
            stack.enter_context(stand_in)
        for place, name in MEASURED:
            stack.enter_context(meter.after(place, name))
        options = RunOptions(listener=workers, cluster=workers, page="none")
        summary = commands.run_inputs(inputs, folder / "out", RunConfig(), options)
        print(summary.count("ok"), *summary.notes, sep="\n")
