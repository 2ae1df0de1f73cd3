"""The cache of machine code between runs: numba's own, with another place and other checks.

numba's cache depends on the file that holds a function. But constants and callees in other files
are compiled in, too. So here a function's code is current as long as no source file has changed
that its module imports, directly or through others. numba adds the processor and the argument
types. Stale entries are overwritten. Loading an entry runs what it holds, and one wrong byte of
machine code ends the process: only a folder that nobody else can write into is used, and each
file's SHA-256 is checked first. Where there is no such folder, code is not kept.
"""

import contextlib
import gc
import hashlib
import os
import pickle
import re
import stat
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba import njit
from numba.core import event
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.registry import cpu_target
from numba.core.runtime.nrt import rtsys
from platformdirs import user_cache_path

from stereo_seecolor.compute.sources import PACKAGES, ROOT, sources_digest

OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""numba's options for all functions; no unused wrappers: compilation is a seventh shorter."""
INSTALLATIONS_KEPT = 16
"""Folders kept, one for each installation of this user: some 10 MB each."""
TAG, TAG_CONTENT = (
    "CACHEDIR.TAG",
    b"Signature: 8a477f597d28d172789f06886806bc55\n# Machine code of stereo-seecolor.\n",
)
"""Says to backup programs that a folder is a cache (https://bford.info/cachedir/), and to this
program that it made the folder.
"""
OWN_FILES = re.compile(r"\.nb[ic](\.tmp\.[0-9a-f]+)?$")
"""Names of the files that numba's cache writes."""


def dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """numba's compiled form of a function; its machine code is kept on disk if it is of this
    package and a folder is private.
    """
    found = njit(**OPTIONS, **options)(function)
    if hasattr(found, "enable_caching") and _Locator.from_function(
        function, function.__code__.co_filename
    ):
        found._cache = _KernelCache(function)  # as enable_caching() does, with our locator
    return found


def callee(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """``dispatcher`` for a function that only compiled code calls, kept with its callers."""
    return njit(**{**OPTIONS, **options, "no_cpython_wrapper": True})(function)


class _Library(JITCodeLibrary):
    """Code of one function. numba optimizes the code of each function and of all that it calls, and
    makes machine code of it; here one that Python cannot call is only linked into its callers,
    which are optimized as a whole. That saves a quarter of the time.
    """

    _only_linked = False

    def add_ir_module(self, ir_module: Any) -> None:
        """Add code. What only takes a call from Python apart runs once a call: optimizing it would
        take as long as optimizing the function.
        """
        if ir_module.name == "wrapper":
            for function in ir_module.functions:
                if not function.is_declaration:
                    function.attributes.add("optnone")
                    function.attributes.add("noinline")
        super().add_ir_module(ir_module)  # type: ignore[no-untyped-call]

    def get_pointer_to_function(self, name: str) -> Any:
        """The address of a function, 0 where there is none: numba asks for what Python calls."""
        if not self._finalized:
            try:
                self._final_module.get_function(name)
            except NameError:
                self._only_linked = True
                return 0
        return super().get_pointer_to_function(name)  # type: ignore[no-untyped-call]

    def _optimize_final_module(self) -> None:
        if not self._only_linked:
            super()._optimize_final_module()  # type: ignore[no-untyped-call]

    def _finalize_final_module(self) -> None:
        if self._only_linked:
            self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
            self._finalized = True
        else:
            super()._finalize_final_module()  # type: ignore[no-untyped-call]


class _Codegen(JITCPUCodegen):
    """numba's, with libraries of which some are only linked: these have no place for constants."""

    _library_class = _Library

    def set_env(self, env_name: str, env: Any) -> None:
        if self._engine.is_symbol_defined(env_name):  # type: ignore[no-untyped-call]
            super().set_env(env_name, env)  # type: ignore[no-untyped-call]


LINKED_IN = "0.68."
"""The release of numba whose private classes these are; others optimize each function apart."""

if numba.__version__.startswith(LINKED_IN):
    cpu_target.target_context.codegen().__class__ = _Codegen


def is_missing(found: Any) -> bool:
    """Whether the code of a function of ``dispatcher`` can be kept on disk, and is not yet."""
    try:
        file = found._cache._cache_file
        return not file._load_index() and os.access(file._cache_path, os.W_OK)
    except Exception:  # no place for it, or it cannot be read
        return False


class _WithoutGarbage(event.Listener):
    """Stops garbage collection during compilation, of whose time it takes a tenth to a sixth."""

    def __init__(self) -> None:
        self._depth, self._collects = 0, False
        self.begun = 0

    def on_start(self, event: Any) -> None:
        """Begin; compilations nest."""
        if self._depth == 0:
            self._collects = gc.isenabled()
            gc.disable()
            self.begun += 1
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """End."""
        self._depth -= 1
        if self._depth == 0 and self._collects:
            gc.enable()


_compilations = _WithoutGarbage()
event.register("numba:compile", _compilations)  # type: ignore[no-untyped-call]


def compilations() -> int:
    """How many times this process has had to compile a function, callees not counted."""
    return _compilations.begun


class _Locator:
    """The folder of a function's machine code, in the form that numba's cache asks for."""

    def __init__(self, function: Callable[..., Any], file: Path, folder: Path) -> None:
        self._py_file = str(file)
        self._disambiguator = function.__module__
        self._stamp = sources_digest(file)
        self._folder = folder

    @classmethod
    def from_function(cls, function: Callable[..., Any], py_file: str) -> "_Locator | None":
        file = Path(py_file).resolve()
        folder = (
            _folder()
            if ROOT in file.parents and file.is_file() and function.__module__.startswith(PACKAGES)
            else None
        )
        return cls(function, file, folder) if folder else None

    def ensure_cache_path(self) -> None:
        _make(self._folder)

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._stamp

    def get_disambiguator(self) -> str:
        return self._disambiguator


class _KernelFiles(IndexDataCacheFile):
    """numba's files, each begun with a SHA-256: of numba's version, the sources, and what follows.

    Each entry holds its key, too: two processes that write at once may give two entries one name.
    """

    def load(self, key: Any) -> Any:
        found = super().load(key)  # type: ignore[no-untyped-call]
        return found[1] if found and found[0] == key else None

    def save(self, key: Any, data: Any) -> None:
        super().save(key, (key, data))  # type: ignore[no-untyped-call]

    def _load_index(self) -> Any:
        return self._read(Path(self._index_path)) or {}

    def _save_index(self, overloads: Any) -> None:
        self._write(self._index_path, overloads)

    def _load_data(self, name: str) -> Any:
        return self._read(Path(self._data_path(name)))  # type: ignore[no-untyped-call]

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)  # type: ignore[no-untyped-call]

    def _read(self, path: Path) -> Any:
        """The content of a file; None if missing, damaged, or of other sources or numba."""
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        digest = self._digest(content[32:])
        return pickle.loads(content[32:]) if content[:32] == digest else None

    def _write(self, path: str, value: Any) -> None:
        content = self._dump(value)  # type: ignore[no-untyped-call]
        with self._open_for_write(path) as file:
            file.write(self._digest(content) + content)

    def _digest(self, content: bytes) -> bytes:
        return hashlib.sha256(
            f"{numba.__version__} {self._source_stamp} ".encode() + content
        ).digest()


