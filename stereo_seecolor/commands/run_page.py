"""The page that a run writes at its end, and, if asked for, while it works."""

from dataclasses import dataclass, replace
from functools import partial

from stereo_seecolor.dive.frames import PageFiles
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.progress import Both
from stereo_seecolor.records import FrameRow
from stereo_seecolor.run_folder.finished_run import open_run
from stereo_seecolor.run_folder.folder import RunFolder
from stereo_seecolor.run_folder.layout import INDEX
from stereo_seecolor.run_folder.reports import RunDescription


@dataclass(frozen=True, eq=False)
class RunPage:
    """Writes a run's OUT/index.html. options: say when. run: the command's description."""

    options: RunOptions
    folder: RunFolder
    run: RunDescription

    def listening(self) -> RunOptions:
        """The options of the run, with a listener that writes the page meanwhile, if asked."""
        if self.options.page != "live":
            return self.options
        from stereo_seecolor.report.live_page import LivePage  # loads the templates
        from stereo_seecolor.report.page import dive_name

        live = LivePage(
            self.folder, dive_name(self.run.inputs, self.folder.root), self.run.config.input
        )
        return replace(self.options, listener=Both(self.options.listener, live))

    def early_files(self) -> PageFiles | None:
        """What makes the page's frame files while a run has the pixels; None without a page."""
        whole = self.options.page != "none" and self.options.shard.whole
        if not whole or self.run.last != "corrected" or self.run.rectification is None:
            return None
        from stereo_seecolor.report.frame_files import early_files

        return partial(early_files, self.run.rectification.pair)

    def keep(self) -> None:
        """Keep the live page until the final one is there: without it, browsers stop reloading."""
        dive = self.folder.dive.record
        if self.options.page == "live" and INDEX in dive.files:
            self.folder.dive.update(
                replace(
                    dive, made_from={**dive.made_from, INDEX: self.folder.dive.digest("corrected")}
                )
            )

    def drop(self) -> None:
        """Remove the live page of a run that ends by an error: it would show the run at work."""
        if self.options.page == "live":
            self.folder.dive.remove(INDEX)

    def end(self, stopped: bool) -> None:
        """Write the page of a run that has ended. A stopped run gets one only where a live
        page is to be replaced.

        Raises OutputError; InputError if files that the page is made from are missing.
        """
        page, listener = self.options.page, self.options.listener
        if page == "none" or self.run.last != "corrected" or (stopped and page != "live"):
            return
        from stereo_seecolor.report.page import write_page  # loads the templates

        finished = open_run(self.folder.root)
        listener.begin("page", len(finished.frames))
        write_page(self.folder, finished, lambda done, _: listener.advance(FrameRow(f"{done}")))
