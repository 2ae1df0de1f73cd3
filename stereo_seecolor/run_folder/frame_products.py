"""The products of single frames in OUT, every file known to the manifest before it is there."""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

from numpy.typing import NDArray

from stereo_seecolor.compute.names import Names
from stereo_seecolor.compute.threads import Lock
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.atomic import Content, output_errors
from stereo_seecolor.files.contained import find_contained
from stereo_seecolor.files.decode import read_array
from stereo_seecolor.files.whole_files import read_bytes
from stereo_seecolor.run_folder.layout import PAGE, Stage, in_subfolder, subfolder_of, table_file
from stereo_seecolor.run_folder.lease import check_lease
from stereo_seecolor.run_folder.manifest import FrameRecord, InputRecord, Manifest, StageRecord
from stereo_seecolor.run_folder.owned_files import OwnedFiles, is_ours
from stereo_seecolor.run_folder.stamp import DIGEST_BYTES, Stamp

STAGES: tuple[Stage, ...] = get_args(Stage)


class WrittenFrames:
    """Frames by name, with a bit for each stage; frames may be added by many threads."""

    def __init__(self) -> None:
        self._names, self._bits = Names(), bytearray()
        self._lock = Lock()

    def add(self, stage: Stage, name: str) -> None:
        """Note that a frame's stage was written."""
        with self._lock:
            number = self._names.add(name)
            if number == len(self._bits):
                self._bits.append(0)
            self._bits[number] |= 1 << STAGES.index(stage)

    def stages(self, name: str) -> tuple[Stage, ...]:
        """The stages of a frame that were written."""
        with self._lock:
            number = self._names.number(name)
            bits = 0 if number is None else self._bits[number]
        return tuple(stage for bit, stage in enumerate(STAGES) if bits >> bit & 1)


