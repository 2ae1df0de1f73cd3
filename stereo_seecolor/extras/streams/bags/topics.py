"""Choice of a bag's topics of the left and the right camera, and of their calibrations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

from stereo_seecolor.errors import InputError
from stereo_seecolor.extras.streams.bags.bag import CAMERA_INFO, IMAGES, VIDEOS, Bag, Topic
from stereo_seecolor.inputs.name_keys import side_of

NOT_PICTURES = ("depth", "disparity", "mask", "range", "confidence", "thumbnail")
"""Topics with one of these words hold no pictures of a camera."""

TRANSPORTS = (
    "compressed",
    "compressedDepth",
    "image_raw",
    "image_color",
    "image_mono",
    "image",
    "image_rect",
    "image_rect_color",
    "ffmpeg",
    "foxglove",
    "compressed_video",
    "h264",
    "h265",
)
"""Last parts of an image topic's name that do not belong to its camera's."""


@dataclass(frozen=True)
class SideTopics:
    """The two image topics of a dive. guessed: no name says which side is which. others: left
    topics of other rigs.
    """

    left: Topic
    right: Topic
    guessed: bool = False
    others: tuple[str, ...] = ()


def side_topics(bag: Bag, given: Mapping[str, str]) -> SideTopics:
    """The topics that are ``given`` by side, else those that differ in nothing but a word for the
    side, else the only two.

    Raises InputError, with the image topics that there are.
    """
    images = [topic for topic in bag.topics if topic.msgtype in (*IMAGES, *VIDEOS)]
    if given:
        left, right = (_named(bag, images, given, side) for side in ("left", "right"))
        return SideTopics(left, right)
    pictures = [
        topic for topic in images if not any(word in topic.name.lower() for word in NOT_PICTURES)
    ]
    both = [pair for pair in permutations(pictures, 2) if _are_sides(*pair)]
    if both:
        left, right = max(both, key=lambda pair: (_has_info(bag, *pair), *_preference(*pair)))
        rigs = {tuple(_camera(one.name)): one.name for one, _ in reversed(both)}
        rigs.pop(tuple(_camera(left.name)))
        return SideTopics(left, right, others=tuple(sorted(rigs.values())))
    if len(pictures) == 2:
        return SideTopics(pictures[0], pictures[1], guessed=True)
    raise InputError(
        f"{bag.path}: no two of its image topics are named left and right{_listed(images)}: give "
        "--topics left=NAME,right=NAME"
    )


def parse_topics(text: str) -> dict[str, str]:
    """``left=NAME,right=NAME`` by side, {} for an empty text. Raises InputError."""
    found = dict(part.split("=", 1) for part in text.split(",") if "=" in part)
    if text and (
        found.keys() != {"left", "right"}
        or not all(found.values())
        or found["left"] == found["right"]
    ):
        raise InputError(
            f"--topics {text}: cannot be parsed; write --topics "
            "left=/camera/left/image_raw,right=/camera/right/image_raw"
        )
    return found


def info_topic(bag: Bag, image: Topic) -> Topic | None:
    """The camera_info of an image topic: the one beside it, or of the most similar name."""
    infos = [topic for topic in bag.topics if topic.msgtype == CAMERA_INFO and topic.entries]
    camera = _camera(image.name)
    beside = [topic for topic in infos if topic.name.split("/")[:-1] == camera]
    if beside:
        return beside[0]
    side = side_of(" ".join(camera))
    of_side = [
        topic for topic in infos if side and side_of(" ".join(topic.name.split("/"))) == side
    ]
    return max(
        of_side,
        key=lambda topic: sum(part in camera for part in topic.name.split("/")),
        default=None,
    )


def _has_info(bag: Bag, left: Topic, right: Topic) -> bool:
    """Whether both have a camera_info of their own beside them."""
    beside = {
        tuple(topic.name.split("/")[:-1])
        for topic in bag.topics
        if topic.msgtype == CAMERA_INFO and topic.entries
    }
    return all(tuple(_camera(topic.name)) in beside for topic in (left, right))


def _named(bag: Bag, images: Sequence[Topic], given: Mapping[str, str], side: str) -> Topic:
    found = next(
        (topic for topic in images if topic.name in (given[side], f"/{given[side]}")), None
    )
    if found is None:
        raise InputError(
            f"{bag.path}: --topics {side}={given[side]}: is not an image topic of this "
            f"bag{_listed(images)}"
        )
    return found


def _listed(images: Sequence[Topic]) -> str:
    return f" ({', '.join(topic.name for topic in images)})" if images else " (it has none)"


def _are_sides(left: Topic, right: Topic) -> bool:
    """True where the names differ in one part alone, which tells the side of each."""
    parts = left.name.split("/"), right.name.split("/")
    if len(parts[0]) != len(parts[1]) or left.msgtype != right.msgtype:
        return False
    differing = [(a, b) for a, b in zip(*parts, strict=True) if a != b]
    return bool(differing) and all(
        (side_of(a), side_of(b)) in _SIDES or _numbered(a, b) for a, b in differing
    )


_SIDES = {("left", "right")}
_NUMBERS = (("0", "1"), ("1", "2"))


def _numbered(left: str, right: str) -> bool:
    """``infra1`` and ``infra2``, ``camera_0`` and ``camera_1``."""
    return any(
        left.endswith(a) and right.endswith(b) and left[: -len(a)] == right[: -len(b)]
        for a, b in _NUMBERS
    )


def _preference(left: Topic, right: Topic) -> tuple[bool, bool, bool, int, int]:
    """Images as the camera took them before rectified ones; words before numbers; color before
    gray; raw before compressed ones, and these before videos.
    """
    name = left.name.lower()
    by_word = side_of(left.name) == "left"
    return (
        "rect" not in name,
        by_word,
        "mono" not in name,
        -(*IMAGES, *VIDEOS).index(left.msgtype),
        min(left.count, right.count),
    )


def _camera(name: str) -> list[str]:
    """The parts of a topic's name that its camera_info shares."""
    parts = name.split("/")
    while len(parts) > 1 and parts[-1] in TRANSPORTS:
        parts = parts[:-1]
    return parts if parts != name.split("/") else parts[:-1]
