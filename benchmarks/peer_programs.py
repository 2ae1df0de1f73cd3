"""The programs that peers.py compares, each run in a process of its own by the Python that has its
packages: a matcher reads left.png, right.png and count.txt in a folder and writes disparity.npy
(pixels, float32, NaN unknown).
"""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

PANDORA_INVALID = 0b1111000011
"""Bits of Pandora's validity mask that say that a disparity is no result (its documentation)."""


def _pair(folder: Path) -> tuple[Any, Any, int]:
    import cv2

    left, right = (cv2.imread(str(folder / f"{side}.png")) for side in ("left", "right"))
    return left, right, int((folder / "count.txt").read_text())


def ours(folder: Path) -> None:
    import numpy as np

    from calibration import RectifiedPair
    from stereo_seecolor.config import MatchingConfig
    from stereo_seecolor.matching.matcher import Matcher
    from stereo_seecolor.records import StereoFrame

    left, right, count = _pair(folder)
    height, width = left.shape[:2]
    focal_px, baseline_m = 500.0, 0.1  # any: only disparities are compared
    pair = RectifiedPair(focal_px, width / 2, width / 2, height / 2, baseline_m, (width, height))
    config = MatchingConfig(min_range_m=focal_px * baseline_m / count)
    frame = StereoFrame("pair", left[..., ::-1].copy(), right[..., ::-1].copy())
    np.save(folder / "disparity.npy", Matcher(pair, config).match(frame).disparity)


def sgbm(folder: Path, wls: bool = False) -> None:
    """StereoSGBM 3WAY as its documentation advises, with the left-right check and the speckle
    filter, or with the WLS filter of its contributed modules, cut where it is less than half sure.
    """
    import cv2
    import numpy as np

    left, right, count = _pair(folder)
    left, right = (
        cv2.copyMakeBorder(image, 0, 0, count, 0, cv2.BORDER_REPLICATE) for image in (left, right)
    )
    area = 3 * 9
    matcher = cv2.StereoSGBM.create(
        0, count, 3, 8 * area, 32 * area, 1, 0, 10, 100, 2, cv2.StereoSGBM_MODE_SGBM_3WAY
    )
    if wls:
        matcher.setDisp12MaxDiff(1000000)
        matcher.setSpeckleWindowSize(0)
        matcher.setUniquenessRatio(0)
        other = cv2.ximgproc.createRightMatcher(matcher).compute(right, left)
        smoother = cv2.ximgproc.createDisparityWLSFilter(matcher)
        smoother.setLambda(8000)
        smoother.setSigmaColor(1.5)
        found = smoother.filter(matcher.compute(left, right), left, None, other)
        sure = smoother.getConfidenceMap() > 127
    else:
        found = matcher.compute(left, right)
        sure = found >= 0
    disparity = found / np.float32(16)
    np.save(folder / "disparity.npy", np.where(sure & (found >= 0), disparity, np.nan)[:, count:])


def sgbm_wls(folder: Path) -> None:
    sgbm(folder, wls=True)


