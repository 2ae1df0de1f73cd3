"""ROS bags as input: the same outputs as from folders, whatever the format; and one clear line for
what is wrong.
"""

import re
import shutil
import sqlite3
from pathlib import Path

import cv2
import numpy as np
import pytest
from bag_writers import (
    LEFT,
    RIGHT,
    START_NS,
    STEP_NS,
    Sent,
    camera_infos,
    compressed,
    dive_messages,
    name_by_stamps,
    raw,
    static_transform,
    write_bag,
)
from conftest import REEF, contents
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode
from scipy.spatial.transform import Rotation
from small_dives import write_half_of_the_real_dive

from calibration import CalibrationError
from calibration.formats import load_rig
from stereo_seecolor.config import InputConfig, RunConfig
from stereo_seecolor.errors import DeviceError, InputError, SeeColorError
from stereo_seecolor.extras.streams.bag_info import bag_info
from stereo_seecolor.extras.streams.bag_inputs import BagInputs
from stereo_seecolor.extras.streams.bags.bag import open_bag
from stereo_seecolor.extras.streams.bags.dive import open_dive
from stereo_seecolor.files.tiff import encode_tiff
from stereo_seecolor.inputs.images import read_image

FORMATS = (".bag", ".db3", ".mcap")


@pytest.fixture
def dive(make_dive):
    made = make_dive(2)
    name_by_stamps(made.root)
    return made


@pytest.fixture
def messages(dive) -> list[Sent]:
    return [*camera_infos(dive.root / "cam.yaml"), *dive_messages(dive.root)]


def pixels_of(pair) -> list[np.ndarray]:
    return [read_image(path) for path in (pair.left, pair.right)]


def picture(seed: int, dtype: type = np.uint8, channels: int = 3) -> np.ndarray:
    shape = (12, 16, channels) if channels > 1 else (12, 16)
    return np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


@pytest.mark.slow
def test_a_bag_gives_the_outputs_of_the_folders(dive, messages, cli, tmp_path) -> None:
    calib = f"{dive.root / 'ros_left.yaml'},{dive.root / 'ros_right.yaml'}"
    sides = ("--left", dive.root / "L", "--right", dive.root / "R")
    assert cli("run", *sides, "--calib", calib, "--out", tmp_path / "folders")[0] == 0
    expected = contents(tmp_path / "folders")
    assert len(expected) > 6
    for suffix in FORMATS:
        bag = write_bag(tmp_path / f"dive{suffix}", messages)
        out = tmp_path / suffix.strip(".")
        code, _, said = cli("run", "--bag", bag, "--out", out)
        assert code == 0, said
        assert contents(out) == expected
        assert (out / "rig.yaml").read_bytes() == (tmp_path / "folders/rig.yaml").read_bytes()
        assert not list(out.rglob("*.tif*.png"))  # no image of the bag was written
        code, printed, _ = cli("run", "--bag", bag, "--out", out)
        assert (code, "kept" in printed) == (0, True)


def products_in_order(out: Path) -> list[bytes]:
    """Whatever the frames are called."""
    return [content for path, content in sorted(contents(out).items()) if "/" in path]


def run_as_folders_and_bag(
    left: list[Path], right: list[Path], calib: Path, suffix: str, cli, tmp_path: Path
) -> None:
    for side, images in (("L", left), ("R", right)):
        (tmp_path / side).mkdir()
        for image in images:
            shutil.copy(image, tmp_path / side)
    assert (
        cli(
            "run",
            "--left",
            tmp_path / "L",
            "--right",
            tmp_path / "R",
            "--calib",
            calib,
            "--out",
            tmp_path / "folders",
        )[0]
        == 0
    )
    name_by_stamps(tmp_path)
    bag = write_bag(tmp_path / f"dive{suffix}", dive_messages(tmp_path))
    code, _, said = cli("run", "--bag", bag, "--calib", calib, "--out", tmp_path / "bag")
    assert code == 0, said
    assert products_in_order(tmp_path / "bag") == products_in_order(tmp_path / "folders")


