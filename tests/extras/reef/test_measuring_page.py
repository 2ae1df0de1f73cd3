"""The page's program measures as ``measure`` does: both are given the same surfaces and places."""

import json
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration import RectifiedPair
from stereo_seecolor.extras.reef.ground_volume import volume_above
from stereo_seecolor.extras.reef.lengths_and_areas import along_surface, length_along, surface_area
from stereo_seecolor.extras.reef.map_ground import Ground
from stereo_seecolor.extras.reef.picking import FrameSurface
from stereo_seecolor.extras.reef.polygons import crosses_itself
from stereo_seecolor.mapping.raster.grid import Grid

PAIR = RectifiedPair(200.0, 80.0, 80.0, 64.0, 0.1, (160, 128))
PLACES = [(30.0, 20.0), (120.0, 24.0), (110.0, 100.0), (36.0, 96.0)]
CROSSED = [PLACES[0], PLACES[2], PLACES[1], PLACES[3]]
LONG = [(20.0, 30.0), (30.0, 110.0)]
"""From before something near to behind it."""
BESIDE = (51.5, 64.0)
"""A place of the bottom two pixels beside something near."""
CORNERS = [(0.12, 0.92), (0.85, 0.9), (0.8, 0.2), (0.15, 0.1)]
OUTLINES = [
    [(0.12, 0.88), (0.88, 0.86), (0.85, 0.12), (0.2, 0.15)],
    [(0.31, 0.7), (0.7, 0.69), (0.68, 0.3), (0.44, 0.32)],
    [(0.05, 0.12), (0.2, 0.12), (0.2, 0.03)],
]
"""Around the dome with the hole beside it; across the dome; of bare ground."""
CORRELATION_M = 0.03
PROGRAM = """
import { readFileSync } from "node:fs";
import { alongSurface, lengthAlong, nearer, offInFrame, pick, surfaceArea } from "./src/measure";
import { crossesItself } from "./src/outlines";
import { Ground } from "./src/terrain";
import { volumeAbove } from "./src/volume";
const given = JSON.parse(readFileSync(0, "utf8"));
const known = (values) => Float32Array.from(values, (each) => (each === null ? NaN : each));
const ranges = { ...given.ranges, range_m: known(given.ranges.range_m), std_m: known(given.ranges.std_m) };
const at = ([x, y]) => pick(ranges, given.pair, x, y);
const { rows, columns, cell_m, heights, sides, std_m, correlation_m } = given.ground;
const place = {
  place: { pixel_m: cell_m },
  cell: (x, y) => [x / cell_m - 0.5, (rows * cell_m - y) / cell_m - 0.5],
  center: (c, r) => [(c + 0.5) * cell_m, rows * cell_m - (r + 0.5) * cell_m],
  at: (c, r) => (c < 0 || r < 0 || c >= columns || r >= rows ? NaN : heights[r * columns + c] ?? NaN),
  side: (c, r) => sides[r * columns + c],
};
const ground = new Ground(place, std_m, correlation_m);
const spots = given.corners.map(([x, y]) => ground.pick(x, y, null, 0.002));
console.log(JSON.stringify({
  frame: surfaceArea(ranges, given.pair, given.places.map(at)),
  step: nearer(ranges, given.pair, at(given.beside)),
  plain: nearer(ranges, given.pair, at(given.places[0])),
  crossed: [given.places, given.crossed].map((each) => crossesItself(each)),
  length: lengthAlong(alongSurface(ranges, given.pair, [given.long[0], given.long[1]].map(at)), offInFrame),
  map: ground.area(spots),
  map_length: ground.length(spots.slice(0, 2)),
  volumes: given.outlines.map((each) => volumeAbove(ground, each.map(([x, y]) => ground.pick(x, y, null, 0.002)))),
}));
"""  # noqa: E501


def seen() -> FrameSurface:
    """A bottom with a hole, and something near on its left half."""
    depth_m = np.full((128, 160), 2.0)
    depth_m[60:70, :50] = 1.2
    depth_m[70:90, 60:90] = np.nan
    range_m = (depth_m * PAIR.ray_length).astype(np.float32)
    return FrameSurface(PAIR, range_m, np.full((32, 40), 0.004, np.float32))


def reef() -> Ground:
    """A dome with steep sides on rough ground, with a hole."""
    y, x = (np.mgrid[:50, :50] + 0.5) * 0.02
    heights = np.sqrt(np.maximum(0.3**2 - (x - 0.5) ** 2 - (y - 0.5) ** 2, 0)) + 0.01 * np.sin(
        40 * x
    ) * np.cos(30 * y)
    heights[30:38, 5:20] = np.nan
    sides = x > 0.5  # were seen on one half
    return Ground(heights, Grid(0.0, 1.0, 0.02, (50, 50)), 0.004, sides, 0.0, CORRELATION_M)


