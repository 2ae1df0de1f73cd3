"""The current products of a run, found in one pass over the records of its frames: a dive may have
a million, on a shared disk.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np

from stereo_seecolor.compute.interface import Compute
from stereo_seecolor.compute.names import Names, SomeNames
from stereo_seecolor.files.keys import ContentKey
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import PRODUCTS, Stage
from stereo_seecolor.run_folder.manifest import FrameRecord, Manifest, StageRecord

GROUP = 250
"""Records that are read together: a tenth of a second's work."""


@dataclass(frozen=True)
class CurrentFrames:
    """What is current in OUT.

    done: the frames of the run whose last stage is current. digests: stage -> hash of all frames of
    which it is current (``DiveFiles.digest``). made: product -> number of frames that have a
    current one. written: number of those that this run wrote.
    """

    done: SomeNames
    digests: dict[Stage, str]
    made: Counter[str]
    written: Counter[str]

    @classmethod
    def of(
        cls, folder: RunFolder, names: Names, last: Stage, compute: Compute | None
    ) -> "CurrentFrames":
        """Examine the frames of a run with these names. last: its last stage. compute: reads the
        records; None reads them in this process.
        """
        done, made, written = np.zeros(len(names), np.bool_), Counter[str](), Counter[str]()
        keys: dict[Stage, ContentKey] = {"range": ContentKey(), "corrected": ContentKey()}
        for frame in _records(folder.manifest, compute):
            written_now = folder.frames.written.stages(frame.name)
            for stage, record in frame.stages.items():
                if not folder.dive.record.is_current(frame, stage):
                    continue
                made.update(record.outputs.keys())
                if stage in written_now:
                    written.update(record.outputs.keys())
                if stage in keys:
                    keys[stage].add((frame.name, record.key))
                if stage == last and (number := names.number(frame.name)) is not None:
                    done[number] = True
        return cls(
            SomeNames(names, done), {stage: key.value for stage, key in keys.items()}, made, written
        )


def _records(manifest: Manifest, compute: Compute | None) -> Iterable[FrameRecord]:
    """What matters here of all records, by name."""
    names, read = manifest.names(), partial(_read, manifest)
    groups = [names[start : start + GROUP] for start in range(0, len(names), GROUP)]
    return chain.from_iterable(compute.each(read, groups) if compute else map(read, groups))


def _read(manifest: Manifest, names: Sequence[str]) -> list[FrameRecord]:
    """The records of some frames: keys, settings and products of their stages."""
    return [
        FrameRecord(
            frame.name,
            stages={stage: _without_facts(record) for stage, record in frame.stages.items()},
        )
        for frame in map(manifest.frame, names)
        if frame
    ]


def _without_facts(record: StageRecord) -> StageRecord:
    return replace(
        record,
        outputs=dict.fromkeys(record.outputs.keys() & PRODUCTS.keys(), ""),
        facts={},
        warnings=(),
    )
