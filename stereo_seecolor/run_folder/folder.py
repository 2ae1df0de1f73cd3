"""OUT while a run writes into it: locked, every file known to the manifest before it is there."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Self

from stereo_seecolor.run_folder.dive_files import DiveFiles
from stereo_seecolor.run_folder.frame_products import FrameProducts
from stereo_seecolor.run_folder.layout import MAP, ORIGINAL, PAGE, PRODUCTS, cache_file
from stereo_seecolor.run_folder.lease import held
from stereo_seecolor.run_folder.manifest import DiveRecord, Manifest
from stereo_seecolor.run_folder.own_paths import refuse_links
from stereo_seecolor.run_folder.owned_files import OwnedFiles, remove_empty_folders
from stereo_seecolor.run_folder.ownership import (
    FolderRequest,
    Owner,
    check_ownership,
    is_unused,
    refuse_files_of_others,
    refuse_used,
)
from stereo_seecolor.run_folder.replaced_results import refuse_inputs


class RunFolder:
    """The output folder OUT of one run; a context manager that locks it.

    Entering takes the lock, refuses a folder that is not this dive's, and deletes what a killed run
    left half written. frames: the products of single frames. dive: files of the whole dive. owned:
    the files that the program wrote.

    A run that ends by an error before it wrote anything into a new folder leaves nothing there.
    Raises OutputError if the folder cannot be written, is locked by another run, or holds something
    else.
    """

    def __init__(self, root: Path, request: FolderRequest) -> None:
        self.root = root
        self.manifest, self.owned = Manifest(root), OwnedFiles(root)
        self.frames = FrameProducts(root, self.owned, self.manifest)
        self.dive = DiveFiles(root, self.owned, self.manifest)
        self._request, self._hold, self._is_new = request, ExitStack(), False

    def __reduce__(self) -> "tuple[Callable[[Path, str], RunFolder], tuple[Path, str]]":
        return RunFolder.on_worker, (self.root, self.frames.token)

    @classmethod
    def on_worker(cls, root: Path, token: str) -> Self:
        """Open the folder in another process while the process with this lease's token locks it."""
        folder = cls(root, FolderRequest(Owner("worker", {})))
        folder.frames.token = token
        return folder

    def reads(self, name: str) -> bool:
        """Tell whether a file of OUT is an input of this run."""
        return (self.root / name).resolve() in {path.resolve() for path in self._request.inputs}

    def __enter__(self) -> Self:
        refuse_links(self.root)
        self._is_new = not self.manifest.exists()
        if self._is_new:
            refuse_used(self.root)
        with ExitStack() as hold:
            self.frames.token = hold.enter_context(held(self.root)).token
            check_ownership(self.manifest, self._request)
            self._begin()
            self._hold = hold.pop_all()
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        self.owned.flush()
        if error and self._is_new and not self.dive.record.files and is_unused(self.root):
            with suppress(OSError):
                self.manifest.forget_dive()
        self._hold.close()

    @classmethod
    @contextmanager
    def existing(cls, root: Path, command: str, inputs: Sequence[Path] = ()) -> Iterator[Self]:
        """Lock a finished run's folder for a command that adds a file of the whole dive.

        inputs: files that the command reads, which are not to be replaced. Raises OutputError.
        """
        refuse_inputs(command, root, inputs)
        refuse_links(root)
        with held(root) as holder:
            folder = cls.on_worker(root, holder.token)
            folder.dive.record = folder.manifest.dive()
            refuse_files_of_others(folder.manifest)
            yield folder

    def _begin(self) -> None:
        if self._request.overwrite and self.manifest.exists():
            self._delete_everything()
        earlier = self.manifest.dive() if self.manifest.exists() else DiveRecord()
        self.owned.remove_leftovers()
        self.dive.record = replace(earlier, identity=self._request.owner.identity())
        self.manifest.save_dive(self.dive.record)

    def _delete_everything(self) -> None:
        """Delete all that the manifest names, and folders that are empty then."""
        for frame in self.manifest.frames():
            self.frames.discard(frame.name)
        dive = self.manifest.dive()
        self.owned.delete(dive.files, dive.files)
        cache_file(self.root, "refined_rig").unlink(missing_ok=True)
        self.manifest.save_dive(DiveRecord(identity=dive.identity))
        for folder in (MAP, PAGE, *PRODUCTS, ORIGINAL):
            remove_empty_folders(self.root / folder)