@pytest.fixture(scope="module")
def page(web: Path) -> dict:
    bundle = [
        "npx",
        "--no-install",
        "esbuild",
        "--bundle",
        "--format=esm",
        "--platform=node",
        "--loader=ts",
        "--banner:js=globalThis.window=globalThis;",
    ]
    built = subprocess.run(
        bundle, cwd=web, input=PROGRAM, capture_output=True, text=True, check=True
    ).stdout
    surface, ground = seen(), reef()
    ranges = {
        "width": 160,
        "height": 128,
        "range_m": surface.range_m.ravel().tolist(),
        "std_m": surface.std_blocks_m.ravel().tolist(),
    }
    pair = {"focal_px": PAIR.focal_px, "cx_left_px": PAIR.cx_left_px, "cy_px": PAIR.cy_px}
    terrain = {
        "rows": 50,
        "columns": 50,
        "cell_m": 0.02,
        "heights": ground.heights_m.ravel().tolist(),
        "sides": np.asarray(ground.sides).ravel().tolist(),
        "std_m": ground.std_m,
        "correlation_m": ground.correlation_m,
    }
    given = {
        "ranges": ranges,
        "pair": pair,
        "ground": terrain,
        "places": PLACES,
        "crossed": CROSSED,
        "beside": BESIDE,
        "long": LONG,
    }
    given |= {"corners": CORNERS, "outlines": OUTLINES}
    text = json.dumps(given).replace("NaN", "null")
    run = subprocess.run(
        ["node", "--input-type=module", "-e", built],
        input=text,
        capture_output=True,
        text=True,
        check=True,
    )
    return dict(json.loads(run.stdout))


def test_an_area_in_a_frame_is_the_same(page: dict) -> None:
    surface = seen()
    picks = [pick for place in PLACES if (pick := surface.pick(*place))]
    area, known = surface_area(surface, picks)
    assert known < 0.95
    assert page["frame"] == [
        {
            "value": pytest.approx(area.value, rel=1e-6),
            "std": pytest.approx(area.std, rel=1e-5),
            "power": 2,
        },
        known,
    ]


def test_lengths_along_the_surface_are_the_same(page: dict) -> None:
    surface, ground = seen(), reef()
    found = length_along(
        along_surface(surface, [pick for place in LONG if (pick := surface.pick(*place))])
    )
    spots = [spot for corner in CORNERS if (spot := ground.pick(*corner, None, 0.002))]
    on_map = ground.length(spots[:2])
    assert on_map is not None
    for name, length in (("length", found), ("map_length", on_map)):
        assert page[name] == {
            "value": pytest.approx(length.value, rel=1e-6),
            "std": pytest.approx(length.std, rel=1e-5),
            "power": 1,
        }


def test_an_area_on_the_map_is_the_same(page: dict) -> None:
    ground = reef()
    found = ground.area([spot for corner in CORNERS if (spot := ground.pick(*corner, None, 0.002))])
    assert found is not None and found[1] < 0.95
    area = found[0]
    assert page["map"][0] == {
        "value": pytest.approx(area.value, rel=1e-6),
        "std": pytest.approx(area.std, rel=1e-5),
        "power": 2,
    }
    assert page["map"][1] == pytest.approx(found[1])


def test_a_volume_on_the_map_is_the_same(page: dict) -> None:
    ground, found = reef(), []
    for outline in OUTLINES:
        spots = [spot for corner in outline if (spot := ground.pick(*corner, None, 0.002))]
        found.append(volume_above(ground, spots))
    assert found[0] is not None and found[1] is not None
    unseen = [spot for corner in OUTLINES[0] if (spot := ground.pick(*corner, None, 0.002))]
    without = volume_above(replace(ground, sides=None), unseen)
    assert without is not None and without.std > 1.2 * found[0].std
    for volume, shown in zip(found, page["volumes"], strict=True):
        assert shown == (
            volume
            and {
                "value": pytest.approx(volume.value, rel=1e-6),
                "std": pytest.approx(volume.std, rel=1e-5),
                "power": 3,
            }
        )


def test_steps_and_outlines_that_cross_themselves_are_refused_by_both(page: dict) -> None:
    surface = seen()
    beside, plain = surface.pick(*BESIDE), surface.pick(*PLACES[0])
    assert beside is not None and plain is not None
    assert surface.nearer_m(beside) == pytest.approx(page["step"], rel=1e-6) and page[
        "step"
    ] == pytest.approx(1.2, rel=0.01)
    assert surface.nearer_m(plain) is None and page["plain"] is None
    assert (
        page["crossed"]
        == [crosses_itself(np.array(each)) for each in (PLACES, CROSSED)]
        == [False, True]
    )
