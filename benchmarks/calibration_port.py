"""A flat port by exact rays: what is left of the range error with the model, without it, and with
the usual correction.

    python benchmarks/calibration_port.py [docs/images/flat_port_error.svg]

A rig of two 1280x960 cameras 0.12 m apart, 65 degrees wide in air, 30 mm behind 10 mm of acrylic,
in seawater of 15 degrees; the working range is 1.5 m. Root mean square error of the range over the
image.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from arguments import words_of

from calibration import Camera, StereoRig
from calibration.port import FlatPort, FlatWindow, seawater_index
from calibration.port_errors import port_error

DEPTHS_M = np.array([0.5, 0.6, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0])


def make_rig(distance_m: float = 0.03) -> StereoRig:
    camera = Camera(
        np.array([[1000.0, 0, 640], [0, 1000, 480], [0, 0, 1]]),
        np.array([-0.2, 0.05, 0, 0, 0]),
        (1280, 960),
    )
    T = np.eye(4)
    T[:3, :3] = cv2.Rodrigues(np.array([0.002, 0.0, -0.002]))[0]
    T[:3, 3] = [-0.12, 0, 0]
    window = FlatWindow(distance_m, 0.01, np.array([0.0, 0.0, 1.0]))
    return StereoRig(
        camera, camera, T, "air", None, FlatPort(window, window, 1.5, seawater_index(15, 35, 10))
    )


def longer_focal(rig: StereoRig) -> StereoRig:
    """The rig as people correct it: focal lengths times the index of water, no port."""
    assert isinstance(rig.port, FlatPort)
    zoom = np.array([[rig.port.water_index], [rig.port.water_index], [1]]) * np.array(
        [[1, 1, 0]]
    ) + np.array([[0, 0, 1]])
    left, right = (replace(camera, K=camera.K * zoom) for camera in (rig.left, rig.right))
    return replace(rig, left=left, right=right, port=None)


def main() -> None:
    words = words_of(__doc__, "DRAWING")
    rig = make_rig()
    modeled, ignored = port_error(rig, DEPTHS_M), port_error(rig, DEPTHS_M, replace(rig, port=None))
    zoomed = port_error(rig, DEPTHS_M, longer_focal(rig))
    far = port_error(make_rig(0.1), DEPTHS_M)
    print(
        "| range, m | with the model | port 100 mm away, with the model | focal length x index | "
        "port ignored | rows, ignored |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    for i, depth in enumerate(DEPTHS_M):
        columns = [f"{e.range_error[i]:.2%}" for e in (modeled, far, zoomed, ignored)]
        print(f"| {depth:g} | {' | '.join(columns)} | {ignored.row_error_px[i]:.1f} px |")
    if words:
        curves = {
            "with the model": modeled,
            "focal length x index": zoomed,
            "port ignored": ignored,
        }
        Path(words[0]).write_text(
            _svg({name: error.range_error for name, error in curves.items()}), encoding="utf-8"
        )


def _svg(curves: dict[str, np.ndarray]) -> str:
    """Relative error over range, the error on a logarithmic scale from 0.001 % to 100 %."""
    x = 60 + 400 * np.log(DEPTHS_M / 0.5) / np.log(10)
    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 620 300" font-family="sans-serif" '
        'font-size="12">'
    ]
    parts.append('<rect width="620" height="300" fill="white"/>')
    for power in range(-5, 1):
        y = 30 - power * 45
        parts.append(
            f'<path d="M60 {y}H460" stroke="#ddd"/><text x="54" y="{y + 4}" '
            f'text-anchor="end">{10.0**power * 100:g} %</text>'
        )
    for depth in (0.5, 1.0, 1.5, 2.0, 3.0, 5.0):
        at = 60 + 400 * np.log(depth / 0.5) / np.log(10)
        parts.append(
            f'<path d="M{at:.1f} 30V255" stroke="#eee"/><text x="{at:.1f}" y="272" '
            f'text-anchor="middle">{depth:g}</text>'
        )
    parts.append('<text x="260" y="292" text-anchor="middle">distance before the cameras, m</text>')
    for (name, errors), color in zip(
        curves.items(), ("#1b7f4d", "#b8860b", "#b22222"), strict=True
    ):
        y = 30 - 45 * np.log10(np.clip(errors, 1e-5, 1))
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        parts.append(f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="2"/>')
        parts.append(f'<text x="468" y="{y[-1] + 4:.1f}" fill="{color}">{name}</text>')
    return "\n".join([*parts, "</svg>\n"])


if __name__ == "__main__":
    main()
