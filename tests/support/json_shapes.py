"""What --json prints of each command: the keys and types that docs/json.md promises to scripts."""

from typing import Any

# a type, a tuple of types and None, [shape], {key: shape}, or {str: shape} for any keys
Shape = Any
NUMBER = (int, float)
UNKNOWN = (int, float, None)
"""A number, or null where it is not known."""


def mismatch(value: Any, shape: Shape, where: str = "$") -> str | None:
    """Where a parsed JSON value differs from a shape; None if it does not. Keys beyond those of the
    shape are a difference, too.
    """
    if isinstance(shape, dict):
        return _object_mismatch(value, shape, where)
    if isinstance(shape, list):
        if not isinstance(value, list):
            return f"{where} is no list: {value!r}"
        return next(
            (
                found
                for i, item in enumerate(value)
                if (found := mismatch(item, shape[0], f"{where}[{i}]"))
            ),
            None,
        )
    allowed = shape if isinstance(shape, tuple) else (shape,)
    fits = type(value) in allowed or (value is None and None in allowed)
    return None if fits else f"{where} is {value!r}, not {allowed}"


def _object_mismatch(value: Any, shape: dict[Any, Shape], where: str) -> str | None:
    if not isinstance(value, dict):
        return f"{where} is no object: {value!r}"
    if set(shape) == {str}:
        return next(
            (
                found
                for key, item in value.items()
                if (found := mismatch(item, shape[str], f"{where}.{key}"))
            ),
            None,
        )
    if value.keys() != shape.keys():
        return (
            f"{where}: missing {sorted(shape.keys() - value.keys())}, unexpected "
            f"{sorted(value.keys() - shape.keys())}"
        )
    return next(
        (found for key in shape if (found := mismatch(value[key], shape[key], f"{where}.{key}"))),
        None,
    )


def keys(kind: Shape, names: str) -> dict[str, Shape]:
    """Keys whose values are all of one shape."""
    return dict.fromkeys(names.split(), kind)


END = {"command": str, "exit_code": int}
ERROR = {"error": str, "exit_code": int}
ROW = {
    **keys(str, "name status left right error"),
    **{"timestamp_s": UNKNOWN, "kept": bool, "warnings": [str]},
    **{"hashes": {str: str}, "seconds": {str: NUMBER}, "facts": {str: UNKNOWN}},
}
RUN = {
    **keys(int, "pairs ok failed unpaired_files pending kept"),
    **{
        "out": str,
        "stopped": bool,
        "wall_seconds": NUMBER,
        "stage_seconds": {str: NUMBER},
        "notes": [str],
        "failed_pairs": [ROW],
    },
    "products": [keys(str, "path what source")],
}
MAP = {
    **keys(int, "frames placed points"),
    **keys([str], "files warnings"),
    **keys((dict, None), "navigation markers"),
    **{"components": [int], "unplaced": [keys(str, "name reason")]},
    **keys(NUMBER, "seconds missing_fraction"),
}
RANGE_SCORE = keys(UNKNOWN, "median_relative_error bad_1_px bad_2_px coverage")
COLOR_SCORE = keys(
    UNKNOWN, "angle_deg angle_after_gains_deg ciede2000 range_consistency clipped_fraction pixels"
)
SCORES = {"range": RANGE_SCORE, "color": COLOR_SCORE, "raw_color": COLOR_SCORE}
TRUTH = {"frames": [{"name": str, **SCORES}], "missing": [str], **SCORES}
SPREAD = {
    **keys(float, "luminance frame_offsets angle_deg"),
    "spots": int,
    **keys([UNKNOWN], "border border_error"),
    "far_red_to_blue": UNKNOWN,
}
SPREAD_ROW = {
    **keys(str, "method chart"),
    "charts": int,
    **keys(NUMBER, "nearest_m farthest_m angle_deg luminance"),
}
CHART_ROW = {
    **keys(str, "frame target method"),
    **keys(UNKNOWN, "range_m psi_deg psi_linear_deg ciede2000 clipped_fraction chroma"),
    "pixels": int,
}
SETTING_VALUE = (str, int, float, bool, list, None)
STRUCTURE = keys(
    (float, None),
    "rugosity_area rugosity_hvar fractal_dimension height_range_m vector_ruggedness mesh_rugosity",
)
MEASURED = keys((float, None), "planar_m2 tilted_m2 surface_m2 mesh_m2 height_m volume_l rugosity")

