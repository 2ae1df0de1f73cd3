"""``campaign``: many dives, one after the other; what is wrong with one does not end the others."""

import json
import logging
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from calibration import CalibrationError
from stereo_seecolor.commands.campaign_records import write_records
from stereo_seecolor.commands.campaign_table import TABLE, DiveState, State, load_states, save_states
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.report import report
from stereo_seecolor.commands.run import run
from stereo_seecolor.commands.site_water import SiteDive, fit_site
from stereo_seecolor.commands.stereo_inputs import StereoInputs
from stereo_seecolor.config import RunConfig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import InputError, SeeColorError
from stereo_seecolor.files.reading import read_bytes

WATERS = "waters"

log = logging.getLogger(__name__)


class DiveEntry(BaseModel):
    """A dive of a campaign, in the words of ``run``. Paths start from the campaign's file. poses, fuse: a map is made, too.

    site: dives of one site share one water.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(pattern=r"^\w[\w.-]*$")
    left: Path
    right: Path
    calib: str
    poses: Path | None = None
    fuse: bool = False
    water: Path | None = None
    site: str = ""
    settings: dict[str, Any] = {}

    @model_validator(mode="after")
    def _one_water(self) -> Self:
        if self.water and self.site:
            raise ValueError(f"dive {self.name!r} has a water, and shares that of site {self.site!r}: give one of both")
        return self


class CampaignFile(BaseModel):
    """A campaign. out: each dive gets a folder of its name in it. config, settings: of all dives; a dive's own settings win."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    out: Path
    config: Path | None = None
    settings: dict[str, Any] = {}
    dives: tuple[DiveEntry, ...] = Field(min_length=1)

    @classmethod
    def read(cls, path: Path) -> "CampaignFile":
        """Raises InputError."""
        try:
            campaign = cls.model_validate(yaml.safe_load(read_bytes(path)))
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise InputError(f"{path}: is no YAML: {' '.join(str(error).split())}") from error
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"])) or "the file"
            raise InputError(f"{path}: {where}: {first['msg']} (docs/fleets.md shows a campaign)") from error
        names = [dive.name for dive in campaign.dives]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice:
            raise InputError(f"{path}: two dives are called {twice!r}: give each a name of its own")
        return campaign


@dataclass(frozen=True)
class CampaignResult:
    """Every dive, in the file's order. table: the same as CSV."""

    dives: tuple[DiveState, ...]
    table: Path

    @property
    def all_done(self) -> bool:
        """True if every pair of every dive went through."""
        return all(dive.state == "done" for dive in self.dives)


def campaign(file: Path, options: RunOptions | None = None, *, only_failed: bool = False) -> CampaignResult:
    """Run every dive of a campaign's file; each is resumed where it stopped. only_failed: skip those that are done.

    Raises InputError for a file that cannot be used, OutputError where the table cannot be written.
    """
    content, options = CampaignFile.read(file), options or RunOptions()
    root = file.parent / content.out
    earlier = load_states(root)
    begun = {dive.name: earlier.get(dive.name) or DiveState(dive.name, "not begun") for dive in content.dives}
    states = {**begun, **earlier}
    save_states(root, states)
    for state in _states(file, content, options, earlier if only_failed else {}):
        states[state.name] = state
        save_states(root, states)
    found = tuple(states[name] for name in begun)
    if all(state.state != "stopped" for state in found):
        write_records(root, {state.name: Path(state.out) for state in found if state.ok})
    return CampaignResult(found, root / TABLE)


def _states(file: Path, content: CampaignFile, options: RunOptions, known: Mapping[str, DiveState]) -> Iterator[DiveState]:
    """Of each dive when it is through, until one is stopped. known: their outcomes; those that are done are skipped."""
    waters = _SiteWaters(file, content, options, keep=bool(known))
    for dive in content.dives:
        if dive.name in known and known[dive.name].state == "done":
            yield known[dive.name]
            continue
        if waters.fit_for(dive):
            yield DiveState(dive.name, "stopped", out=str(_out(file, content, dive)), error=f"while site {dive.site} was measured")
            return
        state = _dive(file, content, waters.given(dive), options)
        yield state
        if state.state == "stopped":
            return