class FrameProducts:
    """The files of frames under ``root``, written by one run at a time, each frame by one process.

    written: the frames that this process wrote. token: of the lease under which it writes.
    """

    def __init__(self, root: Path, owned: OwnedFiles, manifest: Manifest) -> None:
        self.root = root
        self.written, self.token = WrittenFrames(), ""
        self._owned, self._manifest = owned, manifest

    def finished(self, stage: Stage, name: str, key: str) -> StageRecord | None:
        """What an earlier run finished of this frame's stage with the same key; None if changed."""
        frame = self._manifest.frame(name)
        record = frame.stages.get(stage) if frame else None
        if frame is None or record is None or record.key != key:
            return None
        known = all(is_ours(self.root, path, frame.files) for path in record.outputs.values())
        return record if known else None

    def inputs(self, name: str, paths: Mapping[str, Path], verify: bool) -> dict[str, InputRecord]:
        """Record a frame's input files by side, with their hashes: an earlier run's where size and
        time are the same, unless ``verify``.

        Raises InputError if one cannot be read.
        """
        frame = self._manifest.frame(name)
        known = frame.inputs if frame and not verify else {}
        return {side: input_record(path, known.get(side)) for side, path in paths.items()}

    def record(
        self,
        name: str,
        timestamp_s: float | None,
        inputs: dict[str, InputRecord],
        place: tuple[int, int],
    ) -> FrameRecord:
        """Make the record of a frame with its present inputs. place: a new frame's number in the
        dive, and the number of frames.
        """
        known = self._manifest.frame(name) or FrameRecord(name, subfolder=subfolder_of(place))
        return replace(known, timestamp_s=timestamp_s, inputs=inputs)

    def read(self, frame: FrameRecord, product: str) -> NDArray[Any]:
        """Read a product's pixels of a frame. Raises InputError if it is gone or damaged."""
        paths = {
            name: path for stage in frame.stages.values() for name, path in stage.outputs.items()
        }
        return read_array(self.root / paths[product])

    def save(
        self, frame: FrameRecord, stage: Stage, contents: Mapping[str, tuple[str, Content]]
    ) -> FrameRecord:
        """Write all files of a frame's finished stage: product -> path relative to OUT, content.

        frame: its record with the stage in it. What the stage, or one that depends on it, wrote
        before and does no longer, is deleted. Returns the frame's record as it is then. Raises
        OutputError.
        """
        old = self._manifest.frame(frame.name)
        contents = {
            product: (in_subfolder(path, frame.subfolder), content)
            for product, (path, content) in contents.items()
        }
        record = replace(
            frame.stages[stage], outputs={product: path for product, (path, _) in contents.items()}
        )
        frame = frame.with_stage(stage, record)
        live = {path for item in frame.stages.values() for path in item.outputs.values()}
        before = dict(old.files) if old else {}
        self._owned.delete(before.keys() - live, before)
        temporaries = self._owned.write_temporaries(contents.values())
        with output_errors(self.root):
            stamps = {path: (Stamp.of(temporary),) for path, temporary in temporaries.items()}
        files = {
            path: stamps.get(path, ()) + before.get(path, ())[:2]
            for path in live
            if path in stamps or path in before
        }
        frame = replace(frame, files=files)
        check_lease(self.root, self.token)
        self._manifest.save_frame(frame)
        self._owned.move_into_place(temporaries, files)
        self.written.add(stage, frame.name)
        return frame

    def note(self, name: str, written: Iterable[Stage], aside: Iterable[Path]) -> None:
        """Note what a worker did for a frame: stages that it wrote, files that it moved aside."""
        for stage in written:
            self.written.add(stage, name)
        self._owned.set_aside += [path for path in aside if path not in self._owned.set_aside]

    def rewrite(self, frame: FrameRecord, contents: Mapping[str, bytes]) -> None:
        """Replace files that a frame has by others (path relative to OUT -> content); its stages
        stay. Raises OutputError.
        """
        if not contents:
            return
        temporaries = self._owned.write_temporaries(contents.items())
        with output_errors(self.root):
            files = {
                path: (Stamp.of(temporary), *frame.files.get(path, ())[:2])
                for path, temporary in temporaries.items()
            }
        self._manifest.save_frame(replace(frame, files={**frame.files, **files}))
        self._owned.move_into_place(temporaries, files)

    def remove_stale(self, name: str) -> bool:
        """Remove a frame that fails now, or is no longer in the dive. Raises OutputError.

        What an earlier run made of it is moved aside, since it cannot be made again without its
        images; True if there was any.
        """
        frame = self._manifest.frame(name)
        earlier = frame is not None and not self.written.stages(name)
        files = frame.files if frame and earlier else ()
        kept = self._owned.remove_stale(path for path in files if not path.startswith(f"{PAGE}/"))
        self.discard(name)
        return kept

    def discard(self, name: str) -> None:
        """Delete all that the program wrote of a frame."""
        frame = self._manifest.frame(name)
        if frame is not None:
            self._owned.delete(frame.files, frame.files)
        self._manifest.remove_frame(name)
        (self.root / table_file(name, frame.subfolder if frame else "")).unlink(missing_ok=True)


def input_record(path: Path, known: InputRecord | None) -> InputRecord:
    """Record a file with its hash; that of ``known`` is taken where size and time are the same.
    Raises InputError if it cannot be read.
    """
    try:
        inner = find_contained(path)
        status = (inner.outer if inner else path).stat()
        same_name = inner is None or (known is not None and known.path.endswith(inner.name))
        if (
            known
            and same_name
            and (status.st_size, status.st_mtime_ns) == (known.stamp.size, known.stamp.mtime_ns)
        ):
            return replace(known, path=str(path))
        sha256 = hashlib.sha256(read_bytes(path)).hexdigest()
        return InputRecord(
            str(path), Stamp(status.st_size, status.st_mtime_ns, sha256[: 2 * DIGEST_BYTES]), sha256
        )
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
