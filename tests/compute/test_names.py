"""Names in little memory, and what is kept by them; and JSON that is made while it is written."""

import json
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereo_seecolor.compute.names import SLOTS, ByName, Names, SomeNames
from stereo_seecolor.files.atomic import holds, write_atomic
from stereo_seecolor.files.json_values import JsonText, Streamed, StreamedList

TEXTS = st.lists(st.text(max_size=12), max_size=3 * SLOTS, unique=True)


@settings(max_examples=30, deadline=None)
@given(TEXTS, st.text(max_size=12))
def test_names_are_found_by_number_and_by_name_also_in_another_process(texts, other):
    for names in (Names(texts), pickle.loads(pickle.dumps(Names(texts)))):
        assert list(names) == texts
        assert [names.number(text) for text in texts] == list(range(len(texts)))
        assert [names.add(text) for text in texts] == list(range(len(texts)))
        assert (other in names) == (other in texts)
        assert names.add(other) == (texts.index(other) if other in texts else len(texts))
        assert names[-1:] == (texts[-1:] if other in texts else [other])


def test_a_name_that_is_no_unicode_comes_back_as_it_was():
    assert Names(["bad\udcff"])[0] == "bad\udcff"


def test_some_of_the_names_are_those_that_were_chosen():
    some = SomeNames(Names("abcd"), np.array([True, False, True, False]))
    assert (list(some), len(some)) == (["a", "c"], 2)
    assert "c" in some
    assert "b" not in some
    assert "x" not in some


def test_items_are_kept_by_name_each_object_once():
    first, second = [1], [2]
    found = ByName([("a", first), ("b", second), ("c", first), ("a", second)])
    for one in (found, pickle.loads(pickle.dumps(found))):
        assert dict(one) == {"a": [2], "b": [2], "c": [1]}
        assert one["a"] is one["b"]
        one.put("d", one["c"])
        assert one["d"] is one["c"]
        assert "e" not in one
        assert one.get("e") is None


@pytest.mark.slow
def test_streamed_json_is_the_text_of_what_it_stands_for(tmp_path):
    content = {"a": {"x": [1.5, None], "y": {}}, "b": ["1", "2"], "none": {}, "empty": []}
    streamed = {
        "a": Streamed(lambda: iter(content["a"].items())),
        "b": StreamedList(lambda: iter(content["b"])),
        "none": Streamed(lambda: iter(())),
        "empty": StreamedList(lambda: iter(())),
    }
    for _ in range(2):  # as often as it is asked for
        assert b"".join(JsonText(streamed)).decode() == json.dumps(content) + "\n"
    text = b"".join(
        JsonText({"deep": {"list": [1, {}], "streamed": streamed}, "é": None}, 2)
    ).decode()
    assert json.loads(text) == {"deep": {"list": [1, {}], "streamed": content}, "é": None}
    # a member a line
    assert '\n      "a": {\n        "x": [1.5, null],\n        "y": {}\n      },' in text
    assert text.startswith('{\n  "deep": {\n    "list": [\n      1,\n      {}\n    ],')
    long = JsonText({"long": StreamedList(lambda: range(50_000))})
    assert len(list(long)) > 3
    write_atomic(tmp_path / "long.json", long)
    assert json.loads((tmp_path / "long.json").read_bytes()) == {"long": list(range(50_000))}
    assert holds(tmp_path / "long.json", long)
    assert not holds(
        tmp_path / "long.json", JsonText({"long": StreamedList(lambda: range(49_999))})
    )
    assert not holds(tmp_path / "long.json", b"".join(long)[:-1])