SHAPES: dict[str, Shape] = {
    "sync": {
        **keys(str, "left right text"),
        **keys(NUMBER, "offset_s std_s drift drift_std center_s rest_s false_disparity"),
        **keys(int, "pairs left_out"),
        "evidence": [{"kind": str, **keys(NUMBER, "offset_s std_s")}],
    },
    "live": {
        **keys(int, "done failed biased dropped"),
        **keys(str, "last_error reduced waiting"),
        **keys(bool, "has_unpaired"),
        "notes": [str],
        "wrong": [str],
        **keys(UNKNOWN, "latency_median_s latency_p95_s products_median_s products_p95_s"),
    },
    "bag-info": {
        **keys(str, "bag left right"),
        **keys(int, "files pairs unpaired"),
        **{"seconds": NUMBER, "baseline_m": UNKNOWN, "notes": [str]},
        "topics": [{"name": str, "type": str, "messages": int, "rate_hz": UNKNOWN}],
    },
    "merge": RUN,
    "campaign": {
        "table": str,
        "dives": [
            {**keys(str, "name state out error asked"), **keys(int, "ok failed"), "seconds": NUMBER}
        ],
    },
    "plan": {
        **keys(int, "pairs measured disk_bytes memory_bytes"),
        **keys(NUMBER, "core_seconds_per_pair fit_s core_hours"),
        **keys({str: NUMBER}, "stage_seconds wall_hours"),
    },
    "status": {
        "runs": [
            {
                **keys(str, "out state stage writer rests_on problem"),
                **keys(int, "done failed left"),
                **{
                    "failures": [[(str, int)]],
                    "to_come": [str],
                    **keys(UNKNOWN, "remaining_s run_remaining_s"),
                },
            }
        ]
    },
    "inspect": {
        "sides": {"left": str, "right": str, "guessed": bool, "others": [str]},
        **keys((dict, None), "left right calibration measured"),
        **keys(int, "pairs unpaired"),
        **keys([str], "calibrations wrong problems"),
        **{"interval_s": UNKNOWN, "exposure_recorded": bool, "agrees": bool, "run_command": str},
        "misfits": [{"pair": str, "fits": (str, None)}],
        "poses": [{**keys(str, "path format by"), **keys(int, "poses pairs")}],
    },
    "run": {**RUN, "page": str},
    "run --fuse": {**RUN, "page": str, "map": MAP},
    "range": RUN,
    "correct": {**RUN, "page": str},
    "rectify": RUN,
    "fuse": {"out": str, "page": str, "map": MAP},
    "report": {"out": str, "page": str, "made": int, "kept": int, "left_out": {str: str}},
    "measure": {
        "out": str,
        "measures": [
            {
                **keys(str, "measure frame kind label"),
                **keys(UNKNOWN, "value std surface surface_std x_m y_m z_m known"),
                "note": str,
            }
        ],
    },
    "view": {"out": str, "mesh": (str, None), "viewer": str},
    "metrics": {
        "note": str,
        "out": str,
        "structure": [
            {
                "edge_m": float,
                "scale_m": float,
                "squares": int,
                **keys(STRUCTURE, "mean standard_error between_squares mapped"),
            }
        ],
        "colonies": [
            {
                **keys(str, "name label"),
                **keys(MEASURED, "measured standard_error"),
                **keys(float, "unseen views counted"),
            }
        ],
        "cover": [
            {
                **{"label": str, "outlines": int},
                **keys(
                    float,
                    "surface_m2 surface_std_m2 planar_m2 of_seen of_outlined_planar "
                    "of_outlined_surface of_outlined_surface_std",
                ),
            }
        ],
        **keys((float, None), "cell_m area_m2 height_std_m"),
        **keys([str], "unseen files"),
        "point_cover": [
            {**keys(str, "label"), **keys(int, "points"), **keys(float, "fraction low high")}
        ],
        **keys(int, "unseen_points"),
    },
    "compare": {
        **keys(str, "format first second position_note"),
        "registration": {
            **{"T_first_second": [[float]], "covariance": [[float]], "center_m": [float]},
            **keys(int, "features_alike features_agreeing"),
            **keys(float, "scale scale_std"),
            **keys(float, "feature_rms_m stable_fraction surface_spread_m features_to_surfaces_m"),
        },
        **keys(float, "overlap_m2 cell_m median_lod_m error_inflation beyond_lod"),
        **keys((float, int), "growth_l growth_std_l loss_l loss_std_l"),
        "patches": [
            {
                **{"number": int, "kind": str},
                **keys(float, "x_m y_m area_cm2 lightness chroma"),
                **keys((float, None), "mean_m most_m volume_l volume_std_l"),
            }
        ],
        "joint": ({"pairs": int, "bent_m": float}, None),
        "files": [str],
    },
    "markers": {
        **{"out": str, "frames": int, "bars": dict, "files": [str]},
        **{"doubts": [str], "not_found": [str]},
        "markers": [
            {**keys(int, "number views"), **keys(float, "x_m y_m z_m residual_m edge_m edge_std_m")}
        ],
        "size": {"ratio": float, "std": float, "lengths": int, "cells": int, "odd": [int]},
        "control": {"T": [[float]], "residuals_m": dict, "rms_m": float, "doubt": str},
    },
    "export": {**keys(str, "out format folder note"), **keys(int, "frames files bytes")},
    "water": {
        **keys(str, "out path no_matrix"),
        **keys((dict, None), "trend matrix"),
        **keys([str], "left_out doubts"),
        "water": dict,
        "charts": [
            {
                **keys(str, "frame target"),
                **keys(float, "range_m residual_deg"),
                **keys(UNKNOWN, "ciede2000_before ciede2000"),
            }
        ],
    },
    "evaluate": TRUTH,
    "evaluate --spread": {"raw": SPREAD, "corrected": SPREAD, "others": dict, "pairs": int},
    "evaluate --chart": {
        **keys([CHART_ROW], "rows means"),
        **{"spreads": [SPREAD_ROW], "without_target": [str], "missing": dict, "sheet": str},
    },
    "synthesize": {"out": str, "spec": dict},
    "demo": {**RUN, "truth": TRUTH},
    "calibrate": {
        **{"calibration": str, "coverage_picture": str, "verdict": [str], "coverage": [NUMBER]},
        **keys(NUMBER, "baseline_m rms_left_px rms_right_px"),
        **keys(UNKNOWN, "baseline_std_m focal_std row_error_px"),
        "views": [{"name": str, "left_px": UNKNOWN, "right_px": UNKNOWN, "reason": (str, None)}],
    },
    "calibrate --print-target": {"target": str},
    "check": {
        **keys(dict, "rig rows"),
        **keys([str], "suspicions notes advice"),
        "acceptable": bool,
        "refined": (dict, None),
    },
    "convert-calib": {
        **keys(str, "source out format"),
        **{"baseline_m": NUMBER, "notes": [str], "readings": int},
    },
    "config": {
        "settings": [
            {**keys(str, "key origin description"), **keys(SETTING_VALUE, "value default")}
        ]
    },
    "doctor": {
        "ready": bool,
        "findings": [{**keys(str, "what detail without fix"), **keys(bool, "ok needed")}],
    },
}
SHAPES = {command: {**END, **shape} for command, shape in SHAPES.items()}
