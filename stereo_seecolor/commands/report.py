"""``report``: write the page of a finished run, OUT/index.html."""

from pathlib import Path

from stereo_seecolor.errors import InputError
from stereo_seecolor.progress import Listener, Silence
from stereo_seecolor.records import FrameRow
from stereo_seecolor.report.charts import ShownChart, write_charts
from stereo_seecolor.report.frame_files import FrameFiles
from stereo_seecolor.report.page import PageSummary, write_page
from stereo_seecolor.run_folder.finished_run import FinishedRun, open_run
from stereo_seecolor.run_folder.folder import RunFolder


def report(out: Path, listener: Listener | None = None, *, brief: bool = False, charts: bool = False) -> PageSummary:
    """Write ``out``/index.html and its files, ``out``/page. The page needs neither a network nor the program.

    Only what changed since an earlier page is made. brief: the quick page of run and fuse, on which only some frames of a long dive
    are shown in full. charts: search all frames for color charts, which takes seconds a frame, and compare the views of the same
    spots; later pages of the same frames show these results, too.
    Raises InputError if ``out`` holds no run, or files of it are damaged; OutputError if the page cannot be written, or another run
    writes into ``out`` now.
    """
    open_run(out)  # refuses another folder before anything is written into it
    listener = listener or Silence()
    with RunFolder.existing(out) as folder:
        run = open_run(out)
        if charts:
            _look_for_charts(folder, run, listener)
        listener.begin("page", len(run.frames))
        return write_page(folder, run, brief, lambda done, _: listener.advance(FrameRow(f"{done}")))


def _look_for_charts(folder: RunFolder, run: FinishedRun, listener: Listener) -> None:
    """Search all frames for color charts, compare views of the same spots, and keep both results for the page."""
    from stereo_seecolor.extras.evaluation.chart_search import find_all
    from stereo_seecolor.extras.evaluation.evaluate import evaluate_spread  # loads scipy

    found: list[ShownChart] = []
    listener.begin("charts", len(run.frames))
    for frame, charts in zip(run.frames, find_all(FrameFiles.of(run), run.frames), strict=True):
        found += charts
        listener.advance(FrameRow(frame.name))
    try:
        spread = evaluate_spread(run.root)
    except InputError:
        spread = None  # no two frames show the same, or the images are gone
    write_charts(folder, found, spread)