@pytest.mark.slow
def test_the_sample_dive_in_a_bag(cli, tmp_path) -> None:
    left, right = (sorted((REEF / side).glob("*.png"))[::6] for side in ("left", "right"))
    run_as_folders_and_bag(left, right, REEF / "cam.yaml", ".mcap", cli, tmp_path)


@pytest.mark.slow
@pytest.mark.real_data
def test_a_real_dive_in_a_bag(real_data: Path, cli, tmp_path) -> None:
    """Color left, gray right. Other formats give the same pixels, as tests of each say."""
    half = tmp_path / "half"
    write_half_of_the_real_dive(real_data, half, pairs=1)
    left, right = (list((half / side).iterdir()) for side in ("left", "right"))
    run_as_folders_and_bag(left, right, half / "cam.yaml", ".bag", cli, tmp_path)


@pytest.mark.slow
def test_shards_of_a_bag_are_merged(dive, messages, cli, tmp_path) -> None:
    bag = write_bag(tmp_path / "dive.mcap", messages)
    assert cli("run", "--bag", bag, "--out", tmp_path / "whole")[0] == 0
    parts = [tmp_path / f"part{number}" for number in (1, 2)]
    for number, part in enumerate(parts, 1):
        assert cli("run", "--bag", bag, "--out", part, "--shard", f"{number}/2")[0] == 0
    assert cli("merge", *parts, "--out", tmp_path / "merged")[0] == 0
    assert contents(tmp_path / "merged") == contents(tmp_path / "whole")


@pytest.mark.parametrize("suffix", FORMATS)
def test_stamps_pair_the_images_and_not_their_arrival(suffix, dive, messages, tmp_path) -> None:
    found = open_dive(write_bag(tmp_path / f"dive{suffix}", messages), "", InputConfig())
    assert [pair.name for pair in found.pairing.pairs] == [
        path.stem for path in sorted((dive.root / "L").iterdir())
    ]
    assert (found.sides.left.name, found.sides.right.name) == (
        f"{LEFT}/image_raw",
        f"{RIGHT}/image_raw",
    )
    assert found.rig().baseline_m == pytest.approx(0.1)
    for pair in found.pairing.pairs:
        for side, image in zip("LR", pixels_of(pair), strict=True):
            assert (image == read_image(dive.root / side / f"{pair.name}.png")).all()


@pytest.mark.parametrize(
    ("encoding", "dtype", "channels"),
    [("rgb8", np.uint8, 3), ("bgr8", np.uint8, 3), ("mono8", np.uint8, 1), ("rgba8", np.uint8, 4),
    ("bgra8", np.uint8, 4),
     ("rgb16", np.uint16, 3), ("bgr16", np.uint16, 3), ("mono16", np.uint16, 1)],
)  # fmt: skip
@pytest.mark.parametrize("suffix", FORMATS)
def test_raw_pixels_of_every_encoding(suffix, encoding, dtype, channels, tmp_path) -> None:
    both = [picture(seed, dtype, channels) for seed in (1, 2)]
    sent = [
        raw(f"{camera}/image_raw", START_NS, pixels, encoding)
        for camera, pixels in zip((LEFT, RIGHT), both, strict=True)
    ]
    (pair,) = open_dive(write_bag(tmp_path / f"b{suffix}", sent), "", InputConfig()).pairing.pairs
    for pixels, image in zip(both, pixels_of(pair), strict=True):
        rgb = pixels[..., [2, 1, 0]] if encoding.startswith("bgr") else pixels
        rgb = np.repeat(rgb[..., None], 3, axis=2) if channels == 1 else rgb[..., :3]
        assert image.dtype == dtype
        assert (image == rgb).all()


