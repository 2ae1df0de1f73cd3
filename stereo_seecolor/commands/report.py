"""``report``: write the page of a finished run, OUT/index.html."""

from pathlib import Path

from stereo_seecolor.compute.process import return_freed
from stereo_seecolor.plugins import load
from stereo_seecolor.progress import Listener, Silence
from stereo_seecolor.records import FrameRow
from stereo_seecolor.report.page import PageSummary, write_page
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.folder import RunFolder


def report(out: Path, listener: Listener | None = None, *, charts: bool = False) -> PageSummary:
    """Write ``out``/index.html and its files, ``out``/page. It needs no network and no program.

    Only what changed since an earlier page is made. charts: search all frames for color charts,
    which takes seconds a frame, and compare the views of the same spots; later pages of the same
    frames show these results, too.
    Raises InputError if ``out`` holds no run, or files of it are damaged; OutputError if the page
    cannot be written, or another run writes into ``out`` now.
    """
    open_run(out)  # refuses another folder before anything is written into it
    listener = listener or Silence()
    with RunFolder.existing(out, "report") as folder:
        run = open_run(out)
        if charts:
            load("page_parts", "charts", needs=("__call__",))(folder, run, listener)
        return_freed()
        listener.begin("page", len(run.frames))
        return write_page(folder, run, lambda done, _: listener.advance(FrameRow(f"{done}")))
