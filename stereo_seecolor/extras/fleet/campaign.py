"""``campaign``: many dives, one after the other; an error in one does not end the others."""

import json
import logging
import time
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from calibration import CalibrationError
from calibration.errors import counted
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.report import report
from stereo_seecolor.commands.run import run
from stereo_seecolor.commands.stereo_inputs import StereoInputs
from stereo_seecolor.config import RunConfig
from stereo_seecolor.config.file import load_config
from stereo_seecolor.dive.run_options import RunOptions
from stereo_seecolor.errors import ConfigError, InputError, SeeColorError
from stereo_seecolor.extras.fleet.campaign_files import refuse_files_of_others
from stereo_seecolor.extras.fleet.campaign_records import COLLECTION, RECORDS, write_records
from stereo_seecolor.extras.fleet.campaign_states import (
    STATES,
    TABLE,
    DiveState,
    load_states,
    save_states,
)
from stereo_seecolor.extras.fleet.site_water import SiteDive, fit_site
from stereo_seecolor.files.keys import content_key
from stereo_seecolor.files.text_documents import read_yaml
from stereo_seecolor.run_folder.frame_table import RunSummary
from stereo_seecolor.run_folder.layout import RUN

WATERS = "waters"
RESERVED = {WATERS, RECORDS, TABLE, STATES, Path(COLLECTION).stem}
"""Names of the campaign's own files and folders in ``out``, and of a record."""

SAID = {
    "string_type": "is not text: write it in quotes",
    "string_pattern_mismatch": "a name has only letters, digits, _, - and ., and begins with a "
    "letter or digit",
    "too_short": "lists no dive",
    "tuple_type": "is not a list: begin each dive with a -",
    **dict.fromkeys(("model_type", "dict_type"), "holds no lines of the form key: value"),
}
"""Of pydantic's kinds of errors, those that its words explain badly."""

log = logging.getLogger(__name__)


class DiveEntry(BaseModel):
    """A dive of a campaign; fields are named as the options of ``run``. Paths are relative to the
    campaign's file.

    poses, fuse: with either a map is made. site: dives of one site share one water.
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
            raise ValueError(
                f"dive {self.name!r} has its own water and a site, {self.site!r}, whose water it "
                "would share: give only one"
            )
        return self


class CampaignFile(BaseModel):
    """The file of a campaign. out: holds a folder for each dive. config, settings: of all dives; a
    dive's own settings win.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    out: Path
    config: Path | None = None
    settings: dict[str, Any] = {}
    dives: tuple[DiveEntry, ...] = Field(min_length=1)

    @classmethod
    def read(cls, path: Path) -> "CampaignFile":
        """Read a YAML file. Raises InputError where it cannot be read or is not a campaign."""
        try:
            campaign = cls.model_validate(read_yaml(path))
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(map(str, first["loc"])) or "the file"
            said = SAID.get(first["type"], first["msg"])
            raise InputError(
                f"{path}: {where}: {said} (docs/fleets.md shows a campaign)"
            ) from error
        names = [dive.name for dive in campaign.dives]
        # disks of macOS and Windows know no upper case, and one spelling of an accent
        folders = [unicodedata.normalize("NFC", name).casefold() for name in names]
        twice = next((name for name in folders if folders.count(name) > 1), None)
        if twice:
            same = names[folders.index(twice)]
            raise InputError(
                f"{path}: two dives have the name {same!r}, upper and lower case being alike: give "
                "each another name"
            )
        taken = next((name for name in names if name.casefold() in RESERVED), None)
        if taken:
            raise InputError(
                f"{path}: a dive has the name {taken!r} of a file or folder of the campaign: "
                "give it another name"
            )
        return campaign


@dataclass(frozen=True)
class CampaignResult:
    """The outcome of every dive, in the file's order. table: the CSV file with the same."""

    dives: tuple[DiveState, ...]
    table: Path

    @property
    def all_done(self) -> bool:
        """True if every pair of every dive went through."""
        return all(dive.state == "done" for dive in self.dives)