def test_a_mosaic_is_interpolated_as_input_bayer_does(tmp_path) -> None:
    mosaic = picture(1, channels=1)
    cv2.imwrite(str(tmp_path / "mosaic.png"), mosaic)
    sent = [raw(f"{camera}/image_raw", START_NS, mosaic, "bayer_grbg8") for camera in (LEFT, RIGHT)]
    (pair,) = open_dive(write_bag(tmp_path / "b.bag", sent), "", InputConfig()).pairing.pairs
    expected = read_image(tmp_path / "mosaic.png", InputConfig(bayer="grbg"))
    assert (read_image(pair.left) == expected).all()


def test_compressed_images_are_read_as_they_are(tmp_path) -> None:
    encoded = [cv2.imencode(suffix, picture(3))[1].tobytes() for suffix in (".png", ".jpg")]
    for content, suffix in zip(encoded, (".png", ".jpg"), strict=True):
        sent = [
            compressed(f"{camera}/image_raw/compressed", START_NS, content)
            for camera in (LEFT, RIGHT)
        ]
        (pair,) = open_dive(
            write_bag(tmp_path / f"{suffix[1:]}.mcap", sent), "", InputConfig()
        ).pairing.pairs
        assert pair.left.suffix == suffix
        (tmp_path / f"file{suffix}").write_bytes(content)
        assert (read_image(pair.left) == read_image(tmp_path / f"file{suffix}")).all()


@pytest.mark.parametrize("form", ["16UC1; compressedDepth", "16UC1; compressedDepth png"])
def test_both_spellings_of_compressed_depth(tmp_path, form: str) -> None:
    """Twelve bytes of the transport stand before the PNG."""
    pixels = picture(3, np.uint16, 1)
    content = bytes(12) + cv2.imencode(".png", pixels)[1].tobytes()
    sent = [
        compressed(f"{camera}/image_raw/compressedDepth", START_NS, content, form)
        for camera in (LEFT, RIGHT)
    ]
    topics = f"left={LEFT}/image_raw/compressedDepth,right={RIGHT}/image_raw/compressedDepth"
    (pair,) = open_dive(write_bag(tmp_path / "b.mcap", sent), topics, InputConfig()).pairing.pairs
    assert pair.left.suffix == ".png"
    assert (read_image(pair.left)[..., 0] == pixels).all()
    coded = [compressed(s.topic, START_NS, content, form.replace("16UC1", "32FC1")) for s in sent]
    (pair,) = open_dive(write_bag(tmp_path / "c.mcap", coded), topics, InputConfig()).pairing.pairs
    with pytest.raises(InputError, match="JPEG and PNG are read"):
        read_image(pair.left)


def test_big_endian_pixels(tmp_path) -> None:
    pixels = picture(1, np.uint16, 1)
    sent = []
    for camera in (LEFT, RIGHT):
        message = raw(f"{camera}/image_raw", START_NS, pixels.byteswap(), "mono16")
        sent.append(message._replace(fields={**message.fields, "is_bigendian": 1}))
    (pair,) = open_dive(write_bag(tmp_path / "b.db3", sent), "", InputConfig()).pairing.pairs
    assert (read_image(pair.left)[..., 0] == pixels).all()


def test_images_are_found_by_their_paths_alone(messages, tmp_path, monkeypatch) -> None:
    """As another process does, which did not pair them."""
    pair = open_dive(write_bag(tmp_path / "b.mcap", messages), "", InputConfig()).pairing.pairs[1]
    before = pixels_of(pair)
    monkeypatch.setattr("stereo_seecolor.files.contained._containers", {})
    assert all((a == b).all() for a, b in zip(pixels_of(pair), before, strict=True))


