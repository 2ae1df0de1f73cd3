"""A recording takes the place of no file but an earlier recording of this program that the run does
not read.
"""

from pathlib import Path

import pytest

FOREIGN = (
    b"\x89MCAP0\r\n\x01" + (24).to_bytes(8, "little") + b"\x04\0\0\0ros2" + b"\x09\0\0\0rosbag2 1"
)


@pytest.mark.parametrize(
    "victim", ["cam.yaml", "L/0000.png", "notes.txt", "of_a_robot.mcap", "empty.mcap"]
)
def test_only_recordings_of_this_program_are_replaced(
    make_dive, cli, tmp_path: Path, victim: str
) -> None:
    dive = make_dive(2)
    file = dive.root / victim
    for name, content in (
        ("notes.txt", b"stereo-seecolor 1"),
        ("of_a_robot.mcap", FOREIGN),
        ("empty.mcap", b""),
    ):
        (dive.root / name).write_bytes(content)
    before = file.read_bytes()
    words = (*dive.command(tmp_path / "out"), "--overwrite")
    code, _, said = cli(*words, "--out-mcap", file)
    assert code == 1
    assert f"{file}: is not a recording of this program, and is not replaced" in said
    assert file.read_bytes() == before
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_an_earlier_recording_is_replaced_but_not_one_that_is_read(
    make_dive, cli, tmp_path: Path
) -> None:
    dive, file = make_dive(2), tmp_path / "dive.mcap"
    words = (*dive.command(tmp_path / "out"), "--overwrite")
    assert cli(*words, "--out-mcap", file)[0] == 0
    file.write_bytes(file.read_bytes()[:5000])  # of a run that was killed
    assert cli(*words, "--out-mcap", file)[0] == 0
    before = file.read_bytes()
    assert len(before) > 5000
    link = tmp_path / "link.mcap"
    link.symlink_to(file)
    for name, bag in ((file, file), (link, file), (file, link), (file, tmp_path)):
        code, _, said = cli(
            "run", "--bag", bag, "--out", tmp_path / "other", "--out-mcap", name, "--overwrite"
        )
        assert (code, f"{name}: is an input of this run" in said) == (1, True), said
        code, _, said = cli("live", "--bag", bag, "--record", name)
        assert code == 1, said
    assert file.read_bytes() == before
