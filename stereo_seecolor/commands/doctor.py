"""What this machine has for the job, what it lacks, and how to mend it."""

import importlib
import os
import platform
import sys
from dataclasses import dataclass

from stereo_seecolor.compute.threads import cores
from stereo_seecolor.mapping.surface.extraction import LIBRARIES

EXTRAS = {"rasterio": "geo", "laspy": "geo", "pyproj": "geo", "onnxruntime": "onnx"}


@dataclass(frozen=True)
class Finding:
    """One thing looked at. needed: the main job cannot do without it; mend: the command that mends it, "" if nothing is to mend."""

    what: str
    ok: bool
    detail: str
    mend: str = ""
    needed: bool = False


def examine() -> list[Finding]:
    """Look at all that the program can make use of."""
    findings = [
        Finding("python", sys.version_info >= (3, 11), platform.python_version(), needed=True),
        Finding("processor", True, f"{cores()} cores, {platform.machine()}"),
    ]
    findings += [_library(name, needed=True) for name in ("numpy", "cv2", "torch", "numba", "pydantic", "yaml")]
    return [*findings, _cuda(), _open3d(), *(_extra(module, extra) for module, extra in EXTRAS.items())]


def _library(name: str, needed: bool) -> Finding:
    try:
        module = importlib.import_module(name)
    except (ImportError, OSError) as error:
        return Finding(name, False, str(error), "pip install -c constraints.txt .", needed)
    return Finding(name, True, str(getattr(module, "__version__", "installed")), needed=needed)


def _cuda() -> Finding:
    try:
        import torch
    except (ImportError, OSError):
        return Finding("CUDA", True, "not looked for, torch is missing")
    if torch.cuda.is_available():
        return Finding("CUDA", True, torch.cuda.get_device_name(0))
    return Finding("CUDA", True, "none; everything runs on the processor")


def _open3d() -> Finding:
    try:
        module = importlib.import_module("open3d")
    except ModuleNotFoundError:
        return Finding("open3d (only --fuse needs it)", False, "not installed", "pip install -c constraints.txt open3d")
    except (ImportError, OSError) as error:
        sudo = "" if os.geteuid() == 0 else "sudo "
        return Finding("open3d (only --fuse needs it)", False, str(error), f"{sudo}{LIBRARIES}")
    return Finding("open3d (only --fuse needs it)", True, module.__version__)


def _extra(module: str, extra: str) -> Finding:
    found = _library(module, needed=False)
    if found.ok:
        return found
    return Finding(f"{module} (extra {extra!r})", False, "not installed", f"pip install -c constraints.txt '.[{extra}]'")
