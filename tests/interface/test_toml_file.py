"""Users' TOML files: what is wrong is told with file and line, and close names are suggested."""

from __future__ import annotations

import pytest

from fcu.interface.files import toml_file
from fcu.interface.files.spelling import suggestion, suggestion_or_list
from fcu.interface.files.toml_file import FileError


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (None, "x.toml: No such file or directory"),
        (b"a = 1\nb = \n", "x.toml:2: Invalid value"),
        (b"a = '\xff'\n", "x.toml: expected UTF-8 text (invalid start byte)"),
        (b"\xef\xbb\xbfa = 1\n", "x.toml:1: expected UTF-8 without a byte order mark"),
        (b"#" * (toml_file.MOST_BYTES + 1), "x.toml: larger than 256 KiB"),
    ],
)
def test_a_file_that_cannot_be_read_is_told_by_its_name(tmp_path, data, said):
    if data is not None:
        (tmp_path / "x.toml").write_bytes(data)
    with pytest.raises(FileError) as told:
        toml_file.read(tmp_path / "x.toml", source="x.toml")
    assert str(told.value).startswith(said)


def test_a_file_says_where_its_keys_stand(tmp_path):
    (tmp_path / "x.toml").write_text("title = 'x'\n[law]\nf_m = 1.0\n")
    file = toml_file.read(tmp_path / "x.toml", source="x.toml")
    assert file.tables == {"title": "x", "law": {"f_m": 1.0}}
    places = [file.where(*path) for path in (("law", "f_m"), ("law", "gamma"), ("wind",))]
    assert places == ["x.toml:3", "x.toml:2", "x.toml"]


def test_a_close_word_is_suggested_and_few_words_are_listed():
    assert suggestion("gama", ["gamma", "f_m"]) == " (did you mean gamma?)"
    assert suggestion("x", ["gamma"]) == ""
    assert suggestion_or_list("x", ["gamma", "f_m"]) == "; there are gamma, f_m"
    assert suggestion_or_list("x", ["gamma", "f_m"], most=1) == ""