def test_a_tiff_of_raw_pixels_is_what_opencv_reads() -> None:
    for pixels in (
        picture(1),
        picture(1, np.uint16),
        picture(1, channels=1),
        picture(1, np.uint16, 1),
    ):
        read = cv2.imdecode(np.frombuffer(encode_tiff(pixels), np.uint8), cv2.IMREAD_UNCHANGED)
        assert read.dtype == pixels.dtype
        assert ((read[..., ::-1] if read.ndim == 3 else read) == pixels).all()


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_compressed_chunks_of_ros_1(compression, dive, messages, tmp_path) -> None:
    bag = write_bag(
        tmp_path / "b.bag",
        messages,
        compression=[getattr(Writer1.CompressionFormat, compression.upper())],
    )
    plain = write_bag(tmp_path / "plain.bag", messages)
    assert bag.stat().st_size < plain.stat().st_size
    pair = open_dive(bag, "", InputConfig()).pairing.pairs[1]
    assert (pixels_of(pair)[1] == read_image(dive.root / "R" / f"{pair.name}.png")).all()


@pytest.mark.parametrize(
    ("suffix", "mode"), [(".mcap", CompressionMode.STORAGE), (".db3", CompressionMode.MESSAGE)]
)
def test_compressed_bags_of_ros_2(suffix, mode, dive, messages, tmp_path) -> None:
    bag = write_bag(tmp_path / f"b{suffix}", messages, compression=[mode, CompressionFormat.ZSTD])
    pair = open_dive(bag, "", InputConfig()).pairing.pairs[1]
    assert (pixels_of(pair)[1] == read_image(dive.root / "R" / f"{pair.name}.png")).all()


def test_a_split_bag_is_read_from_its_folder(messages, dive, tmp_path) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    by_time = sorted(messages, key=lambda sent: sent.stamp_ns)
    for i, part in enumerate((by_time[:4], by_time[4:])):
        shutil.copy(write_bag(tmp_path / f"part_{i}.mcap", part), folder / f"part_{i}.mcap")
    found = open_dive(folder, "", InputConfig())
    assert len(found.pairing.pairs) == 2
    assert len({pair.left.parent.parent for pair in found.pairing.pairs}) == 2
    assert (
        read_image(found.pairing.pairs[1].left)
        == read_image(sorted((dive.root / "L").iterdir())[1])
    ).all()


def many(count: int = 8, jitter_ns: int = 0, lost: tuple[int, ...] = ()) -> list[Sent]:
    """Small pairs; the right clock runs away by ``jitter_ns`` a pair."""
    stamps = [START_NS + i * STEP_NS for i in range(count) if i not in lost]
    left = [raw(f"{LEFT}/image_raw", stamp, picture(1), "rgb8") for stamp in stamps]
    return left + [
        raw(f"{RIGHT}/image_raw", stamp + i * jitter_ns, picture(2), "rgb8")
        for i, stamp in enumerate(stamps)
    ]


def test_drift_and_gaps_are_reported(tmp_path) -> None:
    notes = open_dive(
        write_bag(tmp_path / "drift.bag", many(8, 600_000)), "", InputConfig()
    ).pairing.notes
    assert any("the right clock drifted by +3.6 ms" in note for note in notes)
    notes = open_dive(
        write_bag(tmp_path / "gap.bag", many(12, lost=(5, 6, 7, 8))), "", InputConfig()
    ).pairing.notes
    assert any(
        "1 gap between pairs, which are usually 0.25 s apart; the longest 1.25 s" in note
        for note in notes
    )


def test_headers_without_time_and_repeated_stamps(tmp_path) -> None:
    sent = [message._replace(stamp_ns=0, arrival_ns=message.stamp_ns) for message in many(3)]
    found = open_dive(write_bag(tmp_path / "zero.mcap", sent), "", InputConfig()).pairing
    assert len(found.pairs) == 3
    assert any("headers hold no time" in note for note in found.notes)
    found = open_dive(
        write_bag(tmp_path / "twice.mcap", [*many(3), *many(1)]), "", InputConfig()
    ).pairing
    assert len(found.pairs) == 3
    assert any("1 of 4 messages repeat the stamp" in note for note in found.notes)


