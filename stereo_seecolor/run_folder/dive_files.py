"""The files of the whole dive in OUT, as run.json and the map, and the manifest's record."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from stereo_seecolor.files.atomic import Content, holds, remove
from stereo_seecolor.files.keys import content_key_of
from stereo_seecolor.run_folder.layout import INDEX, PAGE, Stage
from stereo_seecolor.run_folder.manifest import DiveRecord, Manifest
from stereo_seecolor.run_folder.owned_files import OwnedFiles, is_ours, remove_empty_folders
from stereo_seecolor.run_folder.stamp import Stamp


class DiveFiles:
    """The files of the whole dive under ``root``.

    record: what the manifest says of the dive now. written: names of files that this process wrote.
    removed: a line for each that was made from other frames or settings.
    """

    def __init__(self, root: Path, owned: OwnedFiles, manifest: Manifest) -> None:
        self.root = root
        self.record = DiveRecord()
        self.written: set[str] = set()
        self.removed: list[str] = []
        self._owned, self._manifest = owned, manifest

    def digest(self, stage: Stage) -> str:
        """Hash all frames whose stage is current, to tell if what they give is up to date."""
        current = (
            frame for frame in self._manifest.frames() if self.record.is_current(frame, stage)
        )
        return content_key_of((frame.name, frame.stages[stage].key) for frame in current)

    def begin(self, settings: dict[Stage, str]) -> None:
        """Begin a run: results made with these settings (stage -> hash) are current from now on.
        Raises OutputError.
        """
        same = settings.get("corrected") == self.record.settings.get("corrected")
        waters = self.record.waters if same else {}
        self.update(replace(self.record, state="running", settings=settings, waters=waters))

    def set_waters(self, keys: Mapping[str, str]) -> None:
        """Set each frame's water by name ("*": of all), as its hash; corrections with another water
        are no longer current. Raises OutputError.
        """
        self.update(replace(self.record, waters=dict(keys)))

    def update(self, record: DiveRecord) -> None:
        """Replace the dive's record, once all earlier files are durable. Raises OutputError."""
        self._owned.flush()
        self.record = record
        self._manifest.save_dive(record)

    def write(self, name: str, content: Content, made_from: str = "") -> None:
        """Write a file of the whole dive, such as run.json. Raises OutputError.

        made_from: hash of the frames that it was made from.
        """
        self.write_files({name: content}, {name: made_from} if made_from else {})

    def write_files(self, contents: Mapping[str, Content], made_from: Mapping[str, str]) -> None:
        """Write several files of the whole dive; the manifest is written once. made_from: as in
        ``write``, by name. Raises OutputError.
        """
        new = {
            name: content
            for name, content in contents.items()
            if isinstance(content, Iterator)
            or not is_ours(self.root, name, self.record.files)
            or not holds(self.root / name, content)
        }
        if new:
            self._put(self._owned.write_temporaries(new.items()), made_from)
            self.written.update(new)

    def write_folder(
        self, name: str, contents: Iterable[tuple[str, bytes]], made_from: str
    ) -> None:
        """Write all files of a folder of OUT: path in it, content. made_from: hash of what they
        were made from. Raises OutputError.
        """
        temporaries: dict[str, Path] = {}
        try:
            for path, content in contents:
                temporaries |= self._owned.write_temporaries([(f"{name}/{path}", content)])
        except BaseException:
            for temporary in temporaries.values():
                remove(temporary)
            raise
        self._put(temporaries, {name: made_from})

    def _put(self, temporaries: Mapping[str, Path], made_from: Mapping[str, str]) -> None:
        """Put written files into their places, once the manifest knows them."""
        files = {
            path: (Stamp.of(temporary), *self.record.files.get(path, ())[:2])
            for path, temporary in temporaries.items()
        }
        self.update(
            replace(
                self.record,
                files=self.record.files | files,
                made_from={**self.record.made_from, **made_from},
            )
        )
        self._owned.move_into_place(temporaries, files)

    def remove(self, *names: str) -> None:
        """Delete files of the whole dive, or all of a folder, that the program wrote."""
        folders = tuple(f"{name}/" for name in names)
        gone = [path for path in self.record.files if path in names or path.startswith(folders)]
        lost = [name for name in names if name != INDEX and not name.startswith(f"{PAGE}/")]
        self.removed += [
            f"{self.root / name}: was made from other frames or settings, and was removed"
            for name in lost
        ]
        self._owned.delete(gone, self.record.files)
        files = {path: stamps for path, stamps in self.record.files.items() if path not in gone}
        made_from = {
            name: made for name, made in self.record.made_from.items() if name not in names
        }
        self.update(replace(self.record, files=files, made_from=made_from))
        for name in names:
            remove_empty_folders(self.root / name)
