"""Tyre property files: kept to the byte, read by key, changed in one line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ema.core.errors import InputError
from pipelines.export.tir_file import read_tir, tir_of

ENDS = ("\n", "\r\n", "\r")
BLANKS = st.text(" \t", max_size=4)
WORDS = st.text(st.characters(exclude_characters="\r\n"), max_size=12)
KEYS = st.sampled_from(["LENGTH", "mass", "Belt_Mass", "FREQ_LONG", "X1"])
VALUES = st.sampled_from(
    [
        "'meter'",
        '"kg"',
        "1.5",
        "-.1E+01",
        "2.0D+05",
        "",
        "'a $ b'",
        "one two",
        "'open",
        "'a' b",
        "'",
    ]
)
COMMENTS = st.one_of(st.just(""), WORDS.map(lambda text: f"${text}"), st.just("! said"))
SECTIONS = st.sampled_from(["[UNITS]", "[INERTIA]", " [own section]", "[]", "[SHAPE"])
ENTRIES = st.tuples(KEYS, BLANKS, st.just("="), BLANKS, VALUES, BLANKS, COMMENTS).map("".join)
FREE = st.one_of(
    SECTIONS,
    st.sampled_from(["{radial width}", " 1.0 0.4", "$-------units", "! KEY = 5", "", "\t"]),
    WORDS,
)
LINES = st.one_of(ENTRIES, FREE)
FILES = st.tuples(
    st.sampled_from([b"", b"\xef\xbb\xbf"]),
    st.lists(st.tuples(LINES, st.sampled_from(ENDS)), max_size=12),
    LINES,
    st.sampled_from(["utf-8", "latin-1"]),
).map(
    lambda parts: (
        parts[0]
        + "".join(line + end for line, end in [*parts[1], (parts[2], "")]).encode(
            parts[3], "replace"
        )
    )
)


def tir(text, name="tyre.tir"):
    return tir_of(text.encode(), name)


@given(FILES)
def test_any_file_is_kept_to_the_byte(content):
    assert tir_of(content, "any").content == content


@given(st.binary(max_size=200))
def test_any_bytes_are_kept(content):
    assert tir_of(content, "any").content == content


@given(FILES, KEYS, st.sampled_from(["7.25", "1.23456789012e-05", "millimeter"]))
def test_a_change_touches_its_line_only(content, key, text):
    before = tir_of(content, "any")
    entries = [entry for entry in before.entries if entry.key == key.upper()]
    for entry in entries:
        after = before.with_value(entry, text)
        again = tir_of(after.content, "any")
        assert again.lines == after.lines
        changed = [k for k, pair in enumerate(zip(before.lines, again.lines, strict=True), 1)
                   if pair[0] != pair[1]]  # fmt: skip
        assert changed in ([], [entry.line])
        (found,) = [other for other in again.entries if other.line == entry.line]
        assert (found.section, found.key, found.text) == (entry.section, entry.key, text)


@given(FILES, st.sampled_from(["INERTIA", "STRUCTURAL"]))
def test_an_added_line_leaves_all_others(content, section):
    before = tir_of(content, "any")
    after = tir_of(before.with_entry(section, "ADDED", "5").content, "any")
    (found,) = [entry for entry in after.entries if entry.key == "ADDED"]
    assert (found.section, found.text) == (section, "5")
    kept = [line.rstrip("\r\n") for line in before.lines]
    others = [line.rstrip("\r\n") for line in after.lines]
    others.remove(others[found.line - 1])
    assert others in (kept, [*kept, f"[{section}]"])


def test_entries_are_found_by_key_in_any_case():
    file = tir("\ufeff[Units]\r\nlength = 'mm'  $unit\r\n! MASS = 3\r\n[INERTIA]\nMass=1.5D+01")
    assert file.headings == (("UNITS", 1), ("INERTIA", 4))
    assert file.find("LENGTH", "UNITS").text == "mm"
    assert file.number("mass") == 15.0
    assert file.find("mass", "INERTIA").line == 5
    assert file.find("MASS", "UNITS") is None
    assert file.number("absent") is None


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("MASS   = 1.5     $kg\r\n", "MASS   = 12.345  $kg\r\n"),
        ("MASS   = 1.5 $kg\n", "MASS   = 12.345 $kg\n"),
        ("MASS\t=\t1.5\t$kg\n", "MASS\t=\t12.345\t$kg\n"),
        ("MASS = '1.5' ! kg", "MASS = '12.345' ! kg"),
        ("MASS = 12.34567   $kg\n", "MASS = 12.345     $kg\n"),
        ("MASS =$kg\n", "MASS =12.345 $kg\n"),
        ("MASS = 1.5   \n", "MASS = 12.345   \n"),
    ],
)
def test_columns_and_comments_stay(before, after):
    file = tir(before)
    (entry,) = file.entries
    assert file.with_value(entry, "12.345").content.decode() == after


def test_an_added_line_is_aligned():
    file = tir("[INERTIA]\r\nMASS          = 9.3  $kg\r\n$---\r\n[VERTICAL]\r\nX = 1")
    added = file.with_entry("INERTIA", "BELT_MASS", "7.5").content.decode()
    assert added.split("\r\n")[2:4] == ["BELT_MASS     = 7.5", "$---"]
    added = file.with_entry("VERTICAL", "Y", "2").content.decode()
    assert added.endswith("X = 1\r\nY = 2\r\n")
    added = file.with_entry("NEW", "Y", "2").content.decode()
    assert added.endswith("X = 1\r\n[NEW]\r\nY = 2\r\n")


def test_a_key_given_twice_is_refused():
    with pytest.raises(InputError, match=r"tyre.tir, MASS: given in lines 1 and 3; .*Keep one"):
        tir("MASS = 1\n[A]\nmass = 2\n").find("MASS")


@pytest.mark.parametrize("text", ["'kg'", "1,5", "nan", "1_0", "1.0.0"])
def test_what_is_no_number_is_refused(text):
    with pytest.raises(InputError, match=r"tyre.tir, line 2, MASS: .* it must be a number"):
        tir(f"[INERTIA]\nMASS = {text}\n").number("MASS")


def test_what_is_no_such_file_is_refused(tmp_path):
    path = tmp_path / "any.tir"
    with pytest.raises(InputError, match="it must be a tyre property file"):
        read_tir(path)
    for encoding in ("utf-16", "utf-16-le", "utf-16-be"):
        path.write_bytes("[UNITS]\n".encode(encoding))
        with pytest.raises(InputError, match="UTF-16"):
            read_tir(path)
    path.write_bytes(b"a,b\n1,2\n")
    with pytest.raises(InputError, match="no section"):
        read_tir(path)
