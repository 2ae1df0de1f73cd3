"""Settings: defaults, files, overrides, and what is said of a mistake."""

import json
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from stereo_seecolor.config import RunConfig
from stereo_seecolor.config.file import known_keys, load_config, load_settings
from stereo_seecolor.errors import ConfigError


def test_file_then_overrides(tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text("color:\n  lock: survey\nmatching:\n  max_range_m: 7\n")
    config = load_config(tmp_path / "run.yaml", ["matching.max_range_m=9", "output.preset=lean"])
    assert (config.color.lock, config.matching.max_range_m, config.output.preset) == (
        "survey",
        9.0,
        "lean",
    )
    assert load_config() == RunConfig()


def test_dumped_configuration_loads_again() -> None:
    config = load_config(None, ["color.lock=survey"])
    assert RunConfig.model_validate(config.model_dump()) == config


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("color.lok=survey", r"there is no setting 'color\.lok'; did you mean 'color\.lock'\?"),
        ("colour.lock=survey", r"did you mean 'color\.lock'"),
        ("lock", r"write it as section\.key=value"),
        ("color.lock", r"write it as section\.key=value"),
        ("color.lock=dive", r"--set: color\.lock: must be auto, frame, survey, .*got 'dive'"),
        ("matching.max_range_m=-1", r"matching\.max_range_m: .*greater than 0"),
        ("color.lock=[", "the value cannot be read"),
        (
            "matching.min_range_m=yes",
            r"--set: matching\.min_range_m: input should be a valid number \(got True\)",
        ),
        (
            "matching.min_range_m='1'",
            r"matching\.min_range_m: input should be a valid number \(got '1'\)",
        ),
        (
            "matching.max_range_m=.inf",
            r"matching\.max_range_m: input should be a finite number \(got inf\)",
        ),
        ("mapping.voxel_m=.nan", r"mapping\.voxel_m: input should be a finite number \(got nan\)"),
        ("color.robust.white_point=[1, 1, .inf]", r"^--set: color\.robust\.white_point: "),
        (
            "color.robust.white_point=[0, 1, 1]",
            r"^--set: color\.robust\.white_point: must be scene, gray, none, or \[R, G, B\], each",
        ),
        ("color.robust.white_point=[1, -1, 1]", r"^--set: color\.robust\.white_point: must be "),
        ("color.robust.white_point=[1, .nan, 1]", r"^--set: color\.robust\.white_point: must be "),
        (
            "color.objective=paper",
            r"no setting 'color\.objective'; it is now color\.method: .*objective=paper is "
            r"method=paper$",
        ),
        (
            "color.solver=dense",
            r"no setting 'color\.solver'; it is now color\.method: solver=dense is method=paper",
        ),
        ("color={solver: dense}", r"no setting 'color\.solver'; it is now color\.method"),
        ("color.white_point=none", r"it is now color\.robust\.white_point$"),
        (
            "color.method=paper-adam",
            r"^--set: color\.method: it is now paper, which trains by Adam",
        ),
        ("input.video_every=5", r"it is now input\.video_step$"),
        ("input.video_overlap=0.7", r"it is now input\.video_step, a number below 1$"),
        ("color.lock=sliding", r"color\.lock: it is now the number of frames that share one water"),
        ("color.lock=0", r"color\.lock: must be auto, frame, survey, or a number of frames from 1"),
        ("color.sliding_frames=9", r"it is now the number that color\.lock takes: color\.lock=20$"),
        ("color.first_steps=3", r"it is now color\.paper\.iterations$"),
        (
            "color.paper_adam.next_steps=3",
            r"its settings are now color\.paper\.iterations and iterations_per_frame",
        ),
        ("color.paper.penalty=3", r"it is fixed"),
        ("color.robust.scene_colors=gray", r"is now color\.robust\.white_point=gray"),
        ("matching.device=cpu", r"it is now device, or --device"),
        ("color.clipped_fraction=0.1", r"brightness is now set by color\.median_luminance$"),
        ("color.robust.white_point=[1, yes, 1]", r"^--set: color\.robust\.white_point: "),
        ("input.video_step=1.5", r"input\.video_step: must be a whole number, or below 1"),
        ("matching.fill=1", r"matching\.fill: input should be a valid boolean"),
        ("output.clouds=false", r"it is now output\.preset=no-clouds"),
        ("color.input_noise=0.01", r"gains stop where noise of 1\.5 of 255 would pass 0\.06"),
        ("color.output_noise=0.1", r"gains stop where noise of 1\.5 of 255 would pass 0\.06"),
        ("color.robust.attenuation=constant", r"attenuation always varies with range"),
        ("color.robust.water_depth_m=5", r"the light at the reef is fitted with the water"),
        ("measuring.length_error=0.01", r"the calibration's own standard errors"),
        ("mapping.max_speed_m_s=5", r"a step faster than 3 m/s and than three times the usual"),
        ("matching.model=net.onnx", r"it is now matching\.engine=NET\.onnx$"),
        ("matching.engine=onnx", r"name the network's file itself: matching\.engine=NET\.onnx"),
        ("mapping.loop_closure=false", r"loops are always closed"),
        ("mapping.mount=5", r"mapping\.mount: "),
        (
            "mapping.mount={xyz: [1, 0, 0]}",
            r"there is no setting 'mapping\.mount\.xyz'; did you mean 'mapping\.mount\.xyz_m'",
        ),
        (
            "mapping.mount.xyz=[1,0,0]",
            r"there is no setting 'mapping\.mount\.xyz'; did you mean 'mapping\.mount\.xyz_m'",
        ),
        ("mapping.mount.sway_m=1", r"it is now mapping\.mount\.xyz_m=\[surge, sway, heave\]$"),
        ("mapping.mount={yaw_deg: 0}", r"it is now mapping\.mount\.rpy_deg=\[roll, pitch, yaw\]$"),
        ("mapping.mount.rpy_deg=[1, 2]", r"^--set: mapping\.mount\.rpy_deg: must be three numbers"),
        ("mapping.mount.xyz_m=0,0,1", r"^--set: mapping\.mount\.xyz_m: must be three numbers"),
        ("mapping.voxel_m.x=1", r"there is no setting 'mapping\.voxel_m\.x'"),
        ("color.lock=2020-13-45", "the value cannot be read"),
    ],
)
def test_bad_overrides(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_config(None, [override])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            "color: {lok: survey}",
            r"run\.yaml: there is no setting 'color\.lok'; did you mean 'color\.lock'",
        ),
        ("colr: {}", r"there is no setting 'colr'; did you mean 'color'"),
        ("- a", r"must hold sections .*got a list"),
        ("a: [", "is not YAML"),
        ("[color]\nlock = 'survey'\n", "is not YAML: .*: write a section as section: and its"),
        ("color:\n\tlock: survey\n", "is not YAML: .*: indent by spaces, not by tabs"),
        ("color.lock: survey", r"run\.yaml: color\.lock: write its parts on lines of their own"),
        ("input: {bayer: none}\ninput: {refine: true}", "'input' is given twice.* line 2"),
        ("color: 5", r"run\.yaml: color: "),
        (
            "matching: {max_range_m: .inf}",
            r"run\.yaml: matching\.max_range_m: input should be a finite number",
        ),
        (
            "matching: {min_range_m: yes}",
            r"run\.yaml: matching\.min_range_m: input should be a valid number",
        ),
        ("a: " + "[" * 5000, "is not YAML"),
        ("{1: 2}", r"run\.yaml: "),
        (
            '{"format": "stereo-seecolor/run", "config": {"color": {"lok": 1}}}',
            r"no setting 'color\.lok'",
        ),
        ('{"format": "stereo-seecolor/run", "config": 3}', "must hold sections .*got a int"),
    ],
)
def test_bad_files(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "run.yaml").write_text(content)
    with pytest.raises(ConfigError, match=message):
        load_config(tmp_path / "run.yaml")


