"""Which file belongs to which: by name, by time stamp, and what belongs to none."""

import os
import re
import unicodedata
from itertools import product
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stereo_seecolor.config import InputConfig
from stereo_seecolor.errors import InputError
from stereo_seecolor.files.names import natural_key, product_name, sort_naturally
from stereo_seecolor.inputs.listing import list_images
from stereo_seecolor.inputs.name_keys import side_of
from stereo_seecolor.inputs.name_times import timestamp_from_name
from stereo_seecolor.inputs.pairing import pair_by_stem, pair_folders


def folders(tmp_path: Path, lefts: list[str], rights: list[str]) -> tuple[Path, Path]:
    for side, names in (("L", lefts), ("R", rights)):
        (tmp_path / side).mkdir()
        for name in names:
            (tmp_path / side / name).touch()
    return tmp_path / "L", tmp_path / "R"


def names(
    tmp_path: Path, lefts: list[str], rights: list[str], **config: object
) -> list[tuple[str, str, str]]:
    pairing = pair_folders(*folders(tmp_path, lefts, rights), InputConfig.model_validate(config))
    return [(pair.name, pair.left.name, pair.right.name) for pair in pairing.pairs]


@pytest.mark.parametrize(
    ("left", "right", "name"),
    [
        ("0001.png", "0001.png", "0001"),
        ("0001.png", "0001.TIFF", "0001"),
        ("left_0001.png", "right_0001.png", "0001"),
        ("left1.jpg", "right1.jpg", "1"),
        ("0001_L.png", "0001_R.png", "0001"),
        ("0001L.png", "0001R.png", "0001"),
        ("dive 3-left-07.png", "dive 3-right-07.png", "dive 3-07"),
        (
            "PR_20180811_153729_762_LC16.tif",
            "PR_20180811_153729_762_RC16.tif",
            "PR_20180811_153729_762_16",
        ),
        ("fwd_0001.png", "aft_0001.png", "0001"),
        ("récif_links_5.png", "récif_rechts_5.png", "récif_5"),
        ("lc_5.png", "rc_5.png", "5"),
        ("LFT_5.png", "RGT_5.png", "5"),
        ("imgL_5.png", "imgR_5.png", "5"),
        ("leftcam5.png", "rightcam5.png", "5"),
        ("imager_5_L.png", "imager_5_R.png", "imager_5"),
    ],
)
def test_pairs_by_name(tmp_path: Path, left: str, right: str, name: str) -> None:
    assert names(tmp_path, [left], [right]) == [(name, left, right)]


@pytest.mark.parametrize(
    ("left", "right", "name"),
    [
        ("2016-01-20T00-12-{}_port.png", "2016-01-20T00-12-{}_stbd.png", "2016-01-20T00-12-{}"),
        ("fwd_20160120_{}.png", "aft_20160120_{}.png", "20160120_{}"),
        ("fore_{}.png", "core_{}.png", "{}"),
        ("fwd2_{}.png", "aft2_{}.png", "{}"),
    ],
)
def test_names_keep_what_both_sides_begin_with(
    tmp_path: Path, left: str, right: str, name: str
) -> None:
    """Names of the first two pairs that arrive have the date that later ones show to differ."""
    numbers = ["14.619", "15.120"]
    lefts, rights = ([side.format(number) for number in numbers] for side in (left, right))
    assert [found for found, _, _ in names(tmp_path, lefts, rights)] == [
        name.format(number) for number in numbers
    ]


def test_port_and_starboard_are_sides_and_parts_of_place_names() -> None:
    named = [side_of(name) for name in ("port", "STBD", "Starboard", "port_davey_R", "port_davey")]
    assert named == ["left", "right", "right", "right", None]


def test_names_beginning_with_a_side_letter_are_left_alone(tmp_path: Path) -> None:
    files = ["reef_l_1.png", "rock_2.png"]
    assert [n for n, _, _ in names(tmp_path, files, ["reef_r_1.png", "rock_2.png"])] == [
        "reef_1",
        "rock_2",
    ]


