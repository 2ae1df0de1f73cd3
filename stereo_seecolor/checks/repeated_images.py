"""Images that a dive holds twice in a row, because a camera stalled or files were copied."""

from collections.abc import Mapping

from stereo_seecolor.records import FrameRow

BOTH = (
    "both images are those of the previous pair: the cameras stalled, or files were copied, and "
    "this part of the reef counts twice"
)
ONE = (
    "the {} image is that of the previous pair, and the other is not: a camera stalled, and "
    "ranges are wrong by the motion since"
)


class RepeatedImages:
    """Compares each pair, by the hashes of its files, with the last one that was read."""

    def __init__(self) -> None:
        self._before: Mapping[str, str] = {}

    def warning(self, row: FrameRow) -> str:
        """A warning if images of this pair are those of the pair before; else ""."""
        again = [
            side
            for side in ("left", "right")
            if side in row.hashes and row.hashes[side] == self._before.get(side)
        ]
        self._before = row.hashes or self._before
        if not again:
            return ""
        return BOTH if len(again) == 2 else ONE.format(again[0])
