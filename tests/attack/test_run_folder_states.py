"""Random sequences of commands, changed settings, kills, moved and edited files, against a model of
what OUT must hold.

The model is the plain rule: after a command that ends well, OUT holds for each pair exactly what
the same command writes into an empty folder; files of the user's own are always there, with their
content.
"""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
from conftest import AtPair, Dive
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from stereo_seecolor.commands.run import range_maps, run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import OutputError
from stereo_seecolor.run_folder.finished_run import open_run

PRODUCTS = ("corrected", "range", "range_std", "confidence", "mask", "clouds")
CONFIGS = (
    (),
    ("color.lock=survey",),
    ("color.lock=survey", "output.image_format=jpg", "output.preset=no-clouds"),
    ("color.lock=survey", "output.preset=lean", "matching.min_confidence=0.5"),
)
PRECIOUS = b"mine"


class Kill(BaseException):
    """Ends a run as a kill does: no handler of the program's catches it."""


def products(out: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(out)): path.read_bytes()
        for product in PRODUCTS
        for path in (out / product).glob("*")
        if path.read_bytes() != PRECIOUS  # a file of the user's, which stays
    }


def machine(dive: Dive) -> type[RuleBasedStateMachine]:  # noqa: C901  # the rules share the dive and the expected products
    truth: dict[tuple[object, ...], dict[str, bytes]] = {}

    class Attack(RuleBasedStateMachine):
        """One OUT through whatever may happen to it."""

        @initialize()
        def begin(self) -> None:
            self.root = Path(mkdtemp(dir=dive.root.parent))
            self.dive = replace(dive, root=self.root / "dive")
            shutil.copytree(dive.root, self.dive.root)
            self.out = self.root / "out"
            self.mine: dict[Path, bytes] = {}
            self.pairs = {"0000", "0001", "0002"}
            self.done: tuple[object, ...] | None = None

        def command(
            self,
            config: int,
            command: Callable[..., object],
            options: RunOptions,
            out: Path | None = None,
        ) -> None:
            left, right, calib = (
                self.dive.root / "L",
                self.dive.root / "R",
                self.dive.root / "cam.yaml",
            )
            command(
                left, right, calib, out or self.out, load_config(None, CONFIGS[config]), options
            )

        def expected(self, config: int, command: Callable[..., object]) -> dict[str, bytes]:
            key = (config, command, *sorted(self.pairs))
            if key not in truth:
                fresh = self.root / "fresh"
                self.command(config, command, RunOptions(), fresh)
                truth[key] = products(fresh)
                shutil.rmtree(fresh)
            return truth[key]

        @rule(config=st.sampled_from(range(len(CONFIGS))), overwrite=st.booleans())
        def run_to_the_end(self, config: int, overwrite: bool) -> None:
            self.command(config, run, RunOptions(overwrite=overwrite))
            assert products(self.out) == self.expected(config, run)
            assert {frame.name for frame in open_run(self.out).frames} == self.pairs
            self.done = (config, run)

        @rule(config=st.sampled_from(range(len(CONFIGS))), at=st.integers(1, 6))
        def killed(self, config: int, at: int) -> None:
            try:
                self.command(config, run, RunOptions(workers=1, listener=AtPair(at, Kill)))
            except Kill:
                self.done = None

        @rule(config=st.sampled_from(range(len(CONFIGS))))
        def ranges_alone(self, config: int) -> None:
            self.command(config, range_maps, RunOptions())
            ranges = {
                name: content
                for name, content in products(self.out).items()
                if name.split("/")[0].startswith(("range", "conf"))
            }
            assert ranges == self.expected(config, range_maps)
            self.done = None

        @precondition(lambda self: len(self.pairs) > 1)
        @rule()
        def a_pair_is_removed(self) -> None:
            name = sorted(self.pairs)[-1]
            for side in "LR":
                (self.dive.root / side / f"{name}.png").unlink()
            self.pairs.remove(name)
            self.done = None

        @rule(place=st.sampled_from(["notes.txt", "annotations/a.json", "corrected/.thumbnails"]))
        def the_user_writes(self, place: str) -> None:
            if (self.out / ".state/manifest.json").exists():
                path = self.out / place
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(PRECIOUS)
                self.mine[path] = PRECIOUS

        @rule(product=st.sampled_from(PRODUCTS), number=st.integers(0, 2))
        def the_user_edits(self, product: str, number: int) -> None:
            files = sorted((self.out / product).glob("0*"))
            if files:
                edited = files[number % len(files)]
                content = bytes(
                    np.random.default_rng(len(self.mine)).integers(0, 255, 50, dtype=np.uint8)
                )
                edited.write_bytes(content)
                self.mine[edited] = content

        @rule()
        def everything_is_moved(self) -> None:
            moved = Path(mkdtemp(dir=dive.root.parent)) / "moved"
            self.root.rename(moved)
            self.mine = {
                moved / path.relative_to(self.root): content for path, content in self.mine.items()
            }
            self.root, self.out = moved, moved / "out"
            self.dive = replace(self.dive, root=moved / "dive")

        @rule()
        def a_foreign_folder_in_the_way(self) -> None:
            if not (self.out / ".state/manifest.json").exists():
                return
            foreign = self.out / "mask/yours.txt"
            foreign.parent.mkdir(exist_ok=True)
            foreign.write_bytes(PRECIOUS)
            for overwrite in (False, True):
                with pytest.raises(OutputError, match="was not written by this program"):
                    self.command(0, run, RunOptions(overwrite=overwrite))
            assert foreign.read_bytes() == PRECIOUS
            foreign.unlink()

        @invariant()
        def nothing_of_the_users_is_lost(self) -> None:
            if not hasattr(self, "mine"):
                return
            aside = [
                path.read_bytes() for path in (self.out / "set_aside").rglob("*") if path.is_file()
            ]
            for path, content in self.mine.items():
                kept = path.exists() and path.read_bytes() == content
                assert kept or content in aside, path

        def teardown(self) -> None:
            shutil.rmtree(getattr(self, "root", "/nonexistent"), ignore_errors=True)

    return Attack


@pytest.mark.slow
@pytest.mark.timeout(900)  # 90 commands
def test_no_sequence_of_events_loses_or_confuses_anything(make_dive: Callable[..., Dive]) -> None:
    run_state_machine_as_test(
        machine(make_dive(3)),
        settings=settings(
            max_examples=9,
            stateful_step_count=10,
            derandomize=True,
            suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
        ),
    )