def test_patterns_name_the_sides_of_one_folder(tmp_path: Path) -> None:
    for name in (
        "left1.png",
        "right1.png",
        "left2.png",
        "right2.png",
        "left_map.txt",
        ".left3.png",
        "disparity.png",
    ):
        (tmp_path / name).touch()
    pairing = pair_folders(tmp_path / "left*.png", tmp_path / "right*.png", InputConfig())
    assert [(pair.name, pair.left.name, pair.right.name) for pair in pairing.pairs] == [
        ("1", "left1.png", "right1.png"),
        ("2", "left2.png", "right2.png"),
    ]


def test_two_images_are_a_pair(tmp_path: Path) -> None:
    for name in ("teddy.png", "teddy2.png", "other.png"):
        (tmp_path / name).touch()
    pairing = pair_folders(tmp_path / "teddy.png", tmp_path / "teddy2.png", InputConfig())
    assert [(pair.name, pair.left.name, pair.right.name) for pair in pairing.pairs] == [
        ("teddy", "teddy.png", "teddy2.png")
    ]
    assert not pairing.unpaired


def test_a_pattern_that_fits_no_image(tmp_path: Path) -> None:
    (tmp_path / "left1.png").touch()
    with pytest.raises(InputError, match=r"holds no right images named right\*\.png"):
        list_images(tmp_path / "right*.png", "right images")
    with pytest.raises(InputError, match="gone: the folder of right images does not exist"):
        list_images(tmp_path / "gone" / "right*.png", "right images")


def test_a_folder_whose_name_looks_like_a_pattern_is_a_folder(tmp_path: Path) -> None:
    folder = tmp_path / "dive[1]"
    folder.mkdir()
    (folder / "a.png").touch()
    assert [path.name for path in list_images(folder, "images").files] == ["a.png"]


def test_unpaired_files_are_named_with_the_reason(tmp_path: Path) -> None:
    pairing = pair_folders(
        *folders(tmp_path, ["1.png", "2.png", "2.jpg"], ["1.png", "2.png", "3.png"]), InputConfig()
    )
    assert [pair.name for pair in pairing.pairs] == ["1"]
    reasons = {u.path.parent.name + "/" + u.path.name: u.reason for u in pairing.unpaired}
    assert reasons.keys() == {"L/2.jpg", "L/2.png", "R/2.png", "R/3.png"}
    assert "several files are called '2'" in reasons["L/2.png"]
    assert reasons["R/3.png"] == "no left image matches"


def test_pairs_by_timestamp_with_tolerance(tmp_path: Path) -> None:
    lefts = [
        "100000000.500000.png".replace("100000000", "1000000000"),
        "1000000001.500000.png",
        "1000000002.500000.png",
    ]
    rights = ["1000000000.504000.png", "1000000001.520000.png", "1000000002.499000.png"]
    found = names(tmp_path, lefts, rights)
    assert [(left, right) for _, left, right in found] == [
        (lefts[0], rights[0]),
        (lefts[2], rights[2]),
    ]


def test_how_far_the_nearest_time_stamp_is(tmp_path: Path) -> None:
    lefts = ["1000000000.500.png", "1000000001.500.png", "1000000009.500.png"]
    pairing = pair_folders(
        *folders(tmp_path, lefts, ["1000000000.504.png", "1000000001.534.png"]), InputConfig()
    )
    reasons = {
        path.path.parent.name + "/" + path.path.name: path.reason for path in pairing.unpaired
    }
    near = "the nearest in time is 0.034 s away, input.timestamp_tolerance_s is 0.01"
    assert reasons == {
        "L/1000000001.500.png": f"no right image matches: {near}",
        "L/1000000009.500.png": "no right image matches",
        "R/1000000001.534.png": f"no left image matches: {near}",
    }


