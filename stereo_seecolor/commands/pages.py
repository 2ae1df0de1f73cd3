"""The page of a run, written by the run itself: while it works where that is asked for, and at its end."""

from dataclasses import replace
from typing import TYPE_CHECKING

from stereo_seecolor.progress import Listener, RunOptions
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import INDEX
from stereo_seecolor.run_folder.reports import RunDescription

if TYPE_CHECKING:
    from stereo_seecolor.report.early_frames import EarlyFrames


def with_live_page(options: RunOptions, folder: RunFolder, run: RunDescription) -> RunOptions:
    """The options of a run, with one more listener where its page is to be written while it works."""
    if options.page != "live":
        return options
    from stereo_seecolor.report.live_page import LivePage  # loads the templates
    from stereo_seecolor.report.page import dive_name

    live = LivePage(folder, dive_name(run.inputs, folder.root), run.config.input)
    return replace(options, listener=Both(options.listener, live))


def keep_live_page(options: RunOptions, folder: RunFolder) -> None:
    """Leave the live page where it is until the last one takes its place: a browser that finds none does not look again."""
    if options.page == "live" and INDEX in folder.dive.files:
        folder.update(replace(folder.dive, made_from={**folder.dive.made_from, INDEX: folder.digest("corrected")}))


def early_frames(options: RunOptions, run: RunDescription) -> "EarlyFrames | None":
    """Makes what the page shows of some frames while the run has their pixels; None where the run writes no page."""
    if options.page == "none" or run.last != "corrected" or run.rectification is None or not options.shard.whole:
        return None
    from stereo_seecolor.report.early_frames import EarlyFrames, spread

    return EarlyFrames(frozenset(spread(run.names)), run.rectification.pair)


def end_page(options: RunOptions, folder: RunFolder, run: RunDescription, stopped: bool) -> None:
    """Write the page of a run that has ended, without all that takes time; of a stopped one only in the place of a live page.

    Raises OutputError; InputError if what the page is made of is gone.
    """
    if options.page == "none" or run.last != "corrected" or (stopped and options.page != "live"):
        return
    from stereo_seecolor.report.page import write_page  # loads the templates

    finished = open_run(folder.root)
    options.listener.begin("page", len(finished.frames))
    write_page(folder, finished, True, lambda done, _: options.listener.advance(FrameRow(f"{done}")))


def drop_live_page(options: RunOptions, folder: RunFolder) -> None:
    """Where a run ends by an error, no page says that it is still at work."""
    if options.page == "live":
        folder.remove(INDEX)


class Both:
    """Two listeners as one."""

    def __init__(self, first: Listener, second: Listener) -> None:
        self._listeners = first, second

    def begin(self, stage: str, total: int) -> None:
        """A pass begins."""
        for listener in self._listeners:
            listener.begin(stage, total)

    def advance(self, row: FrameRow) -> None:
        """One more pair is through."""
        for listener in self._listeners:
            listener.advance(row)