@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        (("/cam1/image_raw", "/cam0/image_raw"), ("/cam0/image_raw", "/cam1/image_raw")),
        (("/infra1/image", "/infra2/image", "/depth/image"), ("/infra1/image", "/infra2/image")),
        (
            (
                "/a/right/image_rect",
                "/a/left/image_rect",
                "/a/left/image_raw",
                "/a/right/image_raw",
            ),
            ("/a/left/image_raw", "/a/right/image_raw"),
        ),
        (("/fwd/image", "/aft/image"), ("/aft/image", "/fwd/image")),
    ],
)
def test_sides_are_told_from_the_names_of_topics(names, chosen, tmp_path) -> None:
    sent = [raw(name, START_NS, picture(i), "rgb8") for i, name in enumerate(names)]
    sides = open_dive(write_bag(tmp_path / "b.bag", sent), "", InputConfig()).sides
    assert (sides.left.name, sides.right.name) == chosen
    assert sides.guessed == ("/fwd/image" in names)


def test_topics_can_be_given(tmp_path) -> None:
    sent = [
        raw(name, START_NS, picture(i), "rgb8") for i, name in enumerate(("/a/x", "/b/y", "/c"))
    ]
    bag = write_bag(tmp_path / "b.bag", sent)
    with pytest.raises(
        InputError, match=r"no two of its image topics .* \(/a/x, /b/y, /c\): give --topics"
    ):
        open_dive(bag, "", InputConfig())
    sides = open_dive(bag, "left=/c,right=a/x", InputConfig()).sides
    assert (sides.left.name, sides.right.name) == ("/c", "/a/x")
    with pytest.raises(InputError, match="left=/d: is not an image topic of this bag"):
        open_dive(bag, "left=/d,right=/c", InputConfig())
    with pytest.raises(InputError, match="--topics /c: cannot be parsed; write"):
        open_dive(bag, "/c", InputConfig())


def test_a_bag_without_a_calibration_asks_for_one(dive, cli, tmp_path) -> None:
    bag = write_bag(tmp_path / "b.mcap", dive_messages(dive.root))
    code, _, said = cli("run", "--bag", bag, "--out", tmp_path / "out")
    assert (
        code,
        "holds no camera_info of the left and right camera: give --calib FILE" in said,
    ) == (1, True)
    left_only = write_bag(
        tmp_path / "left.mcap", [camera_infos(dive.root / "cam.yaml")[0], *dive_messages(dive.root)]
    )
    with pytest.raises(InputError, match="no camera_info of the right camera"):
        open_dive(left_only, "", InputConfig()).rig()


def test_camera_infos_of_two_single_cameras_are_no_rig(dive, tmp_path) -> None:
    infos = [
        info._replace(fields={**info.fields, "p": info.fields["p"] * ([1] * 3 + [0] + [1] * 8)})
        for info in camera_infos(dive.root / "cam.yaml")
    ]
    found = open_dive(
        write_bag(tmp_path / "b.bag", [*infos, *dive_messages(dive.root)]), "", InputConfig()
    )
    with pytest.raises(
        CalibrationError, match=r"b.bag: camera_info: both projection matrices have P\[0, 3\] = 0"
    ):
        found.rig()


