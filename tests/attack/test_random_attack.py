"""Random sequences of all commands that write, with inputs inside OUT, edits in place, files of the
user's and hostile records.

The model knows what is the user's: all files of the dives, every file that was put into OUT or
beside it, and every result that was edited. After each step, each of them is where it was, or in
OUT/set_aside, to the byte. A command ends well or with an error of the program's own, and one that
says that nothing was changed has touched nothing.

STEREO_SEECOLOR_ATTACK_MINUTES=30 attacks for so long; by default for some seconds. The seed and
the number of steps are printed; STEREO_SEECOLOR_ATTACK_SEED gives the seed of the first round.
"""

import json
import os
import shutil
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import mkdtemp

import pytest
from conftest import AtPair, Dive
from hypothesis import HealthCheck, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    rule,
    run_state_machine_as_test,
)

from calibration import CalibrationError
from stereo_seecolor.cli.log import logging_to
from stereo_seecolor.commands.calibrate import calibrate
from stereo_seecolor.commands.convert_calib import convert_calib
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.report import report
from stereo_seecolor.commands.run import correct, range_maps, rectify, run
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import SeeColorError
from stereo_seecolor.extras.evaluation.charts.scores import evaluate_charts
from stereo_seecolor.extras.evaluation.water import measure_water
from stereo_seecolor.extras.export.command import export
from stereo_seecolor.extras.fleet.campaign import campaign
from stereo_seecolor.extras.fleet.merge import merge
from stereo_seecolor.extras.fleet.plan import plan
from stereo_seecolor.extras.reef.compare import compare
from stereo_seecolor.extras.reef.markers import Known, markers
from stereo_seecolor.extras.reef.metrics import metrics
from stereo_seecolor.extras.streams.live.command import LiveInputs, LiveOptions, live
from stereo_seecolor.extras.streams.out_mcap import check_mcap, write_mcap
from stereo_seecolor.run_folder.stamp import Stamp

MINUTES = float(os.environ.get("STEREO_SEECOLOR_ATTACK_MINUTES", "0"))
SEED = int(os.environ.get("STEREO_SEECOLOR_ATTACK_SEED", "1"))
OWN = (
    *(
        "rig.yaml",
        "water.json",
        "water_measured.json",
        "run.json",
        "frames.csv",
        "map/trajectory.tum",
        "map/mine.tum",
        "index.html",
    ),
    *(
        "poses.tum",
        ".state/manifest.json",
        "set_aside/water.json",
        "corrected",
        "range",
        "map",
        ".",
    ),
)
"""What a user may give as an input of a command into OUT: results, own files, folders, OUT
itself.
"""
PLACES = (
    *(
        "notes.txt",
        "poses.tum",
        "map/mine.tum",
        "corrected/notes.txt",
        ".writing-mine",
        "corrected/.writing-mine",
        "page/.writing-x",
    ),
    *(
        "map.json",
        "annotations/0000.json",
        "corrected/0000.jpg",
        "set_aside/range/0000.tiff",
        "../campaign.json",
        ".state/mine",
    ),
    *(
        "water_measured.json",
        "rectified_left/0000.png",
        "original/corrected/0000.png",
        "../notes.txt",
    ),
)
WRITTEN = (
    *("new.yaml", "new", "notes.txt", "out", "out/new", "out/map", "out/poses.tum", "out/run.log"),
    *("out/corrected/0000.png", "out/.state/manifest.json", "out/run.json", "monday"),
    *("monday/cam.yaml", "monday/L/0000.png", "monday/poses.tum", "monday/L/new.png"),
)
"""What a user may give as the file or folder that a command writes."""
CORNERS = [[10, 10], [30, 10], [30, 30], [10, 30]]
POSES = "".join(f"{number} {0.1 * number} 0 0 0 0 0 1\n" for number in range(4))
SETTINGS = (
    (),
    ("color.lock=survey",),
    ("output.image_format=jpg",),
    ("matching.min_confidence=0.5", "output.preset=no-clouds"),
)
OVERWRITE = st.booleans()


