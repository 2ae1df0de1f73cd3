"""``color.lock: auto``: one water for the dive, or one for each segment if they do not share one.

Frames are collected in chunks of neighbors, at most 64, each with the sum of its frames' tables.
Neighboring chunks are joined, the most similar first, as long as a common water fits about as well
as separate waters.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from operator import add

import numpy as np
from numpy.typing import NDArray

from stereo_seecolor.color.fitting import robust
from stereo_seecolor.color.fitting.jackknife import MOST, with_errors_of_blocks
from stereo_seecolor.color.fitting.robust import ENOUGH, quality
from stereo_seecolor.color.sharing.survey import (
    BLACK,
    CountedFrames,
    FitTable,
    Fitter,
    FrameBrightness,
    add_to,
    fill_missing_waters,
    survey_waters,
    usual_exposure,
)
from stereo_seecolor.color.table.moment_table import MomentTable
from stereo_seecolor.color.table.range_quantiles import RangeQuantiles, quantiles_by_range
from stereo_seecolor.config import ColorConfig
from stereo_seecolor.records import Water


@dataclass(frozen=True)
class SegmentSettings:
    """Limits for joining. Costs: of ``robust.quality``, means over the smaller segment."""

    most_chunks: int = 64
    """With more, neighbors are joined, to limit memory; a cut is known to a 32nd."""
    worse: float = 25.0
    """Largest cost that a shared water adds. Parts of one dive add up to 6; groups of four frames
    of two sites mostly 32, at least 5.
    """
    bad: float = 50.0
    """Cost under a shared water above which frames do not share it, whatever their own cost."""
    worse_alone: float = 25.0
    """Added to these limits for a single chunk, because one frame may show an unusual object."""


SETTINGS = SegmentSettings()


@dataclass(frozen=True, eq=False)
class _Chunk:
    """frames: numbers. linked: it shows spots of the chunk before it. packed: tables by class of
    brightness, because 64 of them would not fit into memory.
    """

    frames: range
    linked: bool
    packed: dict[int, bytes]

    @classmethod
    def of(cls, frames: range, linked: bool, classes: Mapping[int, MomentTable]) -> "_Chunk":
        """The chunk of these tables."""
        return cls(frames, linked, {kind: table.packed() for kind, table in classes.items()})

    def __add__(self, other: "_Chunk") -> "_Chunk":
        frames = range(self.frames.start, other.frames.stop)
        return _Chunk.of(frames, self.linked, _classes([self, other]))


@dataclass(frozen=True, eq=False)
class _Evidence:
    """table, seen: of its frames. water: its own, near enough to compare costs. own: its cost."""

    table: MomentTable
    seen: RangeQuantiles
    water: Water
    own: float


class AutoFitter(Fitter):
    """Assigns each frame the water of its segment. linked: names of frames that show spots of the
    frame before; the dive is not cut between these.
    """

    joins = True

    def __init__(self, config: ColorConfig, fit: FitTable, linked: Collection[str] = ()) -> None:
        self._config, self._fit, self._linked = config, fit, linked
        self._chunks: list[_Chunk] = []
        self._frames = FrameBrightness()
        # the chunk that grows
        self._open, self._open_linked, self._classes = range(0), False, dict[int, MomentTable]()
        self._chunk_frames = 1
        self._segments: list[range] = []

    def add(self, name: str, table: MomentTable) -> None:
        """Add a frame."""
        self.join(CountedFrames.of([(name, table)], self._config))

    def join(self, several: CountedFrames) -> None:
        """Add several frames; the dive is not cut between them."""
        if not several.frames:
            return
        if len(self._open) >= self._chunk_frames:
            self._chunks.append(_Chunk.of(self._open, self._open_linked, self._classes))
            self._open, self._classes = range(self._open.stop, self._open.stop), {}
            if len(self._chunks) == SETTINGS.most_chunks:
                self._chunk_frames *= 2
                self._chunks = [
                    reduce(add, self._chunks[i : i + 2]) for i in range(0, len(self._chunks), 2)
                ]
        if not self._open:
            self._open_linked = several.frames[0][0] in self._linked
        self._frames.add(several.frames)
        self._open = range(self._open.start, len(self._frames))
        add_to(self._classes, several.classes)

    def waters(self) -> Mapping[str, Water]:
        """The water of the segment of each frame; without ranges, of the frame before."""
        chunks = [*self._chunks]
        if self._open:
            chunks.append(_Chunk.of(self._open, self._open_linked, self._classes))
        linked = _linked(chunks)
        parts = _parts([_classes(part) for part in linked], self._config)
        segments = [[c for one in linked[part.start : part.stop] for c in one] for part in parts]
        self._segments = [range(one[0].frames.start, one[-1].frames.stop) for one in segments]
        return fill_missing_waters(water for one in segments for water in self._segment_waters(one))

    def _segment_waters(self, chunks: Sequence["_Chunk"]) -> Iterator[tuple[str, Water | None]]:
        frames = range(chunks[0].frames.start, chunks[-1].frames.stop)
        classes = _classes(chunks)

        def fit(table: MomentTable, start: Water | None) -> Water:
            blocks = _blocks(chunks, usual_exposure(classes)[0])
            return with_errors_of_blocks(self._fit(table, start), table, blocks, self._config)

        return survey_waters(self._frames, frames, classes, self._config, fit)

    @property
    def segments(self) -> list[list[str]]:
        """The names of the frames of each segment, after ``waters``."""
        return [self._frames.names[frames.start : frames.stop] for frames in self._segments]

    def notes(self) -> tuple[str, ...]:
        """Where the dive was cut into segments; empty if all frames share one water."""
        if len(self._segments) < 2:
            return ()
        ends = [(names[0], names[-1]) for names in self.segments]
        named = [f"{first} to {last}" if first != last else first for first, last in ends]
        return (
            f"the frames do not share one water: {len(named)} waters were fitted, one each for "
            f"{'; '.join(named)}",
        )


def _linked(chunks: Sequence[_Chunk]) -> list[Sequence[_Chunk]]:
    """The chunks, those together between which the dive is not cut."""
    cuts = [i for i, chunk in enumerate(chunks) if i == 0 or not chunk.linked]
    return [chunks[a:b] for a, b in pairwise([*cuts, len(chunks)])]


def _classes(chunks: Sequence[_Chunk]) -> dict[int, MomentTable]:
    """The tables of several chunks by class of brightness."""
    classes: dict[int, MomentTable] = {}
    for chunk in chunks:
        add_to(classes, {kind: MomentTable.unpacked(one) for kind, one in chunk.packed.items()})
    return classes


def _blocks(chunks: Sequence[_Chunk], usual: int) -> Iterator[MomentTable]:
    """The sums of some chunks after the other, of frames of usual exposure as a fit takes them."""
    for part in np.array_split(np.arange(len(chunks)), min(len(chunks), MOST)):
        classes = _classes(chunks[part[0] : part[-1] + 1])
        tables = [table for kind, table in classes.items() if abs(kind - usual) <= 1]
        if tables:
            yield reduce(add, tables)


def _evidence(
    parts: Sequence[Mapping[int, MomentTable]], config: ColorConfig
) -> dict[int, _Evidence]:
    """The data of the parts with light and a known range, by number."""
    tables = {
        i: usual_exposure(part)[1] for i, part in enumerate(parts) if any(set(part) - {BLACK})
    }
    if not tables:
        return {}
    several = [quantiles_by_range(table, config.encoding) for table in tables.values()]
    waters, _ = robust.fit_all(several, config, enough=ENOUGH)
    # not the costs of these fits, which contain how likely the water is
    costs = quality(several, config.robust, waters).tolist()
    made = map(_Evidence, tables.values(), several, waters, costs)
    return dict(zip(tables, made, strict=True))


def _parts(parts: Sequence[Mapping[int, MomentTable]], config: ColorConfig) -> list[range]:
    """Segments of chunks that share one water; chunks without evidence go with those before."""
    if len(parts) < 2:
        return [range(len(parts))] * len(parts)
    chunks = _evidence(parts, config)
    alone = [_Segment((one,), one.table, one.water, np.zeros(1)) for one in chunks.values()]
    sizes = [len(segment.chunks) for segment in _joined(alone, config)]
    known = list(chunks)
    edges = [0, *(known[cut] for cut in np.cumsum(sizes[:-1], dtype=int)), len(parts)]
    return [range(a, b) for a, b in pairwise(edges)]


@dataclass(frozen=True, eq=False)
class _Segment:
    """table, water: of all chunks. costs (N,): of each under it, less that under its own water.
    strain: the cost that joining its two parts added, as a fraction of the limit.
    """

    chunks: tuple[_Evidence, ...]
    table: MomentTable
    water: Water
    costs: NDArray[np.float64]
    strain: float = 0.0


def _joins(pairs: Sequence[tuple[_Segment, _Segment]], config: ColorConfig) -> list[_Segment]:
    """Each pair of a segment and the next one joined; waters and costs are found together."""
    if not pairs:
        return []
    larger = [max(pair, key=lambda segment: len(segment.chunks)).water for pair in pairs]
    tables = [a.table + b.table for a, b in pairs]
    seen = [quantiles_by_range(table, config.encoding) for table in tables]
    waters, _ = robust.fit_all(seen, config, larger, ENOUGH)
    chunks = [(*a.chunks, *b.chunks) for a, b in pairs]
    numbers = [len(several) for several in chunks]
    every = [chunk for several in chunks for chunk in several]
    under = [water for water, n in zip(waters, numbers, strict=True) for _ in range(n)]
    costs = quality([chunk.seen for chunk in every], config.robust, under)
    added = np.split(costs - [chunk.own for chunk in every], np.cumsum(numbers)[:-1])
    strains = [_strain(cost, *pair) for cost, pair in zip(added, pairs, strict=True)]
    return list(map(_Segment, chunks, tables, waters, added, strains))


def _strain(costs: NDArray[np.float64], earlier: _Segment, later: _Segment) -> float:
    """The cost that joining two segments adds, as a fraction of the limit. costs: of both."""
    number = len(earlier.chunks)
    fewer, more = sorted((number, len(later.chunks)))
    alone = SETTINGS.worse_alone * (1 - fewer / more) / fewer
    added = (costs.sum() - earlier.costs.sum() - later.costs.sum()) / fewer
    smaller = costs[:number] if number == fewer else costs[number:]
    return float(max(added / (SETTINGS.worse + alone), smaller.mean() / (SETTINGS.bad + alone)))


def _joined(segments: list[_Segment], config: ColorConfig) -> list[_Segment]:
    """Join neighbors, those with the least strain first, until all joins exceed the limit."""
    joins = _joins(list(pairwise(segments)), config)
    while joins:
        best = min(range(len(joins)), key=lambda i: joins[i].strain)
        if joins[best].strain > 1:
            break
        segments[best : best + 2] = [joins.pop(best)]
        beside = [i for i in (best - 1, best) if 0 <= i < len(joins)]
        again = _joins([(segments[i], segments[i + 1]) for i in beside], config)
        for i, join in zip(beside, again, strict=True):
            joins[i] = join
    return segments
