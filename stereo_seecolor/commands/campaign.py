"""``campaign``: many dives, one after the other; what is wrong with one does not end the others."""

import csv
import io
import json
import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal, Self

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from calibration import CalibrationError
from stereo_seecolor.commands.campaign_records import write_records
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.over_pairs import StereoInputs
from stereo_seecolor.commands.run import run
from stereo_seecolor.commands.site_water import SiteDive, fit_site
from stereo_seecolor.config import RunConfig
from stereo_seecolor.config_file import load_config
from stereo_seecolor.errors import InputError, SeeColorError
from stereo_seecolor.files.atomic import write_atomic
from stereo_seecolor.files.reading import read_bytes
from stereo_seecolor.progress import RunOptions

TABLE, STATES, WATERS = "campaign.csv", "campaign.json", "waters"
State = Literal["done", "some pairs failed", "failed", "stopped"]

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
class DiveState:
    """What became of a dive. ok, failed: pairs. error: why it failed as a whole."""

    name: str
    state: State
    ok: int
    failed: int
    seconds: float
    out: str
    error: str = ""


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
    earlier = _load(root)
    states: dict[str, DiveState] = {}
    for dive in _with_site_waters(file, content, options, keep=only_failed):
        known = earlier.get(dive.name)
        states[dive.name] = known if only_failed and known and known.state == "done" else _dive(file, content, dive, options)
        _save(root, {**earlier, **states})
        if states[dive.name].state == "stopped":
            break
    write_records(root, {name: Path(state.out) for name, state in states.items() if state.ok})
    return CampaignResult(tuple(states.values()), root / TABLE)


def _with_site_waters(file: Path, content: CampaignFile, options: RunOptions, keep: bool) -> Iterator[DiveEntry]:
    """All dives, those of a site with the file of its water, which is fitted before the first of them. keep: one that is there.

    Where it cannot be fitted, the dives are run to say why.
    """
    waters = content.out / WATERS
    fitted: set[str] = set()
    for dive in content.dives:
        if dive.site and dive.site not in fitted:
            fitted.add(dive.site)
            others = [other for other in content.dives if other.site == dive.site]
            if not (keep and all((file.parent / waters / f"{other.name}.json").exists() for other in others)):
                _fit(file, content, others, options)
        there = dive.site and (file.parent / waters / f"{dive.name}.json").exists()
        yield dive.model_copy(update={"water": waters / f"{dive.name}.json"}) if there else dive


def _fit(file: Path, content: CampaignFile, dives: Sequence[DiveEntry], options: RunOptions) -> None:
    root = file.parent / content.out

    def site_dive(dive: DiveEntry) -> SiteDive:
        config, water = _config(file.parent, content, dive), root / WATERS / f"{dive.name}.json"
        return SiteDive(_inputs(file.parent, dive), root / dive.name, config, water)

    try:
        if fit_site([site_dive(dive) for dive in dives], options):
            raise KeyboardInterrupt
    except (SeeColorError, CalibrationError) as error:
        log.error("site %s: %s", dives[0].site, error)


def _inputs(folder: Path, dive: DiveEntry) -> StereoInputs:
    calib = ",".join(str(folder / part) for part in dive.calib.split(","))
    return StereoInputs(folder / dive.left, folder / dive.right, calib)


def _dive(file: Path, content: CampaignFile, dive: DiveEntry, options: RunOptions) -> DiveState:
    start_s, out = time.monotonic(), file.parent / content.out / dive.name
    log.info("%s: begins", dive.name)
    state = DiveState(dive.name, "failed", 0, 0, 0.0, str(out))
    try:
        state = _run(file.parent, dive, out, _config(file.parent, content, dive), options, state)
    except (SeeColorError, CalibrationError) as error:
        log.error("%s: %s", dive.name, error)
        state = replace(state, error=str(error))
    except Exception as error:  # a defect of this program must not cost the dives that follow
        log.exception("%s: failed", dive.name)
        state = replace(state, error=f"{type(error).__name__}: {error} (a defect of this program: the log holds more)")
    return replace(state, seconds=round(time.monotonic() - start_s, 3))


def _run(folder: Path, dive: DiveEntry, out: Path, config: RunConfig, options: RunOptions, state: DiveState) -> DiveState:
    water = folder / dive.water if dive.water else None
    inputs = _inputs(folder, dive)
    summary = run(inputs.left, inputs.right, inputs.calib, out, config, replace(options, water=water))
    done: State = "stopped" if summary.stopped else "done" if summary.all_done else "some pairs failed"
    state = replace(state, state=done, ok=summary.count("ok"), failed=summary.count("failed"))
    if (dive.fuse or dive.poses) and not summary.stopped:
        fuse(out, folder / dive.poses if dive.poses else None, config, options.listener, options.cluster)
    return state


def _config(folder: Path, content: CampaignFile, dive: DiveEntry) -> RunConfig:
    settings = {**content.settings, **dive.settings}
    return load_config(folder / content.config if content.config else None, [f"{key}={_text(settings[key])}" for key in settings])


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _load(root: Path) -> dict[str, DiveState]:
    """What became of the dives so far; none where nothing was kept, or it is damaged."""
    try:
        return {name: DiveState(**state) for name, state in json.loads((root / STATES).read_bytes()).items()}
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


def _save(root: Path, states: Mapping[str, DiveState]) -> None:
    write_atomic(root / STATES, json.dumps({name: asdict(state) for name, state in states.items()}, indent=1).encode())
    text = io.StringIO()
    table = csv.DictWriter(text, [field.name for field in fields(DiveState)], lineterminator="\n")
    table.writeheader()
    table.writerows(asdict(state) for state in states.values())
    write_atomic(root / TABLE, text.getvalue().encode())