class _KernelCacheImpl(CompileResultCacheImpl):
    _locator_classes: list[type[object]] = [_Locator]  # noqa: RUF012  # as numba declares it


class _KernelCache(FunctionCache):
    """numba's cache, in which an entry that cannot be read or written only causes a compilation."""

    _impl_class = _KernelCacheImpl

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        locator, name = self._impl.locator, self._impl.filename_base
        self._cache_file = _KernelFiles(locator.get_cache_path(), name, locator.get_source_stamp())  # type: ignore[no-untyped-call]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load compiled code without the modules that only compilation needs."""
        try:
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception:
            # a file that cannot be read, or another version of a library that the entry needs
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except Exception:  # the disk is full, or the folder was removed
            self.disable()  # type: ignore[no-untyped-call]


@cache
def _folder() -> Path | None:
    """The folder for this installation's machine code, in NUMBA_CACHE_DIR or the user's cache
    folder; None if neither serves.
    """
    named = os.environ.get("NUMBA_CACHE_DIR")
    places = [Path(named).absolute() / f"stereo-seecolor-{_user()}"] if named else []
    with contextlib.suppress(RuntimeError):  # this user has no home folder
        places.append(user_cache_path("stereo-seecolor", appauthor=False) / "kernels")
    installation = hashlib.sha256(str(ROOT).encode()).hexdigest()[:16]
    for place in places:
        folder = place / installation
        if place.is_absolute() and _private(place) and _make(folder):
            return folder
    return None


def _user() -> int:
    return os.geteuid() if hasattr(os, "geteuid") else 0


def _private(folder: Path) -> bool:
    """Make a folder if needed. True for one of this user, no link, writable by no other."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return False
    if os.name == "nt":  # the folders of a user are theirs alone there
        return True
    return stat.S_ISDIR(found.st_mode) and found.st_uid == _user() and not found.st_mode & 0o022


def _make(folder: Path) -> bool:
    """Make a tagged folder of an installation where there is none; remove those longest unused."""
    with contextlib.suppress(OSError):  # of a read-only disk: what is there can be loaded
        if not folder.is_dir():
            folder.mkdir()
            (folder / TAG).write_bytes(TAG_CONTENT)
            _remove_oldest(folder.parent)
        os.utime(folder / TAG)
    return folder.is_dir()


def _remove_oldest(place: Path) -> None:
    """Keep INSTALLATIONS_KEPT folders. Of those that this program tagged, its own files go, and the
    folder if that empties it.
    """
    tags = [
        tag
        for tag in place.glob(f"*/{TAG}")
        if not tag.parent.is_symlink() and tag.read_bytes() == TAG_CONTENT
    ]
    for tag in sorted(tags, key=lambda tag: tag.stat().st_mtime)[:-INSTALLATIONS_KEPT]:
        for file in tag.parent.iterdir():
            if OWN_FILES.search(file.name):
                file.unlink()
        tag.unlink()
        with contextlib.suppress(OSError):  # it holds files of others
            tag.parent.rmdir()
