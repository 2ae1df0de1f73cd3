"""Every format gives back the rays that went in; the traps of each, by hand-written files."""

from itertools import product
from pathlib import Path

import cv2
import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, floats, integers

from calibration import Camera, StereoRig
from calibration.formats import WritableFormat, load_rig, write_rig

FORMATS: dict[WritableFormat, str] = {"native": "cam.yaml", "ros": "pair", "kalibr": "camchain.yaml", "opencv": "stereo.xml"}


@st.composite
def rigs(draw: DrawFn, representable: bool = True) -> StereoRig:
    """Random side-by-side rigs, with what every format can hold."""
    fisheye = draw(st.booleans())
    size = (draw(integers(320, 4000)), draw(integers(240, 3000)))
    cameras = [_camera(draw, size, fisheye) for _ in range(2)]
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([draw(floats(-0.3, 0.3)) for _ in range(3)]))[0]
    centre = np.array([draw(floats(0.02, 1.5)), draw(floats(-0.01, 0.01)), draw(floats(-0.01, 0.01))])
    T[:3, 3] = -T[:3, :3] @ centre
    return StereoRig(cameras[0], cameras[1], T)


def _camera(draw: DrawFn, size: tuple[int, int], fisheye: bool) -> Camera:
    fx = draw(floats(0.3, 3)) * size[0]
    K = np.array([[fx, 0, draw(floats(0.4, 0.6)) * size[0]], [0, fx * draw(floats(0.95, 1.05)), size[1] / 2], [0, 0, 1]])
    limits = [0.05, 0.02, 0.01, 0.005] if fisheye else [0.4, 0.2, 0.01, 0.01]
    distortion = np.array([draw(floats(-limit, limit)) for limit in limits])
    if not fisheye:
        distortion = np.append(distortion, 0.0)
    return Camera(K, distortion, size, "fisheye" if fisheye else "pinhole")


def seen(rig: StereoRig) -> np.ndarray:
    """Where both cameras see points scattered before them, in focal lengths; ties down every ray and the transform."""
    x, y, z = np.meshgrid([-0.4, 0.0, 0.3], [-0.3, 0.1, 0.3], [0.5, 2.0, 8.0])
    points = np.stack([x * z, y * z, z], axis=-1).reshape(-1, 1, 3)
    poses = [(np.zeros(3), np.zeros(3)), (cv2.Rodrigues(rig.R)[0], rig.T_right_left[:3, 3])]
    pixels = []
    for camera, (rvec, tvec) in zip((rig.left, rig.right), poses, strict=True):
        project = cv2.fisheye.projectPoints if camera.model == "fisheye" else cv2.projectPoints
        pixels.append(project(points, rvec, tvec, camera.K, camera.distortion)[0].reshape(-1, 2) / camera.K[0, 0])
    return np.array(pixels)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rig=rigs())
def test_every_pair_of_formats_reproduces_rays(rig: StereoRig, tmp_path: Path) -> None:
    for first, second in product(FORMATS, repeat=2):
        write_rig(rig, tmp_path / FORMATS[first], first)
        write_rig(load_rig(tmp_path / FORMATS[first]), tmp_path / FORMATS[second], second)
        again = load_rig(tmp_path / FORMATS[second])
        np.testing.assert_allclose(seen(again), seen(rig), rtol=0, atol=1e-9)
        assert again.left.image_size == rig.left.image_size
        assert again.left.model == rig.left.model
