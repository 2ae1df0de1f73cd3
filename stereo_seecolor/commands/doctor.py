"""``doctor``: the libraries and hardware of this machine; for each missing library, the functions
that need it and the command to install it.
"""

import importlib
import importlib.metadata
import os
import platform
import sys
from dataclasses import dataclass, replace

from stereo_seecolor.compute.threads import cores
from stereo_seecolor.mapping.surface.open3d_library import SYSTEM_LIBRARIES

OLDEST_PYTHON = (3, 11)
INSTALL = "pip install -c constraints.txt"


@dataclass(frozen=True)
class Library:
    """A library that the program imports. extra: the extra of this package that installs it, "" for
    a core dependency.

    distribution: its name on the package index. without: what cannot be done without it, "" if
    nothing can.
    """

    module: str
    distribution: str
    extra: str = ""
    without: str = ""


CORE = (
    Library("numpy", "numpy"),
    Library("scipy", "scipy"),
    Library("cv2", "opencv-contrib-python-headless"),
    Library("torch", "torch"),
    Library("numba", "numba"),
    Library("pydantic", "pydantic"),
    Library("yaml", "pyyaml"),
    Library("rich", "rich"),
    Library("typer", "typer"),
    Library("filelock", "filelock"),
    Library("platformdirs", "platformdirs"),
    Library("threadpoolctl", "threadpoolctl"),
    Library("PIL", "pillow"),
    Library("jinja2", "jinja2"),
    Library("isal", "isal", without="all functions work, but writing images takes twice the time"),
)
EXTRAS = (
    Library(
        "gtsam",
        "gtsam",
        "slam",
        "no loop closure, no bundle adjustment, and no poses as a prior (mapping.poses=prior)",
    ),
    Library("rasterio", "rasterio", "geo", "no GeoTIFF of mosaic and terrain"),
    Library("pyproj", "pyproj", "geo", "no GeoTIFF and LAZ in map coordinates"),
    Library("laspy", "laspy", "geo", "no LAZ point cloud"),
    Library("lazrs", "lazrs", "geo", "no LAZ point cloud"),
    Library(
        "open3d",
        "open3d",
        "open3d",
        "no fusion by Open3D (mapping.engine=open3d), no map window (view --window)",
    ),
    Library(
        "skimage",
        "scikit-image",
        "evaluation",
        "no color differences (evaluate, water --chart, report --charts)",
    ),
    Library("OpenEXR", "openexr", "exr", "no range maps in OpenEXR files (correct --range)"),
    Library("h5py", "h5py", "matlab", "no calibrations that MATLAB saved as version 7.3"),
    Library("rosbags", "rosbags", "bags", "no ROS bags as input (run --bag)"),
    Library("mcap", "mcap", "bags", "no MCAP output (export --to mcap)"),
    Library("copclib", "copclib", "copc", "no point clouds as COPC (export --to copc)"),
    Library(
        "cyclonedds",
        "cyclonedds",
        "ros2",
        "no ROS 2 topics as input and output (live --left ros2:/..., --publish)",
    ),
    Library("lz4", "lz4", "bags", "no bags that are compressed with LZ4"),
    Library("zstandard", "zstandard", "bags", "no bags that are compressed with Zstandard"),
    Library("av", "av", "video", "no videos (run, sync)"),
    Library("distributed", "dask", "cluster", "no runs on several machines (--cluster)"),
    Library(
        "cryptography",
        "cryptography",
        "cluster",
        "no encrypted connections of a cluster (--cluster)",
    ),
    Library(
        "dask_jobqueue",
        "dask-jobqueue",
        "cluster",
        "no clusters of SLURM, PBS, LSF, SGE or HTCondor (--cluster)",
    ),
    Library(
        "onnxruntime",
        "onnxruntime",
        "onnx",
        "no stereo network of your own (matching.engine=NET.onnx)",
    ),
    Library("rerun", "rerun-sdk", "viewer", "view --window opens Open3D's plainer window"),
)


@dataclass(frozen=True)
class Finding:
    """One part of the installation.

    ok: it is there and works. detail: version, or the error. needed: True if nothing runs without
    it.
    without: what cannot be done without it. fix: the command that installs it, "" if there is none.
    """

    what: str
    ok: bool
    detail: str
    needed: bool = False
    without: str = ""
    fix: str = ""


@dataclass(frozen=True)
class DoctorReport:
    """All parts that were examined."""

    findings: tuple[Finding, ...]

    @property
    def ready(self) -> bool:
        """True if nothing is missing that every run needs."""
        return all(finding.ok for finding in self.findings if finding.needed)


def doctor() -> DoctorReport:
    """Look at all that the program can make use of."""
    return DoctorReport(
        (
            Finding(
                "python", sys.version_info >= OLDEST_PYTHON, platform.python_version(), needed=True
            ),
            Finding("processor", True, f"{cores()} cores, {platform.machine()}"),
            *(examine(library) for library in CORE),
            _cuda(),
            *(with_system_libraries(examine(library)) for library in EXTRAS),
        )
    )


def examine(library: Library) -> Finding:
    """Import a library and state its version, or why it cannot be used."""
    name = f"{library.module} (extra {library.extra!r})" if library.extra else library.module
    fix = f"{INSTALL} '.[{library.extra}]'" if library.extra else f"{INSTALL} ."
    needed = not library.extra and not library.without
    try:
        importlib.import_module(library.module)
    except ModuleNotFoundError as error:
        detail = "not installed" if error.name == library.module else str(error)
    except (ImportError, OSError) as error:
        detail = " ".join(str(error).split())
    else:
        return Finding(name, True, _version(library), needed)
    return Finding(name, False, detail, needed, library.without, fix)


def _version(library: Library) -> str:
    try:
        return importlib.metadata.version(library.distribution)
    except importlib.metadata.PackageNotFoundError:
        # installed under another name, as variants of OpenCV and Open3D are
        return str(getattr(sys.modules[library.module], "__version__", "installed"))


def _cuda() -> Finding:
    try:
        import torch
    except (ImportError, OSError):
        return Finding("CUDA", True, "not tested, because torch is missing")
    if torch.cuda.is_available():
        return Finding("CUDA", True, torch.cuda.get_device_name(0))
    return Finding("CUDA", True, "none; everything runs on the processor")


def with_system_libraries(finding: Finding) -> Finding:
    """The finding; where Open3D lacks system libraries, with the command that installs them."""
    if finding.ok or finding.detail == "not installed" or not finding.what.startswith("open3d"):
        return finding
    fix = SYSTEM_LIBRARIES if getattr(os, "geteuid", int)() == 0 else f"sudo {SYSTEM_LIBRARIES}"
    return replace(finding, fix=fix if sys.platform.startswith("linux") else "")