@pytest.mark.parametrize("suffix", FORMATS)
def test_the_baseline_is_taken_from_static_transforms_where_camera_info_has_none(
    suffix, dive, tmp_path
) -> None:
    rig = load_rig(str(dive.root / "cam.yaml"))
    infos = [
        info._replace(
            fields={**info.fields, "p": info.fields["p"] * ([1] * 3 + [0] + [1] * 8)},
            frame=f"{side}_optical",
        )
        for info, side in zip(camera_infos(dive.root / "cam.yaml"), ("left", "right"), strict=True)
    ]
    T_left_right, turn = (
        np.linalg.inv(rig.T_right_left),
        Rotation.from_euler("xyz", [20, -70, 10], degrees=True),
    )
    R, t = Rotation.from_matrix(T_left_right[:3, :3]), T_left_right[:3, 3]
    # both cameras on a frame of the vehicle: left turned in it, right by the rig from left
    statics = [
        static_transform(suffix, "body", "left_optical", (1, 2, 3), turn),
        static_transform(
            suffix, "body", "right_optical", turn.apply(t) + np.array([1, 2, 3]), turn * R
        ),
    ]
    bag = write_bag(tmp_path / f"b{suffix}", [*infos, *statics, *dive_messages(dive.root)])
    found = open_dive(bag, "", InputConfig())
    np.testing.assert_allclose(found.rig().T_right_left, rig.T_right_left, atol=1e-9)
    assert (
        "camera_info holds no baseline: 100.0 mm from left_optical to right_optical by /tf_static"
        in bag_info(bag).notes[-1]
    )
    apart = write_bag(tmp_path / f"apart{suffix}", [*infos, statics[0], *dive_messages(dive.root)])
    assert any("its frames: body, left_optical" in note for note in bag_info(apart).notes)
    assert bag_info(apart).baseline_m is None


def test_a_camera_info_of_another_frame_is_noted(messages, tmp_path) -> None:
    turned = [
        sent._replace(frame="wrong") if sent.topic == f"{RIGHT}/camera_info" else sent
        for sent in messages
    ]
    found = open_dive(write_bag(tmp_path / "b.mcap", turned), "", InputConfig())
    assert (
        "camera_info is of the frame wrong, /stereo/right/image_raw of camera: does it belong "
        "to this camera?" in found.pairing.notes[-1]
    )
    assert found.rig().baseline_m == pytest.approx(0.1)


def test_stamps_that_all_end_alike_are_no_names(tmp_path: Path) -> None:
    """The times of a trigger at full seconds, and of one that is 0.4 s late."""
    sent = [
        raw(f"{camera}/image_raw", (1_700_000_000 + i) * 10**9 + late_ns, picture(i), "rgb8")
        for i in range(6)
        for camera, late_ns in ((LEFT, 0), (RIGHT, 400_000_000))
    ]
    found = open_dive(write_bag(tmp_path / "b.bag", sent), "", InputConfig()).pairing
    assert next(pair.name for pair in found.pairs) == "1700000000-000000000"
    assert "the right clock is 0.400 s ahead of the left one" in found.notes[0]


def test_images_of_another_size_than_camera_info_are_named(messages, tmp_path) -> None:
    small = [
        raw(sent.topic, sent.stamp_ns, picture(0), "rgb8") if "image" in sent.topic else sent
        for sent in messages
    ]
    bag = write_bag(tmp_path / "b.bag", small)
    said = "the left images are 16x12 px, but camera_info is for .*: give the images that"
    with pytest.raises(CalibrationError, match=said):
        BagInputs(bag).open(RunConfig())
    assert bag_info(bag).baseline_m is None
    assert re.search(said, bag_info(bag).notes[-1])


def test_bag_info_says_what_run_would_take(messages, cli, tmp_path) -> None:
    bag = write_bag(tmp_path / "b.bag", messages)
    code, printed, _ = cli("bag-info", bag)
    assert code == 0
    for line in (
        "2 pairs, 0 images without a partner; baseline 100.0 mm",
        "/stereo/left/image_raw ",
        f"stereo-seecolor run --bag {bag} --out out",
    ):
        assert line in printed
    given = f"left={LEFT}/image_raw,right={RIGHT}/image_raw"
    _, printed, _ = cli("bag-info", write_bag(tmp_path / "b 1.bag", messages), "--topics", given)
    assert f"run --bag '{tmp_path / 'b 1.bag'}' --topics {given} --out out" in printed
    none = write_bag(tmp_path / "none.bag", camera_infos(tmp_path / "dive/cam.yaml"))
    code, printed, _ = cli("bag-info", none)
    assert (code, "(it has none)" in printed) == (3, True)
    assert bag_info(bag).seconds == pytest.approx(0.28, abs=0.001)


