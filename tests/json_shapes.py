"""What --json prints of each command: the keys and types that docs/json.md promises to scripts."""

from typing import Any

Shape = Any  # a type, a tuple of types and None, [shape], {key: shape}, or {str: shape} for any keys
NUMBER = (int, float)
UNKNOWN = (int, float, None)
"""A number, or null where it is not known."""


def mismatch(value: Any, shape: Shape, where: str = "$") -> str | None:
    """Where a parsed JSON value differs from a shape; None if it does not. Keys beyond those of the shape are a difference, too."""
    if isinstance(shape, dict):
        return _object_mismatch(value, shape, where)
    if isinstance(shape, list):
        if not isinstance(value, list):
            return f"{where} is no list: {value!r}"
        return next((found for i, item in enumerate(value) if (found := mismatch(item, shape[0], f"{where}[{i}]"))), None)
    allowed = shape if isinstance(shape, tuple) else (shape,)
    fits = type(value) in allowed or (value is None and None in allowed)
    return None if fits else f"{where} is {value!r}, not {allowed}"


def _object_mismatch(value: Any, shape: dict[Any, Shape], where: str) -> str | None:
    if not isinstance(value, dict):
        return f"{where} is no object: {value!r}"
    if set(shape) == {str}:
        return next((found for key, item in value.items() if (found := mismatch(item, shape[str], f"{where}.{key}"))), None)
    if value.keys() != shape.keys():
        return f"{where}: missing {sorted(shape.keys() - value.keys())}, unexpected {sorted(value.keys() - shape.keys())}"
    return next((found for key in shape if (found := mismatch(value[key], shape[key], f"{where}.{key}"))), None)


END = {"command": str, "exit_code": int}
ERROR = {"error": str, "exit_code": int}
ROW = {
    "name": str,
    "status": str,
    "left": str,
    "right": str,
    "timestamp_s": UNKNOWN,
    "error": str,
    "warnings": [str],
    "kept": bool,
    "hashes": {str: str},
    "seconds": {str: NUMBER},
    "facts": {str: UNKNOWN},
}
RUN = {
    "out": str,
    "pairs": int,
    "ok": int,
    "failed": int,
    "unpaired_files": int,
    "pending": int,
    "kept": int,
    "stopped": bool,
    "wall_seconds": NUMBER,
    "stage_seconds": {str: NUMBER},
    "notes": [str],
    "failed_pairs": [ROW],
    "products": [{"path": str, "what": str, "source": str}],
}
MAP = {
    "frames": int,
    "placed": int,
    "components": [int],
    "unplaced": [{"name": str, "reason": str}],
    "files": [str],
    "points": int,
    "seconds": NUMBER,
    "warnings": [str],
    "navigation": (dict, None),
    "markers": (dict, None),
}
RANGE_SCORE = {"median_relative_error": UNKNOWN, "bad_1_px": UNKNOWN, "bad_2_px": UNKNOWN, "coverage": UNKNOWN}
COLOR_SCORE = {
    "angle_deg": UNKNOWN,
    "angle_after_gains_deg": UNKNOWN,
    "ciede2000": UNKNOWN,
    "range_consistency": UNKNOWN,
    "clipped_fraction": UNKNOWN,
    "pixels": UNKNOWN,
}
SCORES = {"range": RANGE_SCORE, "color": COLOR_SCORE, "raw_color": COLOR_SCORE}
TRUTH = {"frames": [{"name": str, **SCORES}], "missing": [str], **SCORES}
SPREAD = {"luminance": float, "frame_offsets": float, "angle_deg": float, "spots": int}
SPREAD_ROW = {
    **dict.fromkeys(("method", "chart"), str),
    "charts": int,
    **dict.fromkeys(("nearest_m", "farthest_m", "angle_deg", "luminance"), NUMBER),
}
CHART_ROW = {
    "frame": str,
    "target": str,
    "method": str,
    "range_m": UNKNOWN,
    "psi_deg": UNKNOWN,
    "psi_linear_deg": UNKNOWN,
    "ciede2000": UNKNOWN,
    "clipped_fraction": UNKNOWN,
    "pixels": int,
}
FINDING = {"what": str, "ok": bool, "detail": str, "needed": bool, "without": str, "fix": str}
SETTING_VALUE = (str, int, float, bool, list, None)

