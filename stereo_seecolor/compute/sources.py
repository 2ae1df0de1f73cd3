"""Hashes of a module's source and of all it imports, to tell whether results are current."""

import hashlib
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
"""The folder that holds the package."""
PACKAGES = ("stereo_seecolor", "calibration")

_IMPORT = re.compile(
    rf"^[ \t]*(?:from\s+((?:{'|'.join(PACKAGES)})[\w.]*)\s+import\s+(\([^)]*\)|.*)"
    rf"|import\s+((?:{'|'.join(PACKAGES)})[\w.]*))",
    re.M,
)


@cache
def sources_digest(file: Path) -> str:
    """SHA-256 of a source file and of all files of the package that it imports."""
    found, waiting = {file}, [file]
    while waiting:
        more = _imports(waiting.pop()) - found
        found |= more
        waiting += more
    digest = hashlib.sha256()
    for path in sorted(found):
        digest.update(
            f"{path.relative_to(ROOT)}\n".encode() + hashlib.sha256(_text(path).encode()).digest()
        )
    return digest.hexdigest()


@cache
def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8")


@cache
def _imports(file: Path) -> set[Path]:
    """The files of the package that a source file names in its import statements."""
    found = set()
    for package, names, module in _IMPORT.findall(_text(file)):
        modules = (
            [package, *(f"{package}.{name}" for name in re.findall(r"\w+", names))]
            if package
            else [module]
        )
        for dotted in modules:
            path = ROOT.joinpath(*dotted.split("."))
            found |= {
                source
                for source in (path.with_suffix(".py"), path / "__init__.py")
                if source.is_file()
            }
    return found
