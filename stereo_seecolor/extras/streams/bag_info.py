"""The topics of a bag, and the pairs that ``run`` would take from it."""

from dataclasses import dataclass
from pathlib import Path

from calibration import CalibrationError
from stereo_seecolor.commands.rig_loading import load_rig_for
from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.bag_inputs import rig_of_bag
from stereo_seecolor.extras.streams.bags.bag import Bag, open_bag
from stereo_seecolor.extras.streams.bags.dive import BagDive, open_dive


@dataclass(frozen=True)
class TopicFacts:
    """A topic. rate_hz: messages a second, None for fewer than two."""

    name: str
    type: str
    messages: int
    rate_hz: float | None


@dataclass(frozen=True)
class BagFacts:
    """The contents of a bag. seconds: from first to last message. left, right: topics that ``run``
    takes, "" where none were found.

    baseline_m: of the rig by its camera_info, None where they give none. notes: remarks and
    problems, a line each.
    """

    bag: Path
    files: int
    seconds: float
    topics: tuple[TopicFacts, ...]
    left: str
    right: str
    pairs: int
    unpaired: int
    baseline_m: float | None
    notes: tuple[str, ...]


def bag_info(
    path: Path, topics: str = "", config: InputConfig | None = None, calib: str = ""
) -> BagFacts:
    """Examine a bag; nothing is written. topics: ``left=NAME,right=NAME``, "" to find them. calib:
    the calibration of the rig, "" for that of the bag.

    Raises InputError if it is not a bag, or holds nothing that can be read; DeviceError if a
    library is missing; CalibrationError for calib.
    """
    config = config or InputConfig()
    try:
        dive = open_dive(path, topics, config)
    except InputError as error:
        bag = open_bag(path)
        if topics:
            raise
        return _facts(bag, None, None, (*bag.problems, str(error)))
    if calib:
        rig = load_rig_for(calib, dive.pairing.pairs, config)
        return _facts(dive.bag, dive, rig.baseline_m, dive.pairing.notes)
    baseline_m, problem = _baseline_m(dive, config)
    return _facts(
        dive.bag, dive, baseline_m, (*dive.pairing.notes, *dive.static_baseline[1], *problem)
    )


def _baseline_m(dive: BagDive, config: InputConfig) -> tuple[float | None, tuple[str, ...]]:
    try:
        return rig_of_bag(dive, config).baseline_m, ()
    except (InputError, CalibrationError) as error:
        return None, (str(error),)


def _facts(
    bag: Bag, dive: BagDive | None, baseline_m: float | None, notes: tuple[str, ...]
) -> BagFacts:
    first_ns, last_ns = (
        min(topic.first_ns for topic in bag.topics),
        max(topic.last_ns for topic in bag.topics),
    )
    return BagFacts(
        bag=bag.path,
        files=len(bag.files),
        seconds=(last_ns - first_ns) / 1e9,
        topics=tuple(
            TopicFacts(topic.name, topic.msgtype, topic.count, topic.rate_hz)
            for topic in bag.topics
        ),
        left=dive.sides.left.name if dive else "",
        right=dive.sides.right.name if dive else "",
        pairs=len(dive.pairing.pairs) if dive else 0,
        unpaired=len(dive.pairing.unpaired) if dive else 0,
        baseline_m=baseline_m,
        notes=notes,
    )