@pytest.mark.parametrize(
    "content", ["", "# matching:", "matching:\n  # max_range_m: 6", "color:\n  robust:\n"]
)
def test_files_and_sections_of_comments_alone_change_nothing(tmp_path: Path, content: str) -> None:
    (tmp_path / "run.yaml").write_text(content)
    assert load_config(tmp_path / "run.yaml") == RunConfig()


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"run\.yaml: cannot be read"):
        load_config(tmp_path / "run.yaml")


def undescribed(model: type[BaseModel], where: str = "") -> list[str]:
    found = []
    for name, field in model.model_fields.items():
        if isinstance(field.default, BaseModel):
            found += undescribed(type(field.default), f"{where}{name}.")
        elif not field.description:
            found.append(where + name)
    return found


def test_every_setting_is_described() -> None:
    assert undescribed(RunConfig) == []
    assert {"color.lock", "mapping.mount.rpy_deg"} <= set(known_keys())


def test_a_mapping_sets_the_keys_it_names() -> None:
    config = load_config(
        None,
        [
            "mapping.mount.rpy_deg=[3, 0, 45]",
            "mapping.mount={xyz_m: [0.4, 0, 0]}",
            "color={lock: survey}",
        ],
    )
    mount = config.mapping.mount
    assert (mount.rpy_deg, mount.xyz_m) == ((3, 0, 45), (0.4, 0, 0))
    assert config.color.lock == "survey"