def test_how_far_all_time_stamps_are(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"time stamps are 0\.034 s apart, median"):
        pair_folders(
            *folders(tmp_path, ["1000000000.500.png"], ["1000000000.534.png"]), InputConfig()
        )


def test_wider_tolerance_takes_the_nearest(tmp_path: Path) -> None:
    found = names(
        tmp_path,
        ["1000000000.000000.png"],
        ["1000000000.100000.png", "1000000000.050000.png"],
        timestamp_tolerance_s=0.2,
    )
    assert [right for _, _, right in found] == ["1000000000.050000.png"]


def test_a_right_image_goes_to_the_left_one_that_is_nearest(tmp_path: Path) -> None:
    """Not to another one within the tolerance, too: one of the two has no partner."""
    lefts = ["1000000000.000000.png", "1000000000.080000.png"]
    found = names(tmp_path, lefts, ["1000000000.090000.png"], timestamp_tolerance_s=0.2)
    assert [left for _, left, _ in found] == [lefts[1]]


def test_times_that_contradict_pairs_by_name_are_reported(tmp_path: Path) -> None:
    """What all names of a side end with is no part of them."""
    lefts, rights = (
        [f"{1_790_000_000 + i}.{late_us:06d}.png" for i in range(5)] for late_us in (0, 400_000)
    )
    pairing = pair_folders(*folders(tmp_path, lefts, rights), InputConfig())
    assert len(pairing.pairs) == 5
    note = pairing.notes[-1]
    assert "lie 0.400 s apart (median): they were paired by the rest" in note


def test_clocks_that_drift_are_reported(tmp_path: Path) -> None:
    lefts = [f"10000000{i:02d}.000000.png" for i in range(12)]
    rights = [f"10000000{i:02d}.{i * 700:06d}.png" for i in range(12)]
    pairing = pair_folders(*folders(tmp_path, lefts, rights), InputConfig())
    assert len(pairing.pairs) == 12
    assert pairing.notes
    assert "clock drifted by +6" in pairing.notes[0]


def test_nothing_matches(tmp_path: Path) -> None:
    with pytest.raises(
        InputError,
        match=r"no left image matches a right one.*a1\.png and b2\.png.*timestamp_tolerance_s",
    ):
        pair_folders(*folders(tmp_path, ["a1.png"], ["b2.png"]), InputConfig())


@pytest.mark.parametrize(
    ("make", "message"), [(False, "does not exist"), (True, "holds no left images")]
)
def test_missing_or_empty_folder(tmp_path: Path, make: bool, message: str) -> None:
    if make:
        (tmp_path / "L").mkdir()
        (tmp_path / "L" / "notes.txt").touch()
    with pytest.raises(InputError, match=message):
        list_images(tmp_path / "L", "left images")


def test_a_folder_of_folders_stands_for_their_images(tmp_path: Path) -> None:
    for name in (
        "left/100A/1.png",
        "left/101A/2.png",
        "left/.trash/3.png",
        "right/100A/1.png",
        "right/101A/2.png",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    found = pair_folders(tmp_path / "left", tmp_path / "right", InputConfig())
    assert [pair.left.relative_to(tmp_path).as_posix() for pair in found.pairs] == [
        "left/100A/1.png",
        "left/101A/2.png",
    ]
    with pytest.raises(InputError, match="holds no left images"):  # both sides: no side
        list_images(tmp_path, "left images")


def test_images_of_a_kind_that_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "1.dng").touch()
    with pytest.raises(
        InputError,
        match=r"holds no left images .*; 1 file of a kind that is not read [(].dng[)]: convert "
        r"them",
    ):
        pair_folders(tmp_path, tmp_path, InputConfig())


def test_a_file_instead_of_a_folder(tmp_path: Path) -> None:
    (tmp_path / "x.txt").touch()
    with pytest.raises(InputError, match="is a file"):
        list_images(tmp_path / "x.txt", "left images")