@pytest.mark.parametrize(
    ("suffix", "compressed_chunks"),
    [(".bag", False), (".bag", True), (".mcap", False), (".mcap", True), (".db3", False)],
)
def test_a_cut_bag_is_read_as_far_as_it_goes(suffix, compressed_chunks, tmp_path) -> None:
    options = {}
    if compressed_chunks:
        ros2 = [CompressionMode.STORAGE, CompressionFormat.ZSTD]
        options = {"compression": [Writer1.CompressionFormat.LZ4] if suffix == ".bag" else ros2}
    # cannot be compressed: several chunks
    noise = np.random.default_rng(0).integers(0, 256, (120, 160, 3), np.uint8)
    stamps = [START_NS + i * STEP_NS for i in range(40)]
    sent = [
        raw(f"{camera}/image_raw", stamp, noise, "rgb8")
        for stamp in stamps
        for camera in (LEFT, RIGHT)
    ]
    bag = write_bag(tmp_path / f"b{suffix}", sent, **options)
    cut = tmp_path / f"cut{suffix}"
    cut.write_bytes(bag.read_bytes()[: bag.stat().st_size // 3])
    found = open_dive(cut, "", InputConfig()).pairing
    assert 3 < len(found.pairs) < 40
    reason = (
        "cannot be read further"
        if suffix == ".db3"
        else f"ends at byte {cut.stat().st_size}, in the middle of a record"
    )
    assert sum(f"{cut}: {reason}" in note for note in found.notes) == 1
    assert (read_image(found.pairs[-1].left) == noise).all()


def test_a_bag_that_was_never_closed_needs_no_index(tmp_path) -> None:
    bag = write_bag(tmp_path / "b.bag", many(5))
    content = bytearray(bag.read_bytes())
    at = content.index(b"index_pos=") + len(b"index_pos=")
    index = int.from_bytes(content[at : at + 8], "little")
    content[at : at + 8] = bytes(8)
    active = tmp_path / "b.bag.active"
    active.write_bytes(content[:index])
    found = open_dive(active, "", InputConfig()).pairing
    assert len(found.pairs) == 5
    assert any("not closed by its recorder" in note for note in found.notes)


def test_nothing_is_written_beside_a_bag(tmp_path) -> None:
    bag = write_bag(tmp_path / "b.db3", many(3))
    before = {path.name: path.stat().st_mtime_ns for path in bag.parent.iterdir()}
    open_dive(bag, "", InputConfig())
    assert {path.name: path.stat().st_mtime_ns for path in bag.parent.iterdir()} == before


def test_what_is_no_bag_is_one_line(tmp_path, cli) -> None:
    (tmp_path / "text.bag").write_text("no bag")
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "folder").mkdir()
    (tmp_path / "b.db3.zstd").write_bytes(bytes.fromhex("28b52ffd") + bytes(9))
    (tmp_path / "renamed.mcap").write_bytes(bytes.fromhex("1f8b0800") + bytes(9))
    sqlite3.connect(tmp_path / "other.db3").execute("CREATE TABLE x (y)").connection.close()
    for name, message in (
        ("text.bag", "is not a ROS bag"), ("empty.mcap", "is empty"), ("folder", "holds no bag"),
        ("missing.bag", "does not exist"),
        ("b.db3.zstd", "unpack it first with zstd -d"), ("renamed.mcap",
        "unpack it first with gunzip"),
        ("other.db3", "no such table: topics"),
    ):  # fmt: skip
        code, _, said = cli("run", "--bag", tmp_path / name, "--out", tmp_path / "out")
        assert (code, message in said, said.count("\n")) == (1, True, 1), said
    assert not (tmp_path / "out").exists()


def test_wrong_usage_of_a_bag(cli, tmp_path) -> None:
    for words, message in (
        (("--bag", "b", "--left", "l"), "stereo-seecolor: --bag contains both sides"),
        (("--left", "l", "--right", "r"), "--calib is missing"),
        (
            ("--left", "l", "--right", "r", "--calib", "c", "--topics", "left=a,right=b"),
            "give --bag, too",
        ),
    ):
        code, _, said = cli("run", *words, "--out", tmp_path / "out")
        assert (code, message in " ".join(said.split())) == (2, True), said


@pytest.mark.parametrize("suffix", FORMATS)
def test_damage_anywhere_is_one_line_or_fewer_pairs(suffix, tmp_path) -> None:
    """Bytes overwritten, inserted and removed at random: every pair can be read, fails with one
    line, or is not there.
    """
    content = write_bag(tmp_path / f"b{suffix}", many(6)).read_bytes()
    rng = np.random.default_rng(5)
    for trial in range(40):
        damaged = bytearray(content)
        for _ in range(int(rng.integers(1, 6))):
            at = int(rng.integers(0, len(damaged) // (1 + 4 * (trial % 2))))
            size = int(rng.integers(1, 64))
            kind = trial % 3
            damaged[at : at + (0 if kind == 1 else size)] = b"" if kind == 2 else rng.bytes(size)
        path = tmp_path / f"damaged{trial}{suffix}"
        path.write_bytes(damaged)
        try:
            for pair in open_dive(path, "", InputConfig()).pairing.pairs:
                pixels_of(pair)
        except SeeColorError as error:
            assert "\n" not in str(error)
            assert str(path) in str(error)


def test_a_missing_library_is_named(tmp_path, monkeypatch) -> None:
    import sys

    from stereo_seecolor.extras.streams.bags import messages as decoding

    bag = write_bag(tmp_path / "b.mcap", many(1))
    decoding.store.cache_clear()
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(DeviceError, match=r"a bag needs .*rosbags.*pip install .*\[bags\]"):
        for pair in open_dive(bag, "", InputConfig()).pairing.pairs:
            read_image(pair.left)


def test_other_topics_are_counted(tmp_path) -> None:
    sent = [
        Sent(
            "/altitude",
            "sensor_msgs/msg/Range",
            START_NS,
            {
                "radiation_type": 0,
                "field_of_view": 0.0,
                "min_range": 0.0,
                "max_range": 1.0,
                "range": 1.5,
            },
        )
    ]
    topic = open_bag(write_bag(tmp_path / "b.bag", sent * 3)).topic("/altitude")
    assert topic is not None
    assert (topic.count, topic.msgtype, topic.entries) == (3, "sensor_msgs/msg/Range", ())


@pytest.mark.slow
def test_a_bag_that_changed_is_measured_again(dive, messages, cli, tmp_path) -> None:
    bag = write_bag(tmp_path / "b.bag", messages)
    command = ("run", "--bag", bag, "--out", tmp_path / "out")
    assert cli(*command)[0] == 0
    before = [path.read_bytes() for path in sorted((tmp_path / "out/range").iterdir())]
    bag.unlink()
    darker = messages[-1]._replace(
        fields={**messages[-1].fields, "data": messages[-1].fields["data"] // 4}
    )
    write_bag(bag, [*messages[:-1], darker])
    assert cli(*command)[0] == 0
    after = [path.read_bytes() for path in sorted((tmp_path / "out/range").iterdir())]
    assert (after[0] == before[0], after[1] == before[1]) == (True, False)


def test_of_two_rigs_the_one_with_its_calibration_is_taken(dive, messages) -> None:
    """Another rig's camera_info is not that of the cameras."""
    rear = [
        sent._replace(topic=sent.topic.replace("/stereo", "/rear"))
        for sent in messages
        if sent.topic.endswith("image_raw")
    ]
    bag = write_bag(dive.root / "two.mcap", [*rear, *messages])
    found = open_dive(bag, "", InputConfig())
    assert found.sides.left.name == f"{LEFT}/image_raw"
    assert "; for /rear/left/image_raw give --topics" in " ".join(found.pairing.notes)
