"""The cache of machine code between runs, for numba.

numba's own cache depends on the file that holds a function. But constants and callees in other files are compiled in, too. So here
a function's code is current as long as no source file has changed that its module imports, directly or through others. numba adds
its own version, the processor and the argument types. Stale entries are overwritten. Where no folder can be written, code is not
kept.
"""

import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.runtime.nrt import rtsys

from stereo_seecolor.compute.sources import PACKAGES, ROOT, sources_digest

OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""numba's options for all functions. Without wrappers that nobody calls, compilation takes a seventh less time."""
INSTALLATIONS_KEPT = 8
"""Folders kept in the user's cache folder, one for each installation that cannot write into its own: some 10 MB each."""


def keep_on_this_machine() -> None:
    """Keep machine code in this machine's folder for temporary files, with a copy of the code that the installation has.

    For workers on other machines, which would all write into one folder of a shared disk. Does nothing if NUMBA_CACHE_DIR is set.
    """
    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    owner = os.getuid() if hasattr(os, "getuid") else 0
    os.environ["NUMBA_CACHE_DIR"] = str(Path(tempfile.gettempdir()) / f"stereo-seecolor-kernels-{owner}")
    installed, own = ROOT / PACKAGES[0] / "__pycache__" / "compiled", Path(os.environ["NUMBA_CACHE_DIR"]) / _installation()
    if installed.is_dir() and not own.exists():
        begun = own.with_name(f"{own.name}-{os.getpid()}")
        try:
            shutil.copytree(installed, begun)
            begun.rename(own)  # refused where another worker of this machine was first
        except OSError:
            shutil.rmtree(begun, ignore_errors=True)


def dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """numba's compiled form of a function; its machine code is kept on disk if it is of this package and a folder is writable."""
    found = njit(**OPTIONS, **options)(function)
    if hasattr(found, "enable_caching") and _Locator.from_function(function, function.__code__.co_filename):
        found._cache = _KernelCache(function)  # type: ignore[no-untyped-call]  # as enable_caching() does, with our locator
    return found


def callee(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """``dispatcher`` for a function that only compiled code calls; its machine code is kept as a part of its callers'."""
    return njit(**{**OPTIONS, **options, "no_cpython_wrapper": True})(function)


def is_missing(found: Any) -> bool:
    """True if the code of a function from ``dispatcher`` can be kept on disk, and is not there yet."""
    try:
        file = found._cache._cache_file
        return not file._load_index() and os.access(file._cache_path, os.W_OK)
    except Exception:  # no place for it, or a damaged file: unpickling it can raise anything
        return False


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
        folder = _folder() if ROOT in file.parents and file.is_file() and function.__module__.startswith(PACKAGES) else None
        return cls(function, file, folder) if folder else None

    def ensure_cache_path(self) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._stamp

    def get_disambiguator(self) -> str:
        return self._disambiguator


class _KernelCacheImpl(CompileResultCacheImpl):
    _locator_classes: list[type[object]] = [_Locator]  # noqa: RUF012  # as numba declares it


class _KernelCache(FunctionCache):
    """numba's cache, in which an entry that cannot be read or written only causes a compilation."""

    _impl_class = _KernelCacheImpl

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load compiled code without the modules that only compilation needs, which numba's own method imports first."""
        try:
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception:  # a damaged file: unpickling it can raise anything
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except Exception:  # the disk is full, or the damaged file is the index
            self.disable()  # type: ignore[no-untyped-call]


@cache
def _folder() -> Path | None:
    """The folder for machine code: NUMBA_CACHE_DIR, beside the byte code, or the user's cache folder; None if there is none."""
    named, user = os.environ.get("NUMBA_CACHE_DIR"), _user_cache()
    shared = [Path(folder).absolute() / _installation() for folder in (named, user) if folder]
    places = [*shared[: bool(named)], ROOT / PACKAGES[0] / "__pycache__" / "compiled", *shared[bool(named) :]]
    for place in places:
        if _made(place):
            if place in shared:
                _remove_oldest(place.parent)
            return place
    return next((place for place in places if place.is_dir()), None)  # filled by someone who could write it


def _installation() -> Path:
    """The name of an installation's folder among those of others."""
    return Path("stereo-seecolor") / hashlib.sha256(str(ROOT).encode()).hexdigest()[:16]


def _made(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.R_OK | os.W_OK | os.X_OK)


def _user_cache() -> Path | None:
    named = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME")
    usual = named or os.path.expanduser("~/Library/Caches" if sys.platform == "darwin" else "~/.cache")  # noqa: PTH111  # never raises
    return Path(usual) if Path(usual).is_absolute() else None


def _remove_oldest(folder: Path) -> None:
    installations = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime)
    for path in installations[:-INSTALLATIONS_KEPT]:
        shutil.rmtree(path, ignore_errors=True)
