"""The size of the code in numbers, for docs/lab/architecture.md: files, modules that ``run`` loads,
functions from the command line to the matching kernel, settings, commands.
"""

import contextlib
import io
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from pydantic import BaseModel

ROOT = Path(__file__).parent.parent
PACKAGES = ("stereo_seecolor", "calibration")


def files_of(place: Path) -> list[Path]:
    """The Python files of a package."""
    return sorted(place.rglob("*.py"))


def size(files: list[Path]) -> tuple[int, int, int]:
    """Files, lines, and characters."""
    texts = [file.read_text(encoding="utf-8") for file in files]
    return len(files), sum(len(text.splitlines()) for text in texts), sum(map(len, texts))


def settings(model: type[BaseModel]) -> int:
    """The keys of the configuration, counted through its sections."""
    parts = [field.annotation for field in model.model_fields.values()]
    return sum(
        settings(part) if isinstance(part, type) and issubclass(part, BaseModel) else 1
        for part in parts
    )


def modules_imported(module: str) -> int:
    """Our own modules that an import of ``module`` loads."""
    ours = f"name.split('.')[0] in {PACKAGES}"
    code = f"import sys, {module}; print(sum({ours} for name in sys.modules))"
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    return int(found.stdout)


class _Spy:
    """Stands for the matching kernel and notes the stack of its first call for a pair."""

    def __init__(self, kernel: Any) -> None:
        self.kernel, self.stack = kernel, list[traceback.FrameSummary]()

    def __call__(self, *arguments: Any) -> Any:
        stack = _whole_stack()
        if not self.stack and any(frame.name == "measure_ranges" for frame in stack):
            self.stack = stack  # not that of the warming up, which comes first
        return self.kernel(*arguments)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.kernel, name)


def _whole_stack() -> list[traceback.FrameSummary]:
    """The stack of this thread below that of the thread which gave it its work."""
    above: list[traceback.FrameSummary] = getattr(threading.current_thread(), "above", [])
    return [*above, *traceback.extract_stack()[:-2]]


def functions_to_kernel() -> list[str]:
    """The functions of ours on the stack, from the command's function to the matching kernel, when
    the sample dive is run.
    """
    from stereo_seecolor.cli import app
    from stereo_seecolor.matching.sgm import search

    submit, spy = ThreadPoolExecutor.submit, _Spy(search.match_rows)

    def noted(pool: Any, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        above = _whole_stack()

        def work_below(*given: Any) -> Any:
            threading.current_thread().above = above  # type: ignore[attr-defined]
            return work(*given)

        return submit(pool, work_below, *arguments)

    dive = ROOT / "data_samples" / "reef"
    words = ["--left", dive / "left", "--right", dive / "right", "--calib", dive / "cam.yaml"]
    search.match_rows = spy  # type: ignore[assignment]
    ThreadPoolExecutor.submit = noted  # type: ignore[method-assign, assignment]
    try:
        with tempfile.TemporaryDirectory() as out, contextlib.redirect_stdout(io.StringIO()):
            sys.argv = ["stereo-seecolor", "run", *map(str, words), "--out", f"{out}/out"]
            app.run_command_line()
    finally:
        ThreadPoolExecutor.submit = submit  # type: ignore[method-assign]
        search.match_rows = spy.kernel
    ours = [
        frame for frame in spy.stack if frame.filename.startswith(str(ROOT / "stereo_seecolor"))
    ]
    names = [frame.name for frame in ours if "/cli/app" not in frame.filename]
    return names[names.index("run") :]


def table() -> str:
    """The numbers, as a table."""
    from stereo_seecolor.cli.app import CORE, every_command
    from stereo_seecolor.config import RunConfig

    everything = [file for package in PACKAGES for file in files_of(ROOT / package)]
    extras = set(files_of(ROOT / "stereo_seecolor" / "extras"))
    core = size([file for file in everything if file not in extras])
    every = size(everything)
    stack = functions_to_kernel()
    rows = [
        ("core and `calibration`", f"{core[0]} files, {core[1]:,} lines, {core[2] / 1e6:.2f} MB"),
        ("with extras", f"{every[0]} files, {every[1]:,} lines, {every[2] / 1e6:.2f} MB"),
        (
            "modules that `commands/run.py` imports",
            f"{modules_imported('stereo_seecolor.commands.run')}",
        ),
        (
            "functions from `run` to the matching kernel",
            f"{len(stack)}: {', '.join(f'`{name}`' for name in stack)}",
        ),
        ("settings", f"{settings(RunConfig)}"),
        ("commands", f"{len(CORE)} of the core, {len(every_command()) - len(CORE)} of extras"),
    ]
    return "\n".join(["| what | number |", "| --- | --- |", *(f"| {a} | {b} |" for a, b in rows)])


if __name__ == "__main__":
    print(table())