@pytest.mark.parametrize(
    ("text", "number"), [("1e-3", 0.001), ("2.5E+1", 25.0), ("3", 3.0), (".5e1", 5.0)]
)
def test_numbers_as_people_write_them(text: str, number: float) -> None:
    assert load_config(None, [f"mapping.voxel_m={text}"]).mapping.voxel_m == number


def test_lists_and_paths_are_read() -> None:
    config = load_config(
        None, ["color.robust.white_point=[1, 0.9, 0.8]", "matching.engine=net.onnx"]
    )
    assert (config.color.robust.white_point, config.matching.engine) == (
        (1, 0.9, 0.8),
        Path("net.onnx"),
    )


def test_the_configuration_of_a_run_is_taken_from_its_run_json(tmp_path: Path) -> None:
    files = (
        "matching.engine=net.onnx",
        "input.exposures=exposures.csv",
        "mapping.markers={bars: bars.csv, points: places.csv}",
    )
    config = load_config(
        None, ["color.lock=survey", "color.robust.white_point=[1, 0.9, 0.8]", *files]
    )
    assert config.mapping.markers.bars == Path("bars.csv")
    run = {"format": "stereo-seecolor/run", "inputs": {}, "config": config.model_dump(mode="json")}
    (tmp_path / "run.json").write_text(json.dumps(run))
    assert load_config(tmp_path / "run.json") == config
    assert load_config(tmp_path / "run.json", ["color.lock=frame"]).color.lock == "frame"


def test_every_setting_tells_where_its_value_comes_from(tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text(
        "color:\n  lock: survey\nmapping: {mount: {rpy_deg: [0, 0, 0]}, voxel_m: 0.02}\n"
    )
    settings = {s.key: s for s in load_settings(tmp_path / "run.yaml", ["mapping.voxel_m=0.05"])}
    assert settings.keys() == set(known_keys())
    found = {
        key: (s.value, s.default, s.origin) for key, s in settings.items() if s.origin != "default"
    }
    assert found == {
        "color.lock": ("survey", "auto", str(tmp_path / "run.yaml")),
        "mapping.mount.rpy_deg": ((0, 0, 0), (0, 0, 90), str(tmp_path / "run.yaml")),
        "mapping.voxel_m": (0.05, 0.01, "--set"),
    }
    assert all(setting.description for setting in settings.values())


def test_an_error_names_the_layer_that_brought_the_value(tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text("mapping: {voxel_m: -1}\n")
    with pytest.raises(ConfigError, match=r"run\.yaml: mapping\.voxel_m"):
        load_config(tmp_path / "run.yaml", ["color.lock=survey"])
    with pytest.raises(ConfigError, match=r"^--set: mapping\.tile_m"):
        load_config(tmp_path / "run.yaml", ["mapping.voxel_m=1", "mapping.tile_m=-1"])


@pytest.mark.posix
def test_a_named_pipe_is_no_configuration(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "run.yaml")
    with pytest.raises(ConfigError, match="is a named pipe"):
        load_config(tmp_path / "run.yaml")


def test_nested_settings_can_be_overridden() -> None:
    mount = load_config(None, ["mapping.mount.rpy_deg=[0, 0, 45]"]).mapping.mount
    assert mount.rpy_deg == (0, 0, 45)


@given(st.text(max_size=60))
def test_any_override_is_taken_or_refused_in_one_line(text: str) -> None:
    try:
        load_config(None, [text])
    except ConfigError as error:
        assert "\n" not in str(error) or "\n" in text
