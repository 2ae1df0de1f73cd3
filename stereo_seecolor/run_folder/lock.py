"""The lock of a run's folder: of the system, and as a lease where other machines see the folder."""

import contextlib
import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from stereo_seecolor.errors import OutputError
from stereo_seecolor.run_folder.layout import LOCK, MANIFEST, state
from stereo_seecolor.run_folder.lease import Holder, hold_lease

WITHOUT_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)
"""What a file system without locks says, as some network file systems: the lease alone guards
OUT there.
"""


@contextmanager
def held(root: Path) -> Iterator[Holder]:
    """Hold a run's folder, made where it is missing: no other run, of this machine or another,
    writes into it meanwhile. What was made for it is removed where no manifest was left in it.

    Raises OutputError if it cannot be written, or is held already.
    """
    lock = FileLock(state(root, LOCK), timeout=0)
    try:
        is_new = not state(root, LOCK).exists()
        made = [folder for folder in (state(root), root, *root.parents) if not folder.exists()]
        state(root).mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout as error:
        now = None
        with contextlib.suppress(OSError):
            now = Holder.load(root)
        who = f" ({now})" if now else ""
        raise OutputError(
            f"{root}: another run writes into it now{who}: wait for it, or choose another --out"
        ) from error
    except OSError as error:
        if error.errno not in WITHOUT_LOCKS:
            raise OutputError(
                f"{root}: cannot be written: {error.strerror or error}: choose another --out"
            ) from error
    try:
        with hold_lease(root, lock.is_locked) as holder:
            yield holder
    finally:
        unused = is_new and not state(root, MANIFEST).exists()
        if unused:
            with contextlib.suppress(OSError):  # while it is held: nobody else has taken the file
                state(root, LOCK).unlink()
        lock.release()
        if unused:
            for folder in made:
                with contextlib.suppress(OSError):  # somebody put a file there
                    folder.rmdir()
