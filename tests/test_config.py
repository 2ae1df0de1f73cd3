"""Settings: defaults, files, overrides, and what is said of a mistake."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from stereo_seecolor.config import RunConfig, known_keys, load_config
from stereo_seecolor.errors import ConfigError


def test_file_then_overrides(tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text("color:\n  lock: survey\nmatching:\n  max_range_m: 7\n")
    config = load_config(tmp_path / "run.yaml", ["matching.max_range_m=9", "output.clouds=false"])
    assert (config.color.lock, config.matching.max_range_m, config.output.clouds) == ("survey", 9.0, False)
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
        ("color.lock=dive", r"--set: color\.lock: input should be .*got 'dive'"),
        ("matching.max_range_m=-1", r"matching\.max_range_m: .*greater than 0"),
        ("color.lock=[", "the value cannot be read"),
    ],
)
def test_bad_overrides(override: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_config(None, [override])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("color: {lok: survey}", r"run\.yaml: there is no setting 'color\.lok'; did you mean 'color\.lock'"),
        ("colr: {}", r"there is no setting 'colr'; did you mean 'color'"),
        ("- a", r"must hold sections .*got a list"),
        ("a: [", "is not YAML"),
        ("color: 5", r"run\.yaml: color: "),
    ],
)
def test_bad_files(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "run.yaml").write_text(content)
    with pytest.raises(ConfigError, match=message):
        load_config(tmp_path / "run.yaml")


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
    assert {"color.lock", "mapping.mount.yaw_deg"} <= set(known_keys())


def test_nested_settings_can_be_overridden() -> None:
    assert load_config(None, ["mapping.mount.yaw_deg=45"]).mapping.mount.yaw_deg == 45


@given(st.text(max_size=60))
def test_any_override_is_taken_or_refused_in_one_line(text: str) -> None:
    try:
        load_config(None, [text])
    except ConfigError as error:
        assert "\n" not in str(error) or "\n" in text
