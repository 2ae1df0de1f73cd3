"""The files in OUT that the program wrote; a user's are moved aside, never overwritten."""

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path

from calibration.files import flush_folder
from stereo_seecolor.compute.background import Alongside
from stereo_seecolor.errors import OutputError
from stereo_seecolor.files import atomic
from stereo_seecolor.files.atomic import Content, output_errors
from stereo_seecolor.run_folder.layout import MAP, PAGE, PRODUCTS, SET_ASIDE, state
from stereo_seecolor.run_folder.replaced_results import ALL_RESULTS
from stereo_seecolor.run_folder.stamp import Stamp


class OwnedFiles:
    """The files under ``root``. One is the program's if the manifest holds its stamp.

    set_aside: files that are not, or no longer, and that were moved aside instead of overwritten.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.set_aside: list[Path] = []
        self._unflushed: set[Path] = set()

    def write_temporaries(self, contents: Iterable[tuple[str, Content]]) -> dict[str, Path]:
        """Write files beside where they belong: path in OUT, content -> temporary. Raises
        OutputError, and then none is left.

        All are flushed to disk, each while the next are encoded.
        """
        written: dict[str, Path] = {}
        flushed = Alongside()
        try:
            for path, content in contents:
                with output_errors(self.root / path):
                    written[path] = atomic.write_temporary(self.root / path, content)
                flushed.put(partial(_flush, self.root / path, written[path]))
            flushed.finish()
        except BaseException:
            with contextlib.suppress(OutputError):
                flushed.finish()  # no system deletes what is open
            for temporary in written.values():
                atomic.remove(temporary)
            raise
        return written

    def remove_leftovers(self) -> None:
        """Delete temporary files that killed processes left; call it while no process writes."""
        for name in (MAP, "."):
            atomic.remove_leftovers(self.root / name)
        for folder in (*(self.root / name for name in (*PRODUCTS, PAGE)), state(self.root)):
            atomic.remove_leftovers_below(folder)

    def move_into_place(
        self, temporaries: Mapping[str, Path], files: Mapping[str, Sequence[Stamp]]
    ) -> None:
        """Rename written files to their final names; a file that is there and not of ``files`` is
        moved aside.

        ``flush`` makes the names durable. After a loss of power a name may be missing; then the
        manifest has a file too many, which is made again: no pair waits for its names to be
        flushed.
        """
        for path, temporary in temporaries.items():
            place = self.root / path
            with output_errors(place):
                if (place.exists() or place.is_symlink()) and not is_as_written(
                    self.root, path, files
                ):
                    self.quarantine(place, path)
                atomic.move_into_place(temporary, place)
        self._unflushed.update((self.root / path).parent for path in temporaries)

    def flush(self) -> None:
        """Flush the folders of all files that were moved into place."""
        while self._unflushed:
            flush_folder(self._unflushed.pop())

    def delete(self, paths: Iterable[str], files: Mapping[str, Sequence[Stamp]]) -> None:
        """Delete files of the program; changed ones are moved aside instead. Raises OutputError."""
        for path in paths:
            place = self.root / path
            if is_as_written(self.root, path, files):
                with output_errors(place):
                    place.unlink()
            elif place.exists() or place.is_symlink():
                self.quarantine(place, path)

    def quarantine(self, place: Path, path: str) -> None:
        """Move a file that is not, or no longer, the program's to where nothing overwrites it.
        Raises OutputError.

        place: where it is now. path: what it is called in OUT.
        """
        self.set_aside.append(self._aside(place, path))

    def remove_stale(self, paths: Iterable[str]) -> bool:
        """Move those of the program's files that exist aside, where nothing overwrites them; True
        if there was one. Raises OutputError.
        """
        there = [path for path in paths if (self.root / path).exists()]
        for path in there:
            self._aside(self.root / path, path)
        return bool(there)

    def _aside(self, place: Path, path: str) -> Path:
        """Where the file is then."""
        target = self.root / SET_ASIDE / path
        number = 1
        while target.exists() or target.is_symlink():
            target = (self.root / SET_ASIDE / path).with_name(
                f"{Path(path).stem}-{number}{Path(path).suffix}"
            )
            number += 1
        with output_errors(target):
            target.parent.mkdir(parents=True, exist_ok=True)
            place.rename(target)
        return target


def _flush(path: Path, temporary: Path) -> None:
    with output_errors(path):
        atomic.flush_file(temporary)


def remove_empty_folders(folder: Path) -> None:
    """Remove a folder and those in it as far as they are empty."""
    if not folder.is_dir() or folder.is_symlink():
        return
    for inner in folder.iterdir():
        if inner.is_dir() and not inner.is_symlink():
            remove_empty_folders(inner)
    with contextlib.suppress(OSError):
        folder.rmdir()


def is_ours(root: Path, path: str, files: Mapping[str, Sequence[Stamp]]) -> bool:
    """Whether a file of OUT seems to be as the program wrote it. files: path -> possible stamps."""
    return any(stamp.matches(root / path) for stamp in files.get(path, ()))


def is_as_written(root: Path, path: str, files: Mapping[str, Sequence[Stamp]]) -> bool:
    """Tell whether the file at a path of OUT is as the program wrote it, to the byte: it may be
    deleted then. A path where the program writes nothing is never ours, whatever records say.
    """
    return ALL_RESULTS.includes(path) and any(
        stamp.is_of(root / path) for stamp in files.get(path, ())
    )