def test_one_image_and_its_range_map_by_pattern(tmp_path: Path) -> None:
    for name in ("3374.png", "3374_range.tiff"):
        (tmp_path / name).touch()
    assert [pair.name for pair in pair_by_stem(tmp_path / "*.png", tmp_path / "*.tiff").pairs] == [
        "3374"
    ]


def test_own_range_maps_pair_by_stem(tmp_path: Path) -> None:
    pairing = pair_by_stem(*folders(tmp_path, ["a.tiff", "b.png"], ["a.tif", "c.tif"]))
    assert [pair.name for pair in pairing.pairs] == ["a"]
    assert [(u.path.name, u.reason) for u in pairing.unpaired] == [
        ("b.png", "no range map matches"),
        ("c.tif", "no image matches"),
    ]


@pytest.mark.parametrize(
    ("stem", "seconds"),
    [
        ("1317354879.544786", 1317354879.544786),
        ("1317354879.544", 1317354879.544),
        ("2016012000-544", None),
        ("1659471354-0395682455-warpauv_2.left", 1659471354.395682455),
        ("1403636579763555584", 1403636579.763555584),
        ("1403636579763_left", 1403636579.763),
        ("PR_20180811_153729_762_LC16", 1534001849.762),
        ("2022-08-01T12-34-56.250", 1659357296.25),
        ("2022-08-01 12.34.56.250", 1659357296.25),
        ("16233051861828957", 1623305186.1828957),
        ("20180811153729762", 1534001849.762),
        ("frame_000123", None),
        ("20221399_999999", None),
    ],
)
def test_timestamps(stem: str, seconds: float | None) -> None:
    found = timestamp_from_name(stem)
    assert found == (None if seconds is None else pytest.approx(seconds, abs=1e-6))


def test_numbers_in_names_are_ordered_as_numbers(tmp_path: Path) -> None:
    files = [f"frame{i}.png" for i in (1, 10, 2, 100, 20)] + ["Frame3.png"]
    found = [name for name, _, _ in names(tmp_path, files, files)]
    assert found == ["frame1", "frame2", "Frame3", "frame10", "frame20", "frame100"]


def test_time_comes_before_name_where_every_name_holds_one(tmp_path: Path) -> None:
    files = ["b_1000000001.500000.png", "a_1000000002.500000.png", "c_1000000000.500000.png"]
    assert [name[0] for name, _, _ in names(tmp_path, files, files)] == ["c", "b", "a"]


def test_unpaired_files_are_in_natural_order(tmp_path: Path) -> None:
    lefts = ["1.png", "10.png", "2.png"]
    pairing = pair_folders(*folders(tmp_path, lefts, ["1.png"]), InputConfig())
    assert [file.path.name for file in pairing.unpaired] == ["2.png", "10.png"]


@pytest.mark.parametrize(
    "name", ["l_noise.png", "left_left_1.png", "r_1.png", "right_left_2.png", "lc.png"]
)
def test_one_name_in_both_folders_is_a_pair_whatever_words_it_holds(
    tmp_path: Path, name: str
) -> None:
    assert names(tmp_path, [name], [name]) == [(Path(name).stem, name, name)]


@pytest.mark.posix
def test_pipes_folders_and_lost_links_are_named_and_not_opened(tmp_path: Path) -> None:
    left, right = folders(tmp_path, ["1.png", "2.png"], ["1.png", "2.png", "3.png", "4.png"])
    os.mkfifo(left / "3.png")
    (left / "4.png").mkdir()
    (left / "5.png").symlink_to(tmp_path / "nowhere.png")
    (left / "6.png").symlink_to(left / "1.png")
    pairing = pair_folders(left, right, InputConfig())
    assert [pair.name for pair in pairing.pairs] == ["1", "2"]
    assert {f"{file.path.parent.name}/{file.name}": file.reason for file in pairing.unpaired} == {
        "L/3": "is a named pipe, not a file",
        "L/4": "is a folder, not a file",
        "L/5": "cannot be read: No such file or directory",
        "L/6": "no right image matches",
        "R/3": "no left image matches",
        "R/4": "no left image matches",
    }