def campaign(
    file: Path, options: RunOptions | None = None, *, only_failed: bool = False
) -> CampaignResult:
    """Run every dive of a campaign's file; each is resumed where it stopped. only_failed: skip
    those that are done.

    Raises InputError for a file that cannot be used, ConfigError for settings of any dive, before
    the first is run; OutputError where the table cannot be written.
    """
    plan = _Campaign(CampaignFile.read(file), file.parent)
    options = replace(options or RunOptions(), also_read=(file,))
    for dive in plan.dives:
        try:
            plan.config(dive)
        except ConfigError as error:
            raise ConfigError(f"{file}: dive {dive.name!r}: {error}") from error
    refuse_files_of_others(plan.root, plan.files)
    earlier = load_states(plan.root)
    begun = {
        dive.name: earlier.get(dive.name) or DiveState(dive.name, "not begun")
        for dive in plan.dives
    }
    states = {**begun, **earlier}
    save_states(plan.root, states)
    for state in _states(plan, options, earlier if only_failed else {}):
        states[state.name] = state
        save_states(plan.root, states)
    found = tuple(states[dive.name] for dive in plan.dives)
    if all(state.state != "stopped" for state in found):
        write_records(plan.root, {state.name: Path(state.out) for state in found if state.ok})
    return CampaignResult(found, plan.root / TABLE)


@dataclass(frozen=True)
class _Campaign:
    """A campaign's file with paths and settings resolved. folder: where its paths start."""

    content: CampaignFile
    folder: Path

    @property
    def root(self) -> Path:
        return self.folder / self.content.out

    @property
    def dives(self) -> tuple[DiveEntry, ...]:
        return self.content.dives

    def out(self, dive: DiveEntry) -> Path:
        return self.root / dive.name

    @property
    def files(self) -> list[Path]:
        """All that the campaign writes beside the folders of its dives."""
        records = [
            f"{dive.name}{ending}" for dive in self.dives for ending in (".json", ".ifdo.yaml")
        ]
        waters = [self.site_water(dive) for dive in self.dives if dive.site]
        return [
            self.root / TABLE,
            self.root / STATES,
            *(self.root / RECORDS / name for name in (COLLECTION, *records)),
            *waters,
        ]

    def inputs(self, dive: DiveEntry) -> StereoInputs:
        calib = ",".join(str(self.folder / part) for part in dive.calib.split(","))
        return StereoInputs(self.folder / dive.left, self.folder / dive.right, calib)

    def config(self, dive: DiveEntry) -> RunConfig:
        """The settings of a dive. Raises ConfigError."""
        shared, settings = self.content.config, {**self.content.settings, **dive.settings}
        return load_config(
            self.folder / shared if shared else None,
            [f"{key}={_text(settings[key])}" for key in settings],
        )

    def asked(self, dive: DiveEntry) -> str:
        """Hash of what the campaign's file asks of a dive."""
        shared, settings = self.content.config, self.content.settings
        file = self.folder / shared if shared else None
        text = file.read_bytes() if file and file.is_file() else b""
        return content_key(dive.model_dump_json(), json.dumps(settings), text)

    def site_water(self, dive: DiveEntry) -> Path:
        """The file for the water of a dive's site, as this dive's exposure shows it."""
        return self.root / WATERS / f"{dive.name}.json"


def _states(
    plan: _Campaign, options: RunOptions, known: Mapping[str, DiveState]
) -> Iterator[DiveState]:
    """The outcome of each dive when it has ended, until one is stopped. known: earlier outcomes;
    dives done then are skipped, unless their results are gone.
    """
    waters = _SiteWaters(plan, options, keep=bool(known))
    for dive in plan.dives:
        earlier, out = known.get(dive.name), plan.out(dive)
        asked = plan.asked(dive)
        is_done = earlier and earlier.state == "done" and earlier.asked in ("", asked)
        if earlier and is_done and (out / RUN).is_file():
            yield replace(earlier, out=str(out))
            continue
        if waters.fit_for(dive):
            yield DiveState(
                dive.name,
                "stopped",
                out=str(plan.out(dive)),
                error=f"while site {dive.site} was measured",
            )
            return
        water = waters.of(dive)
        state = replace(_process(plan, dive, water, options), asked=asked)
        if dive.site and water is None and state.ok:
            problem = f"site {dive.site} has no water (see the log): the dive's own was used"
            state = _with_problems(state, (problem,))
        yield state
        if state.state == "stopped":
            return


