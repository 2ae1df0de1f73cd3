"""A water's limits, its file and its text."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereo_seecolor.errors import ColorError, InputError
from stereo_seecolor.records import Water
from stereo_seecolor.run_folder.water_file import read_waters, waters_content


def some_water(**parts: object) -> Water:
    channel = np.array([0.3, 0.1, 0.05])
    water = Water(
        channel, channel, 0 * channel, channel, w=channel, v=channel, y=channel, x=0 * channel
    )
    return replace(water, **parts)


NAN, TINY, HUGE = (np.array([0.1, bad, 0.1]) for bad in (np.nan, -5.0, 1e300))


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        (
            {"white": np.array([1.0, 0, 1])},
            r"white must be from 1e-12 to 1e\+06 in each channel \(got \[1\.0, 0\.0, 1\.0\]\)",
        ),
        ({"white": -np.ones(3)}, "white must be from"),
        ({"white": NAN}, "white must be from"),
        (
            {"beta": TINY},
            r"beta must be from 0 to 10000 in each channel \(got \[0\.1, -5\.0, 0\.1\]\)",
        ),
        ({"beta": HUGE}, "beta must be from"),
        ({"gamma_inf": TINY}, "gamma_inf must be from 0"),
        ({"alpha": NAN}, "alpha must be from"),
        ({"y": HUGE}, "y must be from -10000 to 10000"),
        ({"y": TINY}, "w and y let light grow with range"),
        ({"w": np.full(3, -0.3)}, "w and y let light grow with range"),
        ({"x": np.ones(2)}, "x needs three numbers, one a channel"),
        ({"exposure": 0.0}, r"exposure must be a number from 1e-12 to 1e\+12 \(got 0\.0\)"),
        ({"exposure": float("nan")}, "exposure must be a number"),
        ({"exposure": True}, "exposure must be a number"),
        ({"highlights": 0.5}, "highlights must be a number from 1 to"),
        ({"input_encoding": "rgb"}, "input_encoding must be srgb, linear or as-is"),
        ({"matrix": np.eye(2)}, "matrix needs three rows of three numbers from -10 to 10"),
        ({"matrix": np.full((3, 3), np.nan)}, "matrix needs three rows"),
        (
            {"matrix": 2 * np.eye(3)},
            r"matrix must have rows that sum to 1 \(got \[2\.0, 2\.0, 2\.0\]\)",
        ),
        ({"matrix_errors": np.ones(3)}, "matrix_errors needs three rows"),
        ({"standard_errors": {"y": np.full(3, -1.0)}}, "the standard error of y must be from 0"),
    ],
)
def test_what_no_water_has_is_refused(parts: dict[str, object], message: str) -> None:
    with pytest.raises(ColorError, match=f"^water: {message}"):
        some_water(**parts)


def test_attenuation_may_rise_with_range_while_light_falls() -> None:
    rising = some_water(w=np.full(3, -0.05), v=np.full(3, 0.25), y=np.full(3, 0.1), x=np.zeros(3))
    assert (np.diff(rising.attenuation(np.linspace(0, 20, 50)), axis=0) < 0).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"white": [0, 1, 1]}, r"w\.json: water: white must be"),
        ({"beta": [-5, 0.1, 0.1]}, "beta must be"),
        ({"gamma_inf": [1e300, 0, 0]}, "gamma_inf must be"),
        ({"y": [None, 1, 1]}, "y must be"),
        ({"beta": "123"}, "beta needs three numbers"),
        ({"beta": None}, "beta needs three numbers"),
        ({"standard_errors": {"y": 3}}, "standard error of y needs three numbers"),
        ({"beta": [1, 2]}, "beta needs three numbers"),
        ({"exposure": 0}, "exposure must be"),
        ({"standard_errors": 3}, "is damaged"),
        ({"matrix": [[1, 0], [0, 1]]}, "matrix needs three rows"),
        ({"matrix": "wide"}, "is damaged"),
        ({"turbidity": 3}, "is damaged: .*turbidity"),
    ],
)
def test_a_file_with_what_no_water_has_is_refused(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    path = tmp_path / "w.json"
    some_water().save(path)
    content = json.loads(path.read_text())
    content["water"].update(change)
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=message):
        Water.load(path)
    with pytest.raises(InputError, match=message):
        read_waters(path, ["a"])


def test_saved_and_loaded_it_is_the_same(tmp_path: Path) -> None:
    water = some_water(
        exposure=1.5,
        highlights=2.0,
        warnings=("little relief",),
        standard_errors={"y": np.array([0.1, np.nan, 0.2])},
        matrix=np.array([[1.2, -0.2, 0], [0, 1, 0], [0, -0.1, 1.1]]),
        matrix_errors=np.full((3, 3), 0.02),
    )
    water.save(tmp_path / "w.json")
    assert (
        Water.load(tmp_path / "w.json").content()
        == water.content()
        == read_waters(tmp_path / "w.json", ["a"])["a"].content()
    )


def test_each_frames_own_water_is_not_one_water(tmp_path: Path) -> None:
    (tmp_path / "w.json").write_bytes(
        b"".join(waters_content({"a": some_water(), "b": some_water(exposure=2.0)}))
    )
    with pytest.raises(
        InputError,
        match=r"contains separate water parameters for each frame: run with color\.lock=survey",
    ):
        Water.load(tmp_path / "w.json")


def test_its_text_is_one_short_line() -> None:
    text = repr(some_water())
    assert text.startswith("Water(transmission_1m=[")
    assert len(text) < 160
    assert "srgb" not in text and "as-is" in repr(replace(some_water(), input_encoding="as-is"))