class _SiteWaters:
    """The waters of the sites, each fitted before the first of its dives. keep: those that are there stay as they are."""

    def __init__(self, file: Path, content: CampaignFile, options: RunOptions, keep: bool) -> None:
        self._file, self._content, self._options, self._keep = file, content, options, keep
        self._fitted: set[str] = set()

    def _water(self, dive: DiveEntry) -> Path:
        return self._content.out / WATERS / f"{dive.name}.json"

    def _dives(self, site: str) -> list[DiveEntry]:
        return [dive for dive in self._content.dives if dive.site == site]

    def _stays(self, site: str) -> bool:
        return self._keep and all((self._file.parent / self._water(dive)).exists() for dive in self._dives(site))

    def given(self, dive: DiveEntry) -> DiveEntry:
        """The dive with the file of its site's water, where that could be fitted: else its run says why not."""
        there = dive.site and (self._file.parent / self._water(dive)).exists()
        return dive.model_copy(update={"water": self._water(dive)}) if there else dive

    def fit_for(self, dive: DiveEntry) -> bool:
        """Fit the water of the dive's site, unless that was done. True if it was stopped."""
        if not dive.site or dive.site in self._fitted or self._stays(dive.site):
            return False
        self._fitted.add(dive.site)
        root, folder = self._file.parent / self._content.out, self._file.parent

        def site_dive(one: DiveEntry) -> SiteDive:
            return SiteDive(_inputs(folder, one), root / one.name, _config(folder, self._content, one), folder / self._water(one))

        try:
            return fit_site([site_dive(one) for one in self._dives(dive.site)], self._options)
        except KeyboardInterrupt:  # between two passes
            return True
        except (SeeColorError, CalibrationError) as error:
            log.error("site %s: %s", dive.site, error)
            return False


def _out(file: Path, content: CampaignFile, dive: DiveEntry) -> Path:
    return file.parent / content.out / dive.name


def _inputs(folder: Path, dive: DiveEntry) -> StereoInputs:
    calib = ",".join(str(folder / part) for part in dive.calib.split(","))
    return StereoInputs(folder / dive.left, folder / dive.right, calib)


def _dive(file: Path, content: CampaignFile, dive: DiveEntry, options: RunOptions) -> DiveState:
    start_s, out = time.monotonic(), _out(file, content, dive)
    log.info("%s: begins", dive.name)
    state = DiveState(dive.name, "failed", out=str(out))
    try:
        config = _config(file.parent, content, dive)
        state = _run(file.parent, dive, config, options, state)
        if (dive.fuse or dive.poses) and state.state != "stopped":
            _map(file.parent, dive, config, options, out)
    except KeyboardInterrupt:  # between two passes, or in the map
        state = replace(state, state="stopped")
    except (SeeColorError, CalibrationError) as error:
        log.error("%s: %s", dive.name, error)
        state = replace(state, state="failed", error=str(error))
    except Exception as error:  # a defect of this program must not cost the dives that follow
        log.exception("%s: failed", dive.name)
        message = f"{type(error).__name__}: {error} (a defect of this program: the log holds more)"
        state = replace(state, state="failed", error=message)
    return replace(state, seconds=round(time.monotonic() - start_s, 3))


def _run(folder: Path, dive: DiveEntry, config: RunConfig, options: RunOptions, state: DiveState) -> DiveState:
    water = folder / dive.water if dive.water else None
    inputs, out = _inputs(folder, dive), Path(state.out)
    options = replace(options, water=water, page="none" if dive.fuse or dive.poses else options.page)  # the map is on it
    summary = run(inputs.left, inputs.right, inputs.calib, out, config, options)
    done: State = "stopped" if summary.stopped else "done" if summary.all_done else "some pairs failed"
    return replace(state, state=done, ok=summary.count("ok"), failed=summary.count("failed"))


def _map(folder: Path, dive: DiveEntry, config: RunConfig, options: RunOptions, out: Path) -> None:
    fuse(out, folder / dive.poses if dive.poses else None, config, options.listener, options.cluster)
    report(out, options.listener, brief=True)


def _config(folder: Path, content: CampaignFile, dive: DiveEntry) -> RunConfig:
    settings = {**content.settings, **dive.settings}
    return load_config(folder / content.config if content.config else None, [f"{key}={_text(settings[key])}" for key in settings])


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