class Kill(BaseException):
    """Ends a command as a kill does: no handler of the program's catches it."""


def files(folder: Path) -> dict[Path, bytes]:
    found = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return {path: path.read_bytes() for path in found}


def machine(dives: tuple[Dive, Dive]) -> type[RuleBasedStateMachine]:  # noqa: C901  # the rules share the dives
    class Attack(RuleBasedStateMachine):
        """One OUT, two dives, a campaign, and a user who puts and edits files everywhere."""

        steps = 0

        @initialize()
        def begin(self) -> None:
            self.root = Path(mkdtemp(dir=dives[0].root.parent))
            self.dives = [self.root / name for name in ("monday", "tuesday")]
            for place, dive in zip(self.dives, dives, strict=True):
                shutil.copytree(dive.root, place)
                (place / "poses.tum").write_text(POSES)
            # both begin with the same frame
            shutil.copy2(self.dives[0] / "L/0000.png", self.dives[1] / "L/0000.png")
            shutil.copy2(self.dives[0] / "R/0000.png", self.dives[1] / "R/0000.png")
            self.out = self.root / "out"
            self.mine = set(files(self.root).items())

        def attempt(
            self, command: Callable[[], object], *read: Path, overwrite: bool = False
        ) -> None:
            """Try a command; what it reads in OUT is not lost by it, but for run.json, which a run
            writes again.
            """
            before = files(self.root)
            kept = {
                path: content
                for path, content in before.items()
                if path in read and path.name not in ("run.json", "manifest.json")
            }
            try:
                command()
            except (SeeColorError, CalibrationError) as error:
                assert "\n" not in str(error)
                if "nothing was changed" in str(error):
                    after = files(self.root)
                    assert {
                        path: content
                        for path, content in before.items()
                        if ".state" not in path.parts
                    }.items() <= after.items()
            except Kill:
                pass
            for path, content in kept.items():
                assert self.is_kept(path, content), f"an input was lost: {path}"

        def is_kept(self, path: Path, content: bytes) -> bool:
            if path.is_file() and path.read_bytes() == content:
                return True
            return content in files(self.out / "set_aside").values()

        def user_changed_files(self) -> None:
            """What is gone right after the user's own step is the user's loss: a file edited for
            the second time, for example.
            """
            self.mine = {
                (path, content) for path, content in self.mine if self.is_kept(path, content)
            }

        def given(self, own: str, usual: Path) -> Path:
            return self.out / own if own else usual

        def options(self, overwrite: bool, at: int = 0, **more: object) -> RunOptions:
            listener = {"listener": AtPair(at, Kill)} if at else {}
            return replace(RunOptions(workers=1, overwrite=overwrite), **listener, **more)

        @rule(
            dive=st.sampled_from((0, 0, 0, 1)),
            command=st.sampled_from((run, run, range_maps, rectify)),
            chosen=st.sampled_from(SETTINGS),
            overwrite=OVERWRITE,
            role=st.sampled_from(("", "", "calib", "water", "config", "poses", "left")),
            own=st.sampled_from(OWN),
            at=st.sampled_from((0, 0, 0, 1, 4)),
        )
        def over_pairs(self, dive, command, chosen, overwrite, role, own, at) -> None:  # type: ignore[no-untyped-def]
            place, path = self.dives[dive], self.out / own
            left, calib = (
                path if role == "left" else place / "L",
                path if role == "calib" else place / "cam.yaml",
            )
            more = {
                "water": {"water": path},
                "config": {"config_file": path},
                "poses": {"also_read": (path,)},
            }.get(role, {})
            options = self.options(overwrite, at, **more)
            self.attempt(
                lambda: command(
                    left, place / "R", calib, self.out, load_config(None, chosen), options
                ),
                *([path] if role else []),
            )

        @rule(overwrite=OVERWRITE, own=st.sampled_from(OWN))
        def corrected(self, overwrite: bool, own: str) -> None:
            images, ranges = self.out / "corrected", self.out / "range"
            self.attempt(
                lambda: correct(images, ranges, self.out, options=self.options(overwrite)),
                images,
                ranges,
            )
            self.attempt(
                lambda: correct(
                    images,
                    ranges,
                    self.root / "other",
                    options=self.options(overwrite, water=self.out / own),
                )
            )

        @rule(own=st.sampled_from(("", *OWN)))
        def fused(self, own: str) -> None:
            poses = self.given(own, self.dives[0] / "poses.tum")
            self.attempt(lambda: fuse(self.out, poses), poses)

        @rule(own=st.sampled_from(("", *OWN)))
        def water(self, own: str) -> None:
            poses = self.given(own, self.dives[0] / "poses.tum")
            self.attempt(lambda: measure_water(self.out, poses), poses)

        @rule(overwrite=OVERWRITE, into=st.sampled_from(("merged", "out")))
        def merged(self, overwrite: bool, into: str) -> None:
            part = [
                path
                for path in self.out.rglob("*")
                if path.is_file() and into == "out" and ".state" not in path.parts
            ]
            self.attempt(
                lambda: merge([self.out], self.root / into, self.options(overwrite)), *part
            )

        @rule(
            what=st.sampled_from(("report", "plan", "export", "metrics")),
            place=st.sampled_from(("new", "out", "out/map", "monday")),
        )
        def others(self, what: str, place: str) -> None:
            left, right, calib = (self.dives[0] / name for name in ("L", "R", "cam.yaml"))
            commands = {
                "report": lambda: report(self.out),
                "plan": lambda: plan(left, right, calib, out=self.root / place),
                "export": lambda: export(self.out, "kwiver", self.root / place),
                "metrics": lambda: metrics(self.out, None, self.root / place),
            }
            self.attempt(commands[what])

        @rule(
            what=st.sampled_from(
                ("compare", "markers", "charts", "calibrate", "convert", "mcap", "log", "live")
            ),
            place=st.sampled_from(WRITTEN),
            overwrite=OVERWRITE,
        )
        def one_file_or_folder(self, what: str, place: str, overwrite: bool) -> None:
            dive, path = self.dives[0], self.root / place
            left, right, calib = (dive / name for name in ("L", "R", "cam.yaml"))
            targets = self.root / "targets.json"
            targets.write_text(json.dumps({"0000": [{"polygon": CORNERS}]}))

            def record() -> None:
                check_mcap(path, overwrite, None)
                write_mcap(self.out, path)

            def logged() -> None:
                with logging_to(path, verbose=False):
                    report(self.out)

            inputs = LiveInputs(left, right, calib=calib)
            commands = {
                "compare": lambda: compare(self.out, self.root / "merged", path),
                "markers": lambda: markers(self.out, Known(0.2), path),
                "charts": lambda: evaluate_charts(left, self.out / "range", targets, sheet=path),
                "calibrate": lambda: calibrate(left, right, "chessboard:4x3:20mm", path),
                "convert": lambda: convert_calib(
                    str(calib), path, "ros" if overwrite else "native"
                ),
                "mcap": record,
                "log": logged,
                "live": lambda: live(inputs, options=kept),
            }
            filled = path.is_dir() and any(path.iterdir())
            kept = LiveOptions(pairs=1, **{"out" if filled else "record": path})
            if what != "live" or filled or path.is_file():  # else it waits for pairs that arrive
                self.attempt(commands[what])

        @rule(name=st.sampled_from(("out", "monday")), own=st.sampled_from(("", *OWN)))
        def campaign(self, name: str, own: str) -> None:
            dive = {
                "name": name,
                "left": "tuesday/L",
                "right": "tuesday/R",
                "calib": "tuesday/cam.yaml",
            }
            file = self.root / "campaign.yaml"
            file.write_text(
                json.dumps({"out": ".", "dives": [dive | ({"water": f"out/{own}"} if own else {})]})
            )
            self.user_changed_files()
            self.mine.add((file, file.read_bytes()))
            self.attempt(
                lambda: campaign(file, self.options(False)), *([self.out / own] if own else [])
            )

        @rule(place=st.sampled_from(PLACES))
        def the_user_puts_a_file(self, place: str) -> None:
            path = self.out / place
            if (
                self.out.exists()
                and not path.exists()
                and all(not above.is_file() for above in path.parents)
            ):
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(
                    POSES if path.suffix == ".tum" else f"three years of field notes: {place}"
                )
                self.mine.add((path, path.read_bytes()))

        @rule(number=st.integers(0, 10**6), same_time=st.booleans())
        def the_user_edits_a_result(self, number: int, same_time: bool) -> None:
            # logs are added to, and recordings replaced with --overwrite
            results = sorted(
                path
                for path in files(self.out)
                if ".state" not in path.parts and "page" not in path.parts
            )
            results = [path for path in results if path.name not in ("run.log", "new")]
            results = [path for path in results if path.stat().st_size]
            if not results:
                return
            path = results[number % len(results)]
            status, content = path.stat(), bytearray(path.read_bytes())
            # two edits differ from what was written, too
            content[len(content) // 2] = (content[len(content) // 2] + 1) % 256
            path.unlink() if status.st_nlink > 1 else None  # a merged folder shares its files
            path.write_bytes(content)
            os.utime(
                path,
                ns=(
                    status.st_atime_ns,
                    status.st_mtime_ns if same_time else status.st_mtime_ns + 10**9,
                ),
            )
            self.user_changed_files()
            self.mine.add((path, bytes(content)))

        @rule(
            number=st.integers(0, 10**6),
            hostile=st.sampled_from(
                ("../monday/L/0000.png", "../notes.txt", "notes.txt", "poses.tum")
            ),
        )
        def a_record_names_a_file_of_the_users(self, number: int, hostile: str) -> None:
            records = sorted((self.out / ".state").glob("**/*.json"))
            victim = self.out / hostile
            if not records or not victim.is_file():
                return
            record = records[number % len(records)]
            with suppress(ValueError):  # a command before wrote something else into its place
                content = json.loads(record.read_bytes())
                if isinstance(content, dict) and "files" in content:
                    content["files"][hostile] = [asdict(Stamp.of(victim))]
                    record.write_text(json.dumps(content))

        @rule()
        def the_user_begins_anew(self) -> None:
            shutil.rmtree(self.out, ignore_errors=True)
            self.user_changed_files()

        @invariant()
        def nothing_of_the_users_is_lost(self) -> None:
            Attack.steps += 1
            for path, content in getattr(self, "mine", ()):
                assert self.is_kept(path, content), f"lost: {path}"

        def teardown(self) -> None:
            shutil.rmtree(getattr(self, "root", "/nonexistent"), ignore_errors=True)

    return Attack


@pytest.mark.slow
@pytest.mark.timeout(600 + 90 * MINUTES)
def test_no_sequence_of_commands_and_accidents_loses_a_file_of_the_users(
    make_dive: Callable[..., Dive], tmp_path: Path
) -> None:
    one = make_dive(3)
    one.root.rename(tmp_path / "one")
    attack = machine((replace(one, root=tmp_path / "one"), make_dive(3, seed=5)))
    slow = settings(
        deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
    )
    end_s, round_seed = time.monotonic() + 60 * MINUTES, SEED
    while time.monotonic() < end_s:
        print(f"seed {round_seed}, {attack.steps} steps done", flush=True)
        run_state_machine_as_test(
            seed(round_seed)(attack),
            settings=settings(slow, max_examples=10, stateful_step_count=20, database=None),
        )
        round_seed += 1
    if not MINUTES:
        run_state_machine_as_test(
            attack,
            settings=settings(slow, max_examples=3, stateful_step_count=12, derandomize=True),
        )