def test_outputs_have_names_of_their_own_also_where_case_does_not_count(tmp_path: Path) -> None:
    files = ["Reef.png", "reef.png", "sand.png"]
    found = [name for name, _, _ in names(tmp_path, files, files)]
    assert len({name.casefold() for name in found}) == 3
    assert "sand" in found


@pytest.mark.parametrize(
    ("stem", "name"),
    [
        ("reef_0001", "reef_0001"),
        ("récif", "récif"),
        (os.fsdecode(b"caf\xe9"), "caf%E9"),
        ("two\nlines", "two%0Alines"),
        ("line\u2028separator", "line%E2%80%A8separator"),
    ],
)
def test_product_names_are_printable(stem: str, name: str) -> None:
    assert product_name(stem) == name


def test_long_names_are_cut_and_stay_apart() -> None:
    stems = ["é" * 120 + end for end in "ab"]
    cut = [product_name(stem) for stem in stems]
    assert len(set(cut)) == 2
    assert all(len(name.encode()) <= 180 and name.startswith("é" * 80) for name in cut)


@given(st.text(st.characters(), max_size=260))
def test_any_stem_gives_a_name_that_can_be_written(stem: str) -> None:
    name = product_name(stem)
    assert len(name.encode()) <= 180
    assert not any(unicodedata.category(letter) == "Cc" for letter in name)


@given(st.lists(st.text(max_size=12), max_size=6))
def test_natural_order_is_total(texts: list[str]) -> None:
    backwards = texts[::-1]
    assert sorted(backwards, key=natural_key) == sorted(texts, key=natural_key)


@pytest.mark.slow
@given(
    st.lists(
        st.from_regex(r"[a-bA-B_ ]{0,2}[0-9]{0,3}[a-b]?[0-9]{0,2}", fullmatch=True), max_size=12
    )
)
def test_natural_order_reads_digits_as_numbers(names: list[str]) -> None:
    def parts(name: str) -> tuple[list[str | int], str]:
        found = re.split("([0-9]+)", name.casefold())
        return [int(part) if place % 2 else part for place, part in enumerate(found)], name

    assert sorted(names, key=natural_key) == sorted(names, key=parts)


@pytest.mark.slow
@given(st.lists(st.from_regex("[aA]b_[0-9]{3}(-[0-9])?", fullmatch=True), max_size=12))
def test_names_are_sorted_by_their_natural_key(names: list[str]) -> None:
    expected = sorted(names, key=natural_key)
    sort_naturally(names)
    assert names == expected


