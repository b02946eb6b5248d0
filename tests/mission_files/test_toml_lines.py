"""Lines of keys, held against what tomllib finds in the same text."""

import tomllib

from hypothesis import given
from hypothesis import strategies as st

from fcu.interface.files.toml_lines import lines, nearest

AWKWARD = '''# [not.a.table]
a = 1 # b = 2
"quoted.key" = 'it''s'
[t]
  x.y = [ # a comment with ] and "
    1,

    [2, 3], # more
    { p = "}", q = \'\'\' [
z = 1
\'\'\' },
  ]
s = """
k = "quoted\\""
"""""
date = 2020-01-01T00:00:00Z
[[t.rows]]
n = 1
[[t.rows]]
n = 2
[t.rows.deep]
m = -1e3
'''.replace("'it''s'", "'it # s'")


def paths(value, path=()):
    """Every key and element of a parsed document."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for name, inside in items:
        yield (*path, name)
        if isinstance(inside, dict | list):
            yield from paths(inside, (*path, name))


def test_every_error_of_tomllib_has_a_line():
    found = lines(AWKWARD)
    assert set(paths(tomllib.loads(AWKWARD))) == set(found)


def test_the_lines_are_those_of_the_text():
    found = lines(AWKWARD)
    assert {
        ("a",): 2, ("quoted.key",): 3, ("t",): 4, ("t", "x", "y"): 5, ("t", "x", "y", 0): 6,
        ("t", "x", "y", 1): 8, ("t", "x", "y", 2, "q"): 9, ("t", "s"): 13, ("t", "date"): 16,
        ("t", "rows", 0): 17, ("t", "rows", 1): 19, ("t", "rows", 1, "deep", "m"): 22,
    }.items() <= found.items()  # fmt: skip


def test_what_is_not_there_is_where_it_would_be():
    found = lines(AWKWARD)
    assert nearest(found, ("t", "rows", 1, "missing")) == 19
    assert nearest(found, ("nowhere", "at", "all")) is None


VALUES = st.recursive(
    st.sampled_from(["1", "-2.5", "true", '"]#}"', "'a,b'", '"""\n"x"\n"""']),
    lambda inner: (
        st.lists(inner, max_size=3).map(lambda v: f"[ {', '.join(v)} ]")
        | st.lists(inner, max_size=3).map(
            lambda v: "{ " + ", ".join(f"k{i} = {x}" for i, x in enumerate(v)) + " }"
        )
    ),
    max_leaves=8,
)


@given(st.lists(st.tuples(st.sampled_from(["", "\n", "# x\n"]), VALUES), min_size=1, max_size=6))
def test_any_document_is_walked_to_its_end(entries):
    text = "".join(f"{gap}key{i} = {value} # c\n" for i, (gap, value) in enumerate(entries))
    assert set(paths(tomllib.loads(text))) == set(lines(text))
