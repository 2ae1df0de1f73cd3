"""Broken calibration files: each gives one clear line, soon, and runs nothing."""

import re
import time
from pathlib import Path

import pytest
from calibration_texts import KALIBR, NATIVE, ROS_LEFT, ROS_RIGHT, WHOLE_RIGS
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration import CalibrationError, StereoRig
from calibration.formats import load_rig

CANARY = "touched_by_a_calibration_file"


def _corpus() -> dict[str, bytes]:
    corpus: dict[str, bytes] = {}
    for name, text in WHOLE_RIGS.items():
        corpus[f"{name}: truncated"] = text[: len(text) // 2].encode()
        corpus[f"{name}: cut after three fifths"] = text[: len(text) * 3 // 5].encode()
        corpus[f"{name}: NaN"] = re.sub(r"\d+\.\d*", "NaN", text).encode()
        corpus[f"{name}: huge"] = re.sub(r"\d+\.\d*", "1e400", text).encode()
        corpus[f"{name}: words"] = re.sub(r"\d\d+\.?\d*", "wide", text).encode()
        corpus[f"{name}: UTF-16 cut"] = text.encode("utf-16")[:-1]
        corpus[f"{name}: binary"] = text.encode()[:100] + bytes(range(256))
        corpus[f"{name}: only keys"] = re.sub(r"[:=<].*", "", text).encode()
    by_hand = {
        "empty": "",
        "blank": " \n\n\t\n",
        "comment": "# nothing\n",
        "scalar": "42",
        "list": "- 1\n- 2\n",
        "null": "~",
        "tabs": KALIBR.replace("  ", "\t"),
        "tab in native": NATIVE.replace("  model", "\tmodel"),
        "code by tag": f"!!python/object/apply:os.system ['touch {CANARY}']",
        "code in a value": NATIVE.replace(
            "water", f"!!python/object/apply:os.system ['touch {CANARY}']"
        ),
        "code by module": NATIVE.replace("water", "!!python/module:antigravity"),
        "unknown tag": NATIVE.replace("left:", "left: !camera"),
        "alias bomb": "a: &a [1,1,1,1,1,1,1,1,1]\n"
        + "".join(
            f"{c}: &{c} [{','.join(['*' + chr(ord(c) - 1)] * 9)}]\n" for c in "bcdefghijklmn"
        ),
        "alias bomb in native": "a: &a [1,1,1,1,1,1,1,1,1]\nb: &b [*a,*a,*a,*a,*a,*a,*a,*a]\nc: "
        "&c [*b,*b,*b,*b,*b,*b]\n"
        "d: &d [*c,*c,*c,*c,*c]\nformat: stereo-seecolor/rig\nversion: [*d,*d,*d,*d,*d,*d,*d]\n",
        "recursive alias": "format: stereo-seecolor/rig\nversion: &a [*a]\n",
        "undefined alias": "a: *nowhere\n",
        "deep list": "a: " + "[" * 100_000,
        "deep mapping": '{"a":' * 40_000,
        "deep blocks": "- " * 100_000,
        "deep XML": "<a>" * 50_000 + "</a>" * 20_000,
        "nested XML": "<a>" * 5_000 + "</a>" * 5_000,
        "XML entities": '<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b '
        '"&a;&a;&a;">]><K1>&b;</K1>',
        "XML external entity": "<!DOCTYPE x [<!ENTITY a SYSTEM "
        '"file:///etc/passwd">]><opencv_storage><K1>&a;</K1></opencv_storage>',
        "XML cut": "<?xml version='1.0'?><opencv_storage><K1>",
        "JSON cut": '{"K1": [1, 2',
        "many values": "a: [" + "1," * 100_000 + "1]",
        "too large": "a: 1\n" * 1_000_000,
        "many digits": NATIVE.replace("version: 1", "version: " + "9" * 100_000),
        "many hexadecimal digits": NATIVE.replace("version: 1", "version: 0x" + "f" * 100_000),
        "no such date": NATIVE.replace("water", "2001-44-55"),
        "key twice": NATIVE + "medium: air\n",
        "key twice in XML": "<opencv_storage><R>1</R><R>2</R></opencv_storage>",
        "key twice in JSON": '{"R": 1, "R": 2}',
        "two documents": NATIVE + "---\n- 1\n",
        "unhashable key": "? [1, 2]\n: 3\n",
        "unknown key": NATIVE + "baseline_mm: 100\n",
        "version of tomorrow": NATIVE.replace("version: 1", "version: 2"),
        "negative size": NATIVE.replace("[640, 480]", "[-640, 480]"),
        "enormous size": NATIVE.replace("[640, 480]", "[640000000, 480]"),
        "size of three": NATIVE.replace("[640, 480]", "[640, 480, 3]"),
        "ragged K": NATIVE.replace("[0.0, 500.0, 240.0]", "[500.0, 240.0]"),
        "zero focal length": NATIVE.replace("500.0", "0.0"),
        "three coefficients": NATIVE.replace("[-0.1, 0.01, 0.0, 0.0, 0.0]", "[-0.1, 0.01, 0.0]"),
        "infinite coefficient": NATIVE.replace("[-0.1, 0.01", "[.inf, 0.01"),
        "overflowing baseline": NATIVE.replace("-0.1]", "-1.0e+300]"),
        "overflowing rotation": NATIVE.replace(
            "[[1.0, 0.0, 0.0, -0.1]", "[[1.0e+300, 0.0, 0.0, -0.1]"
        ),
        "last row": NATIVE.replace("0.0, 0.0, 0.0, 1.0]]", "0.0, 0.0, 0.0, 2.0]]"),
        "a picture": "\x89PNG\r\n\x1a\n",
        "true for a number": KALIBR.replace("461.6", "true"),
        "fractional size": KALIBR.replace("[752, 480]", "[752.5, 480]"),
        "ros alone": ROS_LEFT,
        "string for a section": KALIBR.replace("cam1:\n", "cam1: yes\nother:\n"),
    }
    return corpus | {name: text.encode("utf-8") for name, text in by_hand.items()}


CORPUS = _corpus()


def load(file: Path) -> StereoRig | str:
    """The rig, or the message; anything but CalibrationError goes through to the test."""
    try:
        return load_rig(file, image_size=(640, 480))
    except CalibrationError as error:
        return str(error)


def test_corpus_is_large_enough() -> None:
    assert len(CORPUS) >= 60


@pytest.mark.slow
@pytest.mark.posix
@pytest.mark.parametrize("name", CORPUS)
def test_one_clear_line_soon(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import resource

    monkeypatch.chdir(tmp_path)
    file = tmp_path / "cam.yaml"
    file.write_bytes(CORPUS[name])
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.process_time()
    message = load(file)
    assert time.process_time() - start < 1.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak_kb < 200_000
    assert isinstance(message, str)
    assert "\n" not in message
    assert len(message) < 600
    assert message.startswith(str(file))
    assert not (tmp_path / CANARY).exists()


def test_missing_file_and_empty_folder(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match="cannot be read"):
        load_rig(tmp_path / "nothing.yaml")
    with pytest.raises(CalibrationError, match="no file that can be read"):
        load_rig(tmp_path)


@pytest.mark.slow
@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    text=st.sampled_from(sorted(WHOLE_RIGS.values())),
    cut=st.tuples(st.floats(0, 1), st.integers(0, 60)),
    put=st.one_of(
        st.text(max_size=12),
        st.sampled_from([": ", "\n", "[", "- ", "!!", "*a", "&a ", "1e999", "-", "{", "'", "\x00"]),
    ),
)
def test_any_edit_gives_a_rig_or_one_line(
    text: str, cut: tuple[float, int], put: str, tmp_path: Path
) -> None:
    start = int(cut[0] * len(text))
    file = tmp_path / "cam.yaml"
    file.write_bytes((text[:start] + put + text[start + cut[1] :]).encode("utf-8", "surrogatepass"))
    found = load(file)
    assert isinstance(found, StereoRig) or "\n" not in found


@pytest.mark.slow
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(start=st.floats(0, 1), cut=st.integers(0, 60), put=st.text(max_size=12))
def test_any_edit_of_a_ros_pair_gives_a_rig_or_one_line(
    start: float, cut: int, put: str, tmp_path: Path
) -> None:
    at = int(start * len(ROS_RIGHT))
    (tmp_path / "left.yaml").write_text(ROS_LEFT)
    (tmp_path / "right.yaml").write_bytes(
        (ROS_RIGHT[:at] + put + ROS_RIGHT[at + cut :]).encode("utf-8", "surrogatepass")
    )
    try:
        load_rig(f"{tmp_path}/left.yaml,{tmp_path}/right.yaml")
    except CalibrationError as error:
        assert "\n" not in str(error)