STRUCTURE = ("rugosity_area", "rugosity_hvar", "fractal_dimension", "height_range_m", "vector_ruggedness", "mesh_rugosity")
MEASURED = ("planar_m2", "surface_m2", "height_m", "volume_l", "rugosity")

SHAPES: dict[str, Shape] = {
    "sync": {
        **END,
        **dict.fromkeys(("left", "right", "text"), str),
        **dict.fromkeys(("offset_s", "std_s", "drift", "drift_std", "center_s", "rest_s", "false_disparity"), NUMBER),
        **dict.fromkeys(("pairs", "left_out"), int),
        "evidence": [{"kind": str, "offset_s": NUMBER, "std_s": NUMBER}],
    },
    "live": {
        **END,
        **dict.fromkeys(("done", "failed", "dropped"), int),
        **dict.fromkeys(("last_error", "reduced"), str),
        **dict.fromkeys(("latency_median_s", "latency_p95_s", "products_median_s", "products_p95_s"), UNKNOWN),
    },
    "bag-info": {
        **END,
        "bag": str,
        "files": int,
        "seconds": NUMBER,
        "topics": [{"name": str, "type": str, "messages": int, "rate_hz": UNKNOWN}],
        "left": str,
        "right": str,
        "pairs": int,
        "unpaired": int,
        "baseline_m": UNKNOWN,
        "notes": [str],
    },
    "merge": {**END, **RUN},
    "campaign": {
        **END,
        "table": str,
        "dives": [
            {"name": str, "state": str, "ok": int, "failed": int, "seconds": NUMBER, "out": str, "error": str},
        ],
    },
    "plan": {
        **END,
        "pairs": int,
        "measured": int,
        "core_seconds_per_pair": NUMBER,
        "stage_seconds": {str: NUMBER},
        "fit_s": NUMBER,
        "disk_bytes": int,
        "memory_bytes": int,
        "wall_hours": {str: NUMBER},
        "core_hours": NUMBER,
    },
    "status": {
        **END,
        "runs": [
            {
                "out": str,
                "state": str,
                "stage": str,
                "done": int,
                "failed": int,
                "left": int,
                "failures": [[(str, int)]],
                "writer": str,
                "remaining_s": UNKNOWN,
            }
        ],
    },
    "inspect": {
        **END,
        "sides": {"left": str, "right": str, "guessed": bool},
        "left": (dict, None),
        "right": (dict, None),
        "pairs": int,
        "unpaired": int,
        "interval_s": UNKNOWN,
        "exposure_recorded": bool,
        "calibrations": [str],
        "calibration": (dict, None),
        "measured": (dict, None),
        "misfits": [{"pair": str, "fits": (str, None)}],
        "problems": [str],
        "run_command": str,
    },
    "run": {**END, **RUN, "page": str},
    "run --fuse": {**END, **RUN, "page": str, "map": MAP},
    "range": {**END, **RUN},
    "correct": {**END, **RUN, "page": str},
    "rectify": {**END, **RUN},
    "fuse": {**END, "out": str, "page": str, "map": MAP},
    "report": {**END, "out": str, "page": str, "made": int, "kept": int, "left_out": {str: str}},
    "measure": {
        **END,
        "out": str,
        "measures": [
            {
                **dict.fromkeys(("measure", "frame", "kind", "label"), str),
                **dict.fromkeys(("value", "std", "surface", "surface_std", "x_m", "y_m", "z_m"), UNKNOWN),
            }
        ],
    },
    "view": {**END, "out": str, "mesh": (str, None), "viewer": str},
    "metrics": {
        **END,
        "out": str,
        "structure": [
            {
                "edge_m": float,
                "squares": int,
                **dict.fromkeys(("mean", "standard_error", "between_squares"), dict.fromkeys(STRUCTURE, (float, None))),
            }
        ],
        "colonies": [
            {
                "name": str,
                "label": str,
                **dict.fromkeys(("measured", "standard_error"), dict.fromkeys(MEASURED, (float, None))),
                "unseen": float,
                "views": float,
            }
        ],
        "cover": [
            {
                "label": str,
                "outlines": int,
                **dict.fromkeys(("surface_m2", "surface_std_m2", "planar_m2", "of_surface", "of_surface_std", "of_planar"), float),
            }
        ],
        "unseen": [str],
        **dict.fromkeys(("cell_m", "area_m2", "height_std_m"), (float, None)),
        "files": [str],
    },
    "compare": {
        **END,
        **dict.fromkeys(("format", "first", "second"), str),
        "registration": {
            "T_first_second": [[float]],
            "covariance": [[float]],
            "center_m": [float],
            **dict.fromkeys(("features_alike", "features_agreeing"), int),
            **dict.fromkeys(("feature_rms_m", "stable_fraction", "surface_spread_m", "features_to_surfaces_m"), float),
        },
        **dict.fromkeys(("overlap_m2", "cell_m", "median_lod_m", "error_inflation", "beyond_lod"), float),
        **dict.fromkeys(("growth_l", "growth_std_l", "loss_l", "loss_std_l"), (float, int)),
        "patches": [
            {
                "number": int,
                "kind": str,
                **dict.fromkeys(("x_m", "y_m", "area_cm2", "lightness", "chroma"), float),
                **dict.fromkeys(("mean_m", "most_m", "volume_l", "volume_std_l"), (float, None)),
            }
        ],
        "joint": ({"pairs": int, "bent_m": float}, None),
        "files": [str],
    },
    "markers": {
        **END,
        "out": str,
        "frames": int,
        "markers": [
            {
                **dict.fromkeys(("number", "views"), int),
                **dict.fromkeys(("x_m", "y_m", "z_m", "residual_m", "edge_m", "edge_std_m"), float),
            }
        ],
        "size": {"ratio": float, "std": float, "lengths": int},
        "bars": dict,
        "control": {"T": [[float]], "residuals_m": dict, "rms_m": float},
        "files": [str],
    },
    "export": {**END, "out": str, "format": str, "folder": str, "frames": int, "files": int, "bytes": int, "note": str},
    "water": {
        **END,
        "out": str,
        "path": str,
        "water": dict,
        "charts": [
            {
                "frame": str,
                "target": str,
                "range_m": float,
                "residual_deg": float,
                "ciede2000_before": UNKNOWN,
                "ciede2000": UNKNOWN,
            }
        ],
        "trend": (dict, None),
        "matrix": (dict, None),
        "no_matrix": str,
    },
    "evaluate": {**END, **TRUTH},
    "evaluate --spread": {**END, "raw": SPREAD, "corrected": SPREAD, "pairs": int},
    "evaluate --chart": {
        **END,
        "rows": [CHART_ROW],
        "means": [CHART_ROW],
        "spreads": [SPREAD_ROW],
        "without_target": [str],
        "sheet": str,
    },
    "synthesize": {**END, "out": str, "spec": dict},
    "demo": {**END, **RUN, "truth": TRUTH},
    "calibrate": {
        **END,
        "calibration": str,
        "coverage_picture": str,
        "verdict": [str],
        "baseline_m": NUMBER,
        "baseline_std_m": UNKNOWN,
        "focal_std": UNKNOWN,
        "rms_left_px": NUMBER,
        "rms_right_px": NUMBER,
        "row_error_px": UNKNOWN,
        "coverage": [NUMBER],
        "views": [{"name": str, "left_px": UNKNOWN, "right_px": UNKNOWN, "reason": (str, None)}],
    },
    "calibrate --print-target": {**END, "target": str},
    "check": {
        **END,
        "rig": dict,
        "rows": dict,
        "suspicions": [str],
        "acceptable": bool,
        "advice": [str],
        "refined": (dict, None),
    },
    "convert-calib": {**END, "source": str, "out": str, "format": str, "baseline_m": NUMBER, "notes": [str]},
    "config": {
        **END,
        "settings": [{"key": str, "value": SETTING_VALUE, "default": SETTING_VALUE, "origin": str, "description": str}],
    },
    "doctor": {**END, "ready": bool, "findings": [FINDING]},
}
