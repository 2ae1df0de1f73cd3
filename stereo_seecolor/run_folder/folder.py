"""OUT while a run writes into it: held by one run at a time, every file known to the manifest before it is there."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

from numpy.typing import NDArray

from stereo_seecolor.files.atomic import Content, holds, link_temporary, output_errors
from stereo_seecolor.files.decode import read_array
from stereo_seecolor.files.keys import content_key_of
from stereo_seecolor.run_folder.claim import Claim, Owner, check_claim, refuse_foreign, refuse_inputs, refuse_links, refuse_used
from stereo_seecolor.run_folder.input_files import input_record
from stereo_seecolor.run_folder.kept_refinement import forget_refinement
from stereo_seecolor.run_folder.layout import (
    FIRST_LOOK,
    INDEX,
    MAP,
    ORIGINAL,
    PAGE,
    PRODUCTS,
    Stage,
    on_shelf,
    shelf_of,
    table_file,
)
from stereo_seecolor.run_folder.lease import check_lease
from stereo_seecolor.run_folder.lock import held
from stereo_seecolor.run_folder.manifest import DiveRecord, FrameRecord, InputRecord, Manifest, StageRecord
from stereo_seecolor.run_folder.owned_files import OwnedFiles, is_ours, remove_empty_folders
from stereo_seecolor.run_folder.stamp import Stamp
from stereo_seecolor.run_folder.written_frames import WrittenFrames


class RunFolder:
    """OUT/, held by one run at a time, as a context manager.

    Entering takes the lock, refuses what must not be touched, and clears what a killed run left half written.
    Raises OutputError if the folder cannot be written, is held by another run, or holds something else.
    """

    def __init__(self, root: Path, claim: Claim) -> None:
        self.root = root
        self.manifest = Manifest(root)
        self._files = OwnedFiles(root)
        self.removed: list[str] = []
        self.written = WrittenFrames()
        self.files_written: set[str] = set()
        self._claim, self._dive = claim, DiveRecord()
        self._hold, self._token = ExitStack(), ""

    def __reduce__(self) -> "tuple[Callable[[Path, str], RunFolder], tuple[Path, str]]":
        return RunFolder.on_worker, (self.root, self._token)

    @classmethod
    def on_worker(cls, root: Path, token: str) -> Self:
        """The folder for work on single frames in another process, while the process of that lease's token holds it."""
        folder = cls(root, Claim(Owner("worker", {})))
        folder._token = token
        return folder

    def __enter__(self) -> Self:
        refuse_links(self.root)
        if not self.manifest.exists():
            refuse_used(self.root)
        with ExitStack() as hold:
            self._token = hold.enter_context(held(self.root)).token
            check_claim(self.manifest, self._claim.owner, self._claim.overwrite, self._claim.inputs)
            self._begin()
            self._hold = hold.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._files.flush()
        self._hold.close()

    @classmethod
    @contextmanager
    def existing(cls, root: Path, inputs: Sequence[Path] = ()) -> Iterator[Self]:
        """Hold a finished run's folder to add a map or another file of the whole dive; ``inputs`` are not to be replaced by it.

        Raises OutputError.
        """
        refuse_links(root)
        with held(root) as holder:
            folder = cls.on_worker(root, holder.token)
            folder._dive = folder.manifest.dive()
            refuse_foreign(folder.manifest)
            refuse_inputs(root, (root / path for path in folder.dive.files), inputs)
            yield folder

    def digest(self, stage: Stage) -> str:
        """A hash of all frames whose stage is current, to tell whether what is made from them is up to date."""
        return content_key_of((f.name, f.stages[stage].key) for f in self.manifest.frames() if self.dive.is_current(f, stage))

    def _begin(self) -> None:
        if self._claim.overwrite and self.manifest.exists():
            self._delete_everything()
        earlier = self.manifest.dive() if self.manifest.exists() else DiveRecord()
        self._dive = replace(earlier, identity=self._claim.owner.identity())
        self.remove_leftovers()
        self.manifest.save_dive(self._dive)

    def remove_leftovers(self) -> None:
        """Delete what killed processes left half written, while none writes."""
        self._files.remove_leftovers()

    def finished(self, stage: Stage, name: str, key: str) -> StageRecord | None:
        """What an earlier run finished of this frame's stage with the same key; None if a file of it is gone or changed."""
        frame = self.manifest.frame(name)
        record = frame.stages.get(stage) if frame else None
        if frame is None or record is None or record.key != key:
            return None
        return record if all(is_ours(self.root, path, frame.files) for path in record.outputs.values()) else None

    def inputs(self, name: str, paths: Mapping[str, Path], verify: bool) -> dict[str, InputRecord]:
        """A frame's input files by side, with their hashes: an earlier run's where size and time are the same, unless ``verify``.

        Raises InputError if one cannot be read.
        """
        frame = self.manifest.frame(name)
        known = frame.inputs if frame and not verify else {}
        return {side: input_record(path, known.get(side)) for side, path in paths.items()}

    def begin(self, settings: dict[Stage, str]) -> None:
        """A run begins: what was made with these settings (stage -> hash) is current from now on. Raises OutputError."""
        kept = self._dive.waters if settings.get("corrected") == self._dive.settings.get("corrected") else {}
        self.update(replace(self._dive, state="running", settings=settings, waters=kept))

    def set_waters(self, keys: Mapping[str, str]) -> None:
        """Each frame's water by name ("*": of all), as its hash; others' corrections are no longer current. Raises OutputError."""
        self.update(replace(self._dive, waters=dict(keys)))

    def frame(self, name: str, timestamp_s: float | None, inputs: dict[str, InputRecord], place: tuple[int, int]) -> FrameRecord:
        """The record of a frame with the inputs as they are now. place: a new one's number in the dive, of so many."""
        known = self.manifest.frame(name) or FrameRecord(name, shelf=shelf_of(place))
        return replace(known, timestamp_s=timestamp_s, inputs=inputs)

    def read(self, frame: FrameRecord, product: str) -> NDArray[Any]:
        """The pixels of a product of a frame. Raises InputError if the file is gone or damaged."""
        paths = {name: path for stage in frame.stages.values() for name, path in stage.outputs.items()}
        return read_array(self.root / paths[product])

    def save(self, frame: FrameRecord, stage: Stage, contents: Mapping[str, tuple[str, Content]]) -> FrameRecord:
        """Write all files of a frame's finished stage: product -> path relative to OUT, content.

        frame: its record with the stage in it. What the stage, or one that depends on it, wrote before and does no longer, is
        deleted. Returns the frame's record as it is then. Raises OutputError.
        """
        old = self.manifest.frame(frame.name)
        if stage != "page":  # the page asks for its pictures by name, and by default shows few frames
            contents = {product: (on_shelf(path, frame.shelf), content) for product, (path, content) in contents.items()}
        record = replace(frame.stages[stage], outputs={product: path for product, (path, _) in contents.items()})
        frame = frame.with_stage(stage, record)
        live = {path for item in frame.stages.values() for path in item.outputs.values()}
        before = dict(old.files) if old else {}
        self._files.delete(before.keys() - live, before)
        temporaries = self._files.write_temporaries(contents.values())
        with output_errors(self.root):
            stamps = {path: (Stamp.of(temporary),) for path, temporary in temporaries.items()}
        files = {path: stamps.get(path, ()) + before.get(path, ())[:2] for path in live if path in stamps or path in before}
        frame = replace(frame, files=files)
        check_lease(self.root, self._token)
        self.manifest.save_frame(frame)
        self._files.move_into_place(temporaries, files)
        self.written.add(stage, frame.name)
        return frame

    def adopt(self, other: Path, frame: FrameRecord) -> None:
        """Take a frame of another run's folder as one of this, its table included; its files get a second name, or are copied.

        What this folder holds of the frame already is kept if it is the same or more. Raises OutputError.
        """
        known = self.manifest.frame(frame.name)
        if known and all(self.finished(stage, frame.name, record.key) for stage, record in frame.stages.items()):
            return
        self.discard(frame.name)
        table = table_file(frame.name, frame.shelf)
        paths = [path for path in (*frame.files, table) if (other / path).is_file()]
        temporaries: dict[str, Path] = {}
        for path in paths:
            with output_errors(self.root / path):
                temporaries[path] = link_temporary(other / path, self.root / path)
        self.manifest.save_frame(frame)
        self._files.move_into_place(temporaries, {**frame.files, table: (Stamp.of(other / table),) if table in temporaries else ()})

    def note(self, name: str, written: Iterable[Stage], aside: Iterable[Path]) -> None:
        """What a worker did for a frame: the stages that it wrote, and files that it moved aside."""
        for stage in written:
            self.written.add(stage, name)
        self._files.set_aside += [path for path in aside if path not in self.set_aside]

    def rewrite(self, frame: FrameRecord, contents: Mapping[str, bytes]) -> None:
        """Replace files that a frame has by others (path relative to OUT -> content); its stages stay. Raises OutputError."""
        if not contents:
            return
        temporaries = self._files.write_temporaries(contents.items())
        with output_errors(self.root):
            files = {path: (Stamp.of(temporary), *frame.files.get(path, ())[:2]) for path, temporary in temporaries.items()}
        self.manifest.save_frame(replace(frame, files={**frame.files, **files}))
        self._files.move_into_place(temporaries, files)

    def retire(self, name: str) -> bool:
        """Take a frame out that fails now, or is no longer in the dive. Raises OutputError.

        What an earlier run made of it is moved aside, since it cannot be made again without its images; True if there was any.
        """
        frame = self.manifest.frame(name)
        earlier = frame is not None and not self.written.stages(name)
        products = [path for path in frame.files if not path.startswith(f"{PAGE}/")] if frame and earlier else []
        kept = self._files.retire(products)
        self.discard(name)
        return kept

    def discard(self, name: str) -> None:
        """Delete all that the program wrote of a frame."""
        frame = self.manifest.frame(name)
        if frame is not None:
            self._files.delete(frame.files, frame.files)
        self.manifest.remove_frame(name)
        (self.root / table_file(name, frame.shelf if frame else "")).unlink(missing_ok=True)

    def write(self, name: str, content: Content, made_from: str = "") -> None:
        """Write a file of the whole dive, such as run.json. Raises OutputError.

        made_from: hash of the frames that it was made from.
        """
        self.write_files({name: content}, {name: made_from} if made_from else {})

    def write_files(self, contents: Mapping[str, Content], made_from: Mapping[str, str]) -> None:
        """Write several such files; the manifest is written once. made_from: as above, by name. Raises OutputError."""
        new = {name: content for name, content in contents.items() if isinstance(content, Iterator) or not self._has(name, content)}
        if new:
            self._put(self._files.write_temporaries(new.items()), made_from)
            self.files_written.update(new)

    def write_all(self, name: str, contents: Iterable[tuple[str, bytes]], made_from: str) -> None:
        """The same of all files of a folder of OUT: path in it, content. made_from: hash of what they were made from."""
        temporaries: dict[str, Path] = {}
        for path, content in contents:
            temporaries |= self._files.write_temporaries([(f"{name}/{path}", content)])
        self._put(temporaries, {name: made_from})

    def _put(self, temporaries: Mapping[str, Path], made_from: Mapping[str, str]) -> None:
        """Put written files into their places, once the manifest knows them."""
        files = {path: (Stamp.of(temporary), *self._dive.files.get(path, ())[:2]) for path, temporary in temporaries.items()}
        self.update(replace(self._dive, files=self._dive.files | files, made_from={**self._dive.made_from, **made_from}))
        self._files.move_into_place(temporaries, files)

    def _has(self, name: str, content: Content) -> bool:
        return is_ours(self.root, name, self._dive.files) and holds(self.root / name, content)

    def remove(self, *names: str) -> None:
        """Delete files of the whole dive, or all files of a folder such as map, that the program wrote."""
        folders = tuple(f"{name}/" for name in names)
        gone = [path for path in self._dive.files if path in names or path.startswith(folders)]
        again = (INDEX, FIRST_LOOK)  # these are written again
        lost = [name for name in names if name not in again and not name.startswith(f"{PAGE}/")]
        self.removed += [f"{self.root / name}: was made from other frames or settings, and was removed" for name in lost]
        self._files.delete(gone, self._dive.files)
        files = {path: stamps for path, stamps in self._dive.files.items() if path not in gone}
        made_from = {name: made for name, made in self._dive.made_from.items() if name not in names}
        self.update(replace(self._dive, files=files, made_from=made_from))
        for name in names:
            remove_empty_folders(self.root / name)

    def keep_aside(self, place: Path, path: str) -> None:
        """Move a file that is not the program's to where nothing overwrites it: from ``place``, called ``path`` in OUT."""
        self._files.keep_aside(place, path)

    @property
    def set_aside(self) -> list[Path]:
        """Files that were moved aside, where they are now."""
        return self._files.set_aside

    @property
    def dive(self) -> DiveRecord:
        """The record of the dive as it is now."""
        return self._dive

    def update(self, record: DiveRecord) -> None:
        """Change the record of the dive, after what was written before is durable. Raises OutputError."""
        self._files.flush()
        self._dive = record
        self.manifest.save_dive(record)

    def _delete_everything(self) -> None:
        """Delete all that the manifest names, and folders that are empty then."""
        for frame in self.manifest.frames():
            self.discard(frame.name)
        dive = self.manifest.dive()
        self._files.delete(dive.files, dive.files)
        forget_refinement(self.root)
        self.manifest.save_dive(DiveRecord(identity=dive.identity))
        for folder in (MAP, PAGE, *PRODUCTS, ORIGINAL):
            remove_empty_folders(self.root / folder)
