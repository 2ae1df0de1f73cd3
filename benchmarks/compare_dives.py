"""Two synthetic dives of one reef, through the whole program, and what ``compare`` finds of what
changed between them.

python benchmarks/compare_dives.py FOLDER renders, runs, fuses and compares; FOLDER is new. Prints a
table for docs/compare.md.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from arguments import words_of
from numpy.typing import NDArray
from reef_changes import Change, changed_reef

from calibration.formats import native
from calibration.transforms import rigid_transform, rotation_from_vector, transform_points
from stereo_seecolor.commands.fuse import fuse
from stereo_seecolor.commands.run import run
from stereo_seecolor.config import RunConfig
from stereo_seecolor.extras.reef.compare import compare
from stereo_seecolor.extras.reef.comparing.site_change import SiteChange
from stereo_seecolor.extras.synthetic.reef import Reef
from stereo_seecolor.extras.synthetic.render import Scene
from stereo_seecolor.extras.synthetic.survey import SurveySpec
from stereo_seecolor.files.tum import write_tum
from stereo_seecolor.mapping.raster.grid import Grid

FIRST = SurveySpec(
    seed=11,
    pairs=14,
    lines=2,
    line_spacing_m=0.6,
    pair_spacing_m=0.35,
    altitude_m=(1.3, 1.3),
    relief_m=0.2,
)
SECOND = replace(
    FIRST,
    seed=12,
    pairs=15,
    lines=3,
    line_spacing_m=0.35,
    pair_spacing_m=0.5,
    altitude_m=(1.6, 1.6),
    water="coastal-green",
)
CHANGES = (
    Change("grown", 0.35, 0.25, 0.16, 0.02),
    Change("grown", 1.7, 0.6, 0.14, 0.022),
    Change("grown", 2.1, 0.15, 0.13, 0.04),
    Change("grown", 0.6, -0.15, 0.14, 0.025),
    Change("removed", 1.0, 0.1, 0.15, 0.0),
    Change("sand", 1.55, -0.1, 0.2, 0.04),
    Change("bleached", 0.9, 0.75, 0.15),
    Change("bleached", 0.1, 0.7, 0.12),
)
T_SECOND_WORLD = rigid_transform(
    rotation_from_vector(np.array([0.01, -0.015, 0.35])), [3.0, -1.0, 0.4]
)
"""The second dive's navigation has another origin, heading and level."""


def render(scene: Scene, folder: Path, T: NDArray[np.float64]) -> None:
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
    native.write(scene.rig, folder / "cam.yaml")
    write_tum(
        folder / "trajectory.tum",
        replace(scene.trajectory, T_world_camera=T @ scene.trajectory.T_world_camera),
    )
    for index in range(scene.spec.pairs):
        frame = scene.render(index).frame
        for side, image in (("left", frame.left), ("right", frame.right)):
            cv2.imwrite(
                str(folder / side / f"{frame.name}.png"), cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
            )


def mapped(folder: Path) -> Path:
    config = RunConfig.model_validate({"mapping": {"voxel_m": 0.01}, "color": {"lock": "survey"}})
    run(folder / "left", folder / "right", str(folder / "cam.yaml"), folder / "out", config)
    fuse(folder / "out", folder / "trajectory.tum", config)
    return folder / "out"


def main(folder: Path) -> None:
    first = Scene.from_spec(FIRST)
    second = replace(Scene.from_spec(SECOND), reef=changed_reef(first.reef, CHANGES))
    render(first, folder / "first", np.eye(4))
    render(second, folder / "second", T_SECOND_WORLD)
    before, after = (mapped(folder / name) for name in ("first", "second"))
    found = compare(before, after, folder / "change").change
    judge(found, first.reef, second.reef)


def judge(found: SiteChange, before: Reef, after: Reef) -> None:
    """Print what was found against what is true; first's coordinates are the reef's own."""
    points = np.stack(
        [
            field.ravel()
            for field in found.before.grid.centers(*map(slice, (0, 0), found.before.grid.shape))
        ],
        axis=-1,
    )
    places = np.concatenate([points, np.zeros((len(points), 1))], axis=1)
    off = transform_points(found.registration.T_a_b @ T_SECOND_WORLD, places) - places
    say("registration: RMS error", f"{1000 * np.sqrt((off**2).sum(axis=1).mean()):.2f} mm")
    true_m = height_on(found.before.grid, after) - height_on(found.before.grid, before)
    known, moved = np.isfinite(found.difference.dz_m), np.abs(true_m) > 5e-4
    still = known & ~grown(moved, 5)
    within = np.abs(found.difference.dz_m) <= found.difference.lod_m
    on_surface = np.isfinite(found.surface.distance_m) & still
    say("ground that changed", f"{moved[known].mean():.1%} of {found.overlap_m2:.1f} m2")
    say("level of detection, median", f"{1000 * np.nanmedian(found.difference.lod_m):.1f} mm")
    say("unchanged cells within it", f"{within[still].mean():.1%}")
    within_surface = np.abs(found.surface.distance_m) <= found.surface.lod_m
    say("the same along the normal", f"{within_surface[on_surface].mean():.1%}")
    patches = np.zeros(known.shape, bool)
    for patch, mask in zip(found.patches, found.masks, strict=True):
        patches |= mask if patch.kind in ("growth", "loss") else False
    large = known & (np.abs(true_m) >= 0.0195)
    say("cells changed by 2 cm and more in a patch", f"{patches[large].mean():.1%}")
    say(
        "area of the patches where nothing moved",
        f"{(patches & ~grown(moved, 7)).sum() / max(patches.sum(), 1):.1%}",
    )
    for name, total, amount in (
        ("growth", found.growth_l, np.maximum(true_m, 0)),
        ("loss", found.loss_l, np.minimum(true_m, 0)),
    ):
        true_l = 1000 * found.before.grid.cell_m**2 * amount[known].sum()
        say(
            name,
            f"{total[0]:.2f} ± {total[1]:.2f} l, true {true_l:.2f} l "
            f"({total[0] / true_l - 1:+.1%})",
        )
    for patch in found.patches:
        where = (
            f"at {patch.x_m:.2f}, {patch.y_m:.2f}: {patch.area_cm2:.0f} cm2, {patch.volume_l:.2f} l"
        )
        say(
            f"patch {patch.number}: {patch.kind}",
            f"{where}, L* {patch.lightness:+.0f}, C* {patch.chroma:+.0f}",
        )


say: Callable[[str, str], None] = lambda what, value: print(f"| {what} | {value} |", flush=True)  # noqa: E731


def height_on(grid: Grid, reef: Reef) -> NDArray[np.float64]:
    x, y = grid.centers(slice(0, grid.shape[0]), slice(0, grid.shape[1]))
    columns, rows = (
        (values - start) / 0.005 for values, start in ((x, reef.origin_m[0]), (y, reef.origin_m[1]))
    )
    return cv2.remap(
        reef.height_m, columns.astype(np.float32), rows.astype(np.float32), cv2.INTER_LINEAR
    ).astype(np.float64)


def grown(mask: NDArray[np.bool_], size: int) -> NDArray[np.bool_]:
    return cv2.dilate(mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0


if __name__ == "__main__":
    main(Path(words_of(__doc__, "FOLDER")[0]))
