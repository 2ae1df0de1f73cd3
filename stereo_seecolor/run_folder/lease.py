"""The lock of a run's folder: of the system, and as a lease, a file that every machine sees which
sees OUT: a lock of the system may not reach beyond one machine.

The holder touches the file every few seconds. One that has not been touched for long is stale: its
holder is named, and a person decides; only where the holder was a process of this machine that is
gone, nobody has to. Ages are taken from the file system's own clock, which the machines share.
"""

import contextlib
import errno
import getpass
import json
import os
import platform
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from filelock import FileLock, Timeout

from stereo_seecolor.compute.background import heartbeat
from stereo_seecolor.errors import OutputError
from stereo_seecolor.files.atomic import output_errors
from stereo_seecolor.files.json_records import as_record, load_object
from stereo_seecolor.run_folder.layout import LEASE, LOCK, MANIFEST, state

WITHOUT_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS)
"""What a file system without locks says, as some network file systems: the lease alone guards
OUT there.
"""


@dataclass(frozen=True)
class LeaseTimes:
    """Intervals of the lease, seconds."""

    beat_s: float = 10.0
    """Between two signs of life: six fit into ``stale_s``; NFS shows them 3 to 60 s late."""
    stale_s: float = 120.0
    """Without a sign of life: twice what an NFS client may hide."""


TIMES = LeaseTimes()


@dataclass(frozen=True)
class Holder:
    """The process that holds a lease. token: unique to this lease."""

    user: str
    host: str
    process: int
    token: str

    @classmethod
    def me(cls) -> "Holder":
        """Make the holder of a new lease: this process."""
        try:
            user = getpass.getuser()
        except (OSError, KeyError, ImportError):  # no name for the user's number, as in containers
            user = "somebody"
        return cls(user, platform.node(), os.getpid(), secrets.token_hex(8))

    @classmethod
    def load(cls, root: Path) -> "Holder | None":
        """Read who holds OUT; None for nobody. Raises OSError where it cannot be read now."""
        try:
            return as_record(cls, load_object(state(root, LEASE)))
        except FileNotFoundError:
            return None
        except (ValueError, TypeError):  # being written just now, or damaged
            return cls("somebody", "an unknown machine", 0, "")

    @property
    def here(self) -> bool:
        """Tell whether the process is one of this machine."""
        return self.host == platform.node()

    @property
    def alive(self) -> bool:
        """False for a process of this machine that is gone; True where that cannot be known."""
        if not self.here or os.name == "nt":
            return True
        try:
            os.kill(self.process, 0)
        except ProcessLookupError:
            return False
        except PermissionError:
            pass
        return True

    def __str__(self) -> str:
        return f"{self.user}@{self.host}, process {self.process}"


@contextmanager
def held(root: Path) -> Iterator[Holder]:
    """Hold a run's folder, made where it is missing: no other run, of this machine or another,
    writes into it meanwhile. What was made for it is removed where no manifest was left in it.

    Raises OutputError if it cannot be written, or is held already.
    """
    lock, is_new, made = FileLock(state(root, LOCK), timeout=0), False, list[Path]()
    try:
        is_new = not state(root, LOCK).exists()
        made = [folder for folder in (state(root), root, *root.parents) if not folder.exists()]
        state(root).mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout as error:
        now = None
        with contextlib.suppress(OSError):
            now = Holder.load(root)
        raise OutputError(_in_use(root, now)) from error
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


@contextmanager
def hold_lease(root: Path, locked: bool) -> Iterator[Holder]:
    """Hold OUT for this process. locked: it holds the lock of the system too, so no other process
    of this machine can.

    Raises OutputError where another holds it, or did and was not seen to end.
    """
    path, me = state(root, LEASE), Holder.me()
    with output_errors(path):
        other = Holder.load(root)
        if other and not (other.here and (locked or not other.alive)):
            raise OutputError(_refusal(root, other))
        if other:
            path.unlink(missing_ok=True)
        try:
            with path.open("x") as file:
                json.dump(asdict(me), file)
        except FileExistsError as error:
            raise OutputError(_refusal(root, Holder.load(root) or me)) from error
    try:
        with heartbeat(lambda: _beat(root, me), TIMES.beat_s):
            yield me
    finally:
        with contextlib.suppress(OSError):
            if Holder.load(root) == me:
                path.unlink(missing_ok=True)


def check_lease(root: Path, token: str) -> None:
    """Raise OutputError where OUT is not held under this token any more, as far as can be seen."""
    try:
        holder = Holder.load(root)
    except OSError:
        return
    if holder is None or holder.token != token:
        now = f"{holder} writes into it now" if holder else f"{state(root, LEASE)} was removed"
        raise OutputError(
            f"{root}: is no longer locked by this run: {now}; run the same command again when no "
            "other run uses it"
        )


def writer(root: Path) -> str:
    """Who writes into OUT now, for the user; "" where nobody does, or the lease is stale."""
    try:
        holder = Holder.load(root)
    except OSError:
        return ""
    return str(holder) if holder and holder.alive and _age_s(root) <= TIMES.stale_s else ""


def _beat(root: Path, me: Holder) -> bool:
    with contextlib.suppress(OSError):  # a network that fails for a moment
        if Holder.load(root) != me:
            return False
        os.utime(state(root, LEASE))
    return True


def _in_use(root: Path, other: Holder | None) -> str:
    who = f" ({other})" if other else ""
    return f"{root}: another run writes into it now{who}: wait for it, or choose another --out"


def _refusal(root: Path, other: Holder) -> str:
    age_s = _age_s(root)
    if age_s <= TIMES.stale_s:
        return _in_use(root, other)
    return (
        f"{root}: was locked by {other}, which has shown no activity for {age_s / 60:.0f} min "
        f"and did not end by itself: make sure that it has ended, remove {state(root, LEASE)}, "
        "and run the same command again"
    )


def _age_s(root: Path) -> float:
    """Seconds since the holder's last sign of life, by the clock of the file system."""
    probe = state(root, LEASE).with_name(f"clock-{secrets.token_hex(4)}")
    try:
        probe.touch()
        now_s = probe.stat().st_mtime
        return now_s - state(root, LEASE).stat().st_mtime
    except OSError:
        return 0.0  # gone meanwhile, or not ours to write: nothing is known of its age
    finally:
        with contextlib.suppress(OSError):
            probe.unlink(missing_ok=True)