STEMS = st.lists(
    st.sampled_from(
        ["f1", "f2", "f10", "F1", "g1", "a-b", "a", "20180811_153729", "20180811_153730"]
    ),
    max_size=4,
)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(STEMS, STEMS, st.sampled_from([".png", ".jpg"]))
def test_folders_of_the_same_stems_are_paired_as_others(
    tmp_path_factory, lefts: list[str], rights: list[str], end: str
) -> None:
    lefts, rights = ([*dict.fromkeys(stems), "b"] for stems in (lefts, rights))
    left, right = folders(
        tmp_path_factory.mktemp("dive"),
        [f"{stem}.png" for stem in lefts],
        [f"{stem}{end}" for stem in rights],
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("stereo_seecolor.inputs.pairing._same_stems", lambda *_: None)
        expected = pair_folders(left, right, InputConfig())
    found = pair_folders(left, right, InputConfig())
    assert (list(found.pairs), found.unpaired, found.notes) == (
        list(expected.pairs),
        expected.unpaired,
        expected.notes,
    )
    assert [pair.place for pair in found.pairs] == [pair.place for pair in expected.pairs]
    assert list(found.names) == [pair.name for pair in found.pairs]


@given(st.text(max_size=40))
def test_any_name_is_survived(stem: str) -> None:
    found = timestamp_from_name(stem)
    assert found is None or found > -1e11


def test_counters_that_differ_by_a_constant_are_paired_and_that_is_said(tmp_path: Path) -> None:
    lefts, rights = (
        [f"DSC_{n}.png" for n in (998, 999, 1000, 1003)],
        [f"DSC_{n:04d}.png" for n in (520, 521, 522, 525)],
    )
    pairing = pair_folders(*folders(tmp_path, lefts, rights), InputConfig())
    assert [(pair.name, pair.right.name) for pair in pairing.pairs] == [
        (left[:-4], right) for left, right in zip(lefts, rights, strict=True)
    ]
    assert pairing.notes == (
        "no names match: 4 pairs were paired by the order of their numbers, from "
        "DSC_998.png with DSC_0520.png on",
    )


@pytest.mark.parametrize(
    ("rights", "message"),
    [
        (["DSC_520.png", "DSC_522.png"], "no left image matches a right one"),
        (
            ["DSC_520.png", "DSC_521.png", "DSC_522.png"],
            "2 left and 3 right images are numbered by each camera .* where none is missing",
        ),
    ],
)
def test_counters_of_which_an_image_is_missing_are_not_guessed(
    tmp_path: Path, rights: list[str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        pair_folders(*folders(tmp_path, ["DSC_998.png", "DSC_999.png"], rights), InputConfig())


ROLLED = ["DSC_9997.png", "DSC_9998.png", "DSC_9999.png", "DSC_0001.png", "DSC_0002.png"]
FROM_ZERO = ["P9998.png", "P9999.png", "P0000.png", "P0001.png", "P0002.png"]
CARD = ["100MEDIA/D_0998.png", "100MEDIA/D_0999.png", *(f"101MEDIA/D_000{n}.png" for n in "123")]
CHAPTERS = [f"GX0{part}0123_{n:04d}.png" for part, n in ((1, 0), (1, 30), (1, 60), (2, 0), (2, 30))]
IN_DCIM = ["DCIM/100GOPRO/G0998.png", "DCIM/100GOPRO/G0999.png"] + [
    f"DCIM/101GOPRO/G{n:04d}.png" for n in range(1, 4)
]
CONTINUED = [f"{100 + (n > 300)}CANON/I_{n:04d}.png" for n in range(299, 304)]
PLAIN = [f"X_{n:04d}.png" for n in range(412, 417)]
FRAMES = [f"F_{n:04d}.png" for n in (0, 30, 60, 61, 91)]


@pytest.mark.parametrize(
    ("one", "other"),
    [
        *product((ROLLED, FROM_ZERO, CARD, IN_DCIM), (PLAIN, CONTINUED)),
        (CHAPTERS, FRAMES),
        (ROLLED, ROLLED),
        (FROM_ZERO, FROM_ZERO),
    ],
)
@pytest.mark.parametrize("exchanged", [False, True])
def test_a_counter_that_starts_again_is_followed(
    tmp_path: Path, one: list[str], other: list[str], exchanged: bool
) -> None:
    """In one folder, or with a new one; the order is the dive's."""
    sides = {"left": other, "right": one} if exchanged else {"left": one, "right": other}
    for side, files in sides.items():
        for file in reversed(files):
            (tmp_path / side / file).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / side / file).touch()
    pairing = pair_folders(tmp_path / "left", tmp_path / "right", InputConfig())
    found = [
        (str(pair.left.relative_to(tmp_path / "left")),
         str(pair.right.relative_to(tmp_path / "right")))
        for pair in pairing.pairs
    ]  # fmt: skip
    assert found == list(zip(sides["left"], sides["right"], strict=True))
    assert not pairing.unpaired
