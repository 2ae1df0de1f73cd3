"""Run the sample dive, read the finished run, and compare it with the truth: python
examples/sample_dive.py [OUT].
"""

import sys
from pathlib import Path

import numpy as np

from stereo_seecolor import load_config, open_run, run
from stereo_seecolor.extras.evaluation.evaluate_run import evaluate

DIVE = Path(__file__).resolve().parents[1] / "data_samples" / "reef"


def main(out: Path) -> None:
    """Ranges and colors of the dive in ``out``, one water for all frames."""
    summary = run(
        DIVE / "left",
        DIVE / "right",
        DIVE / "cam.yaml",
        out,
        load_config(None, ["color.lock=survey"]),
    )
    print(f"{summary.count('ok')} pairs done, {summary.count('failed')} failed")

    finished = open_run(out)
    print(f"baseline {1000 * finished.rig.baseline_m:.1f} mm")
    for frame in finished.frames[:3]:
        range_m = frame.measured_range_m()
        print(
            f"{frame.name}: median range {np.nanmedian(range_m):.2f} m, known for "
            f"{np.isfinite(range_m).mean():.0%} of the pixels"
        )

    report = evaluate(out, DIVE / "truth")
    print(f"range: median error {report.range.median_relative_error:.2%}")
    print(
        f"color: mean angular error {report.color.angle_deg:.1f} degrees, raw images "
        f"{report.raw_color.angle_deg:.1f} degrees"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/example"))