def pandora(folder: Path) -> None:
    """Census 5x5, libSGM, parabola-like V fit, median and cross-check, as its notebooks have it."""
    import cv2
    import numpy as np

    left, right, count = _pair(folder)
    sides: dict[str, dict[str, object]] = {}
    for side, image in (("left", left), ("right", right)):
        path = folder / f"{side}_gray.png"
        cv2.imwrite(str(path), cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        sides[side] = {"img": str(path), "nodata": -9999}
    sides["left"]["disp"] = [-count, 0]
    settings = {
        "input": sides,
        "pipeline": {
            "matching_cost": {"matching_cost_method": "census", "window_size": 5, "subpix": 1},
            "optimization": {"optimization_method": "sgm"},
            "disparity": {"disparity_method": "wta", "invalid_disparity": "NaN"},
            "refinement": {"refinement_method": "vfit"},
            "filter": {"filter_method": "median", "filter_size": 3},
            "validation": {"validation_method": "cross_checking_accurate"},
        },
    }
    (folder / "pandora.json").write_text(json.dumps(settings))
    program = Path(sys.executable).parent / "pandora"
    out = folder / "pandora"
    subprocess.run([program, folder / "pandora.json", out], check=True, stdout=subprocess.DEVNULL)
    found = cv2.imread(str(out / "left_disparity.tif"), cv2.IMREAD_UNCHANGED)
    mask = cv2.imread(str(out / "left_validity_mask.tif"), cv2.IMREAD_UNCHANGED)
    known = (mask & PANDORA_INVALID) == 0
    np.save(folder / "disparity.npy", np.where(known, -found, np.nan).astype(np.float32))


def colmap(folder: Path) -> None:
    """pycolmap's incremental mapping of both sides of a dive with known focal length;
    its scale is the baseline's. Writes track.npy, positions (N, 3) of the left images, meters, NaN
    where not placed.
    """
    import numpy as np
    import pycolmap

    dive = json.loads((folder / "dive.json").read_text())
    database, images = folder / "colmap.db", folder / "images"
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "PINHOLE"
    reader.camera_params = ",".join(str(dive[key]) for key in ("fx", "fx", "cx", "cy"))
    pycolmap.extract_features(
        database, images, camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader
    )
    pycolmap.match_exhaustive(database)
    options = pycolmap.IncrementalPipelineOptions()
    options.ba_refine_focal_length = False
    (folder / "colmap").mkdir(exist_ok=True)
    models = pycolmap.incremental_mapping(database, images, folder / "colmap", options)
    model = max(models.values(), key=lambda each: each.num_reg_images())
    centers = {image.name: image.projection_center() for image in model.images.values()}
    both = [
        np.linalg.norm(centers[f"left/{name}"] - centers[f"right/{name}"])
        for name in dive["names"]
        if f"left/{name}" in centers and f"right/{name}" in centers
    ]
    scale = dive["baseline_m"] / np.median(both)
    unknown = np.full(3, np.nan)
    track = [scale * centers.get(f"left/{name}", unknown) for name in dive["names"]]
    np.save(folder / "track.npy", np.array(track))


def open3d(folder: Path) -> None:
    """Open3D's RGB-D odometry from pair to pair, and its fusion by this track. A step that it gives
    up on is no motion, as it returns it. Writes track.npy.
    """
    import cv2
    import numpy as np
    import open3d as library

    dive = json.loads((folder / "dive.json").read_text())
    depths = np.load(folder / "depth.npy")
    height, width = depths.shape[1:]
    camera = library.camera.PinholeCameraIntrinsic(
        width, height, dive["fx"], dive["fx"], dive["cx"], dive["cy"]
    )

    def frame(index: int) -> Any:
        image = cv2.imread(str(folder / "images" / "left" / dive["names"][index]))
        return library.geometry.RGBDImage.create_from_color_and_depth(
            library.geometry.Image(np.ascontiguousarray(image[..., ::-1])),
            library.geometry.Image(depths[index]),
            depth_scale=1.0,
            depth_trunc=10.0,
        )

    poses = [np.eye(4)]
    for index in range(1, len(depths)):
        _, T_before_now, _ = library.pipelines.odometry.compute_rgbd_odometry(
            frame(index),
            frame(index - 1),
            camera,
            np.eye(4),
            library.pipelines.odometry.RGBDOdometryJacobianFromHybridTerm(),
            library.pipelines.odometry.OdometryOption(depth_max=10.0),
        )
        poses.append(poses[-1] @ T_before_now)
    np.save(folder / "track.npy", np.array(poses)[:, :3, 3])
    _fused_by_open3d(folder, np.array(poses))


def open3d_by_our_track(folder: Path) -> None:
    """Open3D's fusion by our track. Writes track.npy, which is ours."""
    import numpy as np

    poses = np.load(folder / "our_poses.npy")
    np.save(folder / "track.npy", poses[:, :3, 3])
    _fused_by_open3d(folder, poses)


def _fused_by_open3d(folder: Path, poses: Any) -> None:
    """Open3D's voxel blocks of 1 cm, on our ranges (as depths in depth.npy). Writes cloud.npy,
    meters. (ScalableTSDFVolume of 0.20.0 has no points even of a plane.)
    """
    import numpy as np
    import open3d as library

    dive = json.loads((folder / "dive.json").read_text())
    K = np.array([[dive["fx"], 0, dive["cx"]], [0, dive["fx"], dive["cy"]], [0, 0, 1]])
    grid = library.t.geometry.VoxelBlockGrid(
        ("tsdf", "weight"), (library.core.float32,) * 2, ((1,), (1,)), voxel_size=0.01
    )
    for depth, pose in zip(np.load(folder / "depth.npy"), poses, strict=True):
        image = library.t.geometry.Image(library.core.Tensor(depth))
        seen = image, library.core.Tensor(K), library.core.Tensor(np.linalg.inv(pose))
        blocks = grid.compute_unique_block_coordinates(*seen, depth_scale=1.0, depth_max=10.0)
        grid.integrate(blocks, *seen, depth_scale=1.0, depth_max=10.0)
    points = grid.extract_point_cloud(weight_threshold=0.5).point.positions.numpy()
    np.save(folder / "cloud.npy", points)