class _SiteWaters:
    """Fits the water of each site before its first dive. keep: waters that exist are kept."""

    def __init__(self, plan: _Campaign, options: RunOptions, keep: bool) -> None:
        self._plan, self._options, self._keep = plan, options, keep
        self._fitted: set[str] = set()

    def of(self, dive: DiveEntry) -> Path | None:
        """The file of a dive's water: its own, or its site's if that could be fitted; else None."""
        site_water = self._plan.site_water(dive)
        if dive.site and site_water.exists():
            return site_water
        return self._plan.folder / dive.water if dive.water else None

    def fit_for(self, dive: DiveEntry) -> bool:
        """Fit the water of the dive's site, unless that was done. True if it was stopped."""
        if not dive.site or dive.site in self._fitted:
            return False
        plan, site = self._plan, [one for one in self._plan.dives if one.site == dive.site]
        if self._keep and all(plan.site_water(one).exists() for one in site):
            return False
        self._fitted.add(dive.site)
        try:
            dives = [
                SiteDive(plan.inputs(one), plan.out(one), plan.config(one), plan.site_water(one))
                for one in site
            ]
            return fit_site(dives, self._options)
        except KeyboardInterrupt:  # between two passes
            return True
        except (SeeColorError, CalibrationError) as error:
            log.error("site %s: %s", dive.site, error)
            return False


def _process(
    plan: _Campaign, dive: DiveEntry, water: Path | None, options: RunOptions
) -> DiveState:
    """Run a dive, and its map where asked for; returns the outcome, also of a failed one."""
    start_s, out = time.monotonic(), plan.out(dive)
    log.info("%s: begins", dive.name)
    state, mapped = DiveState(dive.name, "failed", out=str(out)), bool(dive.fuse or dive.poses)
    try:
        config = plan.config(dive)
        page = "none" if mapped else options.page  # the page is written when the map is there
        inputs, poses = plan.inputs(dive), plan.folder / dive.poses if dive.poses else None
        chosen = replace(
            options,
            water=water,
            page=page,
            also_read=(*options.also_read, *([poses] if poses else [])),
        )
        summary = run(inputs.left, inputs.right, inputs.calib, out, config, chosen)
        state = _outcome(state, summary)
        if mapped and not summary.stopped:
            made = fuse(out, poses, config, options.listener, options.cluster)
            state = _with_problems(state, made.problems)
            report(out, options.listener)
    except KeyboardInterrupt:  # between two passes, or in the map
        state = replace(state, state="stopped")
    except (SeeColorError, CalibrationError) as error:
        log.error("%s: %s", dive.name, error)
        state = replace(state, state="failed", error=str(error))
    except Exception as error:  # a defect of this program must not cost the dives that follow
        log.exception("%s: failed", dive.name)
        message = f"{type(error).__name__}: {error} (a bug in this program: see the log)"
        state = replace(state, state="failed", error=message)
    return replace(state, seconds=round(time.monotonic() - start_s, 3))


def _outcome(state: DiveState, summary: RunSummary) -> DiveState:
    ok, failed, unpaired = (summary.count(status) for status in ("ok", "failed", "unpaired"))
    ended = replace(state, state="stopped" if summary.stopped else "done", ok=ok, failed=failed)
    if failed or unpaired:
        ended = replace(ended, state=ended.state if summary.stopped else "some pairs failed")
    alone = (f"{counted(unpaired, 'file')} without a partner",) if unpaired else ()
    wrong = (f"{numbers} are wrong, as its notes say" for numbers in sorted(summary.wrong))
    return _with_problems(ended, (*alone, *wrong))


def _with_problems(state: DiveState, problems: tuple[str, ...]) -> DiveState:
    """The outcome of a dive with more problems: one that was done is not."""
    return replace(
        state,
        state="problems" if problems and state.state == "done" else state.state,
        error="; ".join([*filter(None, [state.error]), *problems]),
    )


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
