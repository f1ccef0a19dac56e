"""Archives and documents that nobody vouches for."""

import io
import stat
import struct
import zipfile

import pytest

from co_sim import FmuComponent, InputError
from co_sim.archives import Limits, contents, read_entry, safe_extract
from co_sim.safe_xml import parse

DOCUMENT = "<fmiModelDescription/>"


@pytest.fixture
def outside(tmp_path):
    """A folder that holds nothing but the folder to unpack into and the archive."""
    (tmp_path / "inside").mkdir()
    yield tmp_path
    assert {p.name for p in tmp_path.iterdir()} == {"inside", "a.fmu"}


def packed(folder, *entries, method=zipfile.ZIP_DEFLATED):
    """Write entries, each a name or `ZipInfo` and its contents."""
    path = folder / "a.fmu"
    with zipfile.ZipFile(path, "w", method) as archive:
        for entry, content in entries:
            archive.writestr(entry, content)
    return path


def special(name, kind):
    info = zipfile.ZipInfo(name)
    info.external_attr = (kind | 0o644) << 16
    return info


def extracted(path):
    folder = path.parent / "inside"
    safe_extract(path, folder)
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_what_is_harmless_is_unpacked_as_it_is(outside):
    path = packed(
        outside, ("a.txt", b"1"), ("deep/er/b.bin", b"2" * 5_000_000), ("./c//d", b""), ("empty/", b"")
    )
    assert extracted(path) == {"a.txt": b"1", "deep/er/b.bin": b"2" * 5_000_000, "c/d": b""}
    assert set(contents(path)) == {"a.txt", "deep/er/b.bin", "c/d"}


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("../evil", "leaves the archive"),
        ("a/../../evil", "leaves the archive"),
        ("a/..", "leaves the archive"),
        ("/etc/evil", "absolute or empty"),
        ("//server/evil", "absolute or empty"),
        ("C:/evil", "backslash or colon"),
        ("C:evil", "backslash or colon"),
        ("file.txt:stream", "backslash or colon"),
        ("..\\evil", "backslash or colon"),
        ("\\\\server\\evil", "backslash or colon"),
        ("a\nb", "control characters"),
        ("a\x1b[2Jb", "control characters"),
        ("x" * 256, "too long"),
        ("ä" * 128, "too long"),
        ("/".join(["abcdefgh"] * 150), "too long"),
        (".", "absolute or empty"),
    ],
)
def test_names_that_lead_elsewhere_are_refused(outside, name, reason):
    path = packed(outside, ("a.txt", b"1"), (name, b"2"))
    with pytest.raises(InputError, match=reason):
        extracted(path)
    assert not list((outside / "inside").iterdir())  # nothing at all is written


def test_a_name_that_readers_cut_at_a_zero_is_refused(outside):
    path = packed(outside, ("modelX.txt", b"1"))
    path.write_bytes(path.read_bytes().replace(b"modelX.txt", b"model\0.txt"))
    with pytest.raises(InputError, match="control characters"):
        extracted(path)


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        (stat.S_IFLNK, "symbolic link"),
        (stat.S_IFIFO, "special file"),
        (stat.S_IFCHR, "special file"),
        (stat.S_IFSOCK, "special file"),
    ],
)
def test_links_and_devices_are_refused(outside, kind, reason):
    path = packed(outside, (special("link", kind), b"/etc"), ("link2/evil", b"2"))
    with pytest.raises(InputError, match=reason):
        extracted(path)


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize(
    ("names", "reason"),
    [
        (["a", "a"], "second entry"),
        (["a", "./a"], "second entry"),
        (["a", "a/b"], "a file and a folder"),
        (["a/", "a"], "a file and a folder"),
    ],
)
def test_entries_that_exclude_each_other_are_refused(outside, names, reason):
    path = packed(outside, *((name, b"") for name in names))
    with pytest.raises(InputError, match=reason):
        extracted(path)


def test_every_fault_of_an_archive_is_told(outside):
    path = packed(outside, ("../a", b""), ("C:b", b""), (special("c", stat.S_IFLNK), b"x"), ("fine", b""))
    with pytest.raises(InputError) as caught:
        contents(path)
    assert [fault.what.split(": ")[1] for fault in caught.value.faults] == ["'../a'", "'C:b'", "'c'"]


@pytest.mark.parametrize(
    ("limits", "reason"),
    [
        (Limits(size=1_000_000), "10000001 bytes unpacked, expected at most 1000000"),
        (Limits(free=1_000_000), "10000000 bytes from .* packed ones, expected at most 200 times"),
        (Limits(entries=1), "2 entries, expected at most 1"),
    ],
)
def test_bombs_are_refused(outside, limits, reason):
    path = packed(outside, ("zeros", bytes(10_000_000)), ("b", b"1"))
    with pytest.raises(InputError, match=reason):
        safe_extract(path, outside / "inside", limits)
    assert not list((outside / "inside").iterdir())
    assert len(extracted(path)) == 2  # within the limits it is a harmless file


def test_a_document_of_any_size_is_not_read(outside):
    path = packed(outside, ("modelDescription.xml", bytes(2_000_000)))
    with pytest.raises(InputError, match="at most 1000000"):
        read_entry(path, "modelDescription.xml", Limits(document=1_000_000))


def rewritten(path, name, offset, field, value):
    """Change a field of the entry of a name in the table of contents."""
    data = bytearray(path.read_bytes())
    at = data.rfind(b"PK\x01\x02", 0, data.rfind(name.encode()))
    struct.pack_into(field, data, at + offset, value)
    path.write_bytes(data)
    return path


def test_entries_that_share_their_bytes_are_refused(outside):
    path = packed(outside, ("a", b"0" * 100), ("b", b"1" * 100))
    rewritten(path, "b", 42, "<I", 0)
    with pytest.raises(InputError, match="an entry inside another one"):
        extracted(path)


@pytest.mark.parametrize(
    ("offset", "field", "value", "reason"),
    [
        (8, "<H", 1, "an encrypted entry"),
        (10, "<H", 99, "the compression method 99"),
        (10, "<H", zipfile.ZIP_LZMA, "the compression method 14"),
        (24, "<I", 10, "a: got .*expected an entry that can be unpacked"),  # smaller than it is
        (24, "<I", 200, "a: got .*expected an entry that can be unpacked"),  # bigger than it is
        (16, "<I", 0, "a: got Bad CRC-32"),
    ],
)
def test_entries_that_nobody_can_unpack_are_told(outside, offset, field, value, reason):
    path = rewritten(packed(outside, ("a", b"0" * 100)), "a", offset, field, value)
    with pytest.raises(InputError, match=reason):
        extracted(path)


def test_an_archive_of_the_folder_instead_of_its_contents_tells_the_remedy(outside):
    path = packed(outside, ("model/modelDescription.xml", DOCUMENT))
    with pytest.raises(InputError, match="pack the contents of the folder, not the folder"):
        FmuComponent(path)


LAUGHS = "".join(f'<!ENTITY a{i + 1} "{f"&a{i};" * 10}">' for i in range(9))


@pytest.mark.parametrize(
    "declared",
    [
        '<!ENTITY x SYSTEM "file:///etc/passwd">',
        '<!ENTITY x SYSTEM "http://localhost:9/x">',
        '<!ENTITY % x SYSTEM "file:///etc/passwd"> %x;',
        f'<!ENTITY a0 "ha">{LAUGHS}',
        "",
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_document_types_are_refused_before_they_are_read(declared, encoding):
    text = f'<?xml version="1.0" encoding="{encoding}"?>\n<!-- c -->\n<!DOCTYPE r [{declared}]>\n'
    text += '<r a="&a9;">&x;&a9;</r>'
    with pytest.raises(InputError, match=r"^m\.xml, line 3: got <!DOCTYPE r>"):
        parse(text.encode(encoding), "m.xml")


def test_a_document_type_in_a_file_of_its_own_is_refused():
    with pytest.raises(InputError, match="DOCTYPE"):
        parse(b'<!DOCTYPE r SYSTEM "http://localhost:9/x.dtd"><r/>', "m.xml")


def test_files_are_not_included():
    root = parse(
        b'<r xmlns:i="http://www.w3.org/2001/XInclude"><i:include href="/etc/passwd" parse="text"/></r>',
        "m.xml",
    )
    assert "".join(root.itertext()) == ""


@pytest.mark.parametrize(
    "data", [b"", b"<", b"<a>", b"<a></b>", b"\0", b"<a>\xff</a>", b"<a" * 100_000, b"<a>" * 300]
)
def test_what_is_not_well_formed_is_refused(data):
    with pytest.raises(InputError, match=r"^m\.xml: got .*expected well-formed XML"):
        parse(data, "m.xml")


def test_the_encodings_of_the_field_are_read():
    for encoding in ("utf-8", "utf-16", "iso-8859-1", "windows-1252"):
        text = f'<?xml version="1.0" encoding="{encoding}"?><a name="Größe"/>'
        assert parse(text.encode(encoding), "m.xml").get("name") == "Größe"


def test_a_model_description_tells_the_line_and_the_element(lag_fmu, tmp_path):
    path = tmp_path / "a.fmu"
    with zipfile.ZipFile(lag_fmu) as archive:
        text = archive.read("modelDescription.xml").decode().replace('start="0.5"', 'start="half"')
    packed(tmp_path, ("modelDescription.xml", text))
    line = 1 + text[: text.index("half")].count("\n")
    with pytest.raises(InputError, match=rf"modelDescription.xml, line {line}: got Element .*'half'"):
        FmuComponent(path)


def test_a_library_outside_the_archive_is_not_loaded(lag_fmus, tmp_path):
    with zipfile.ZipFile(lag_fmus[2]) as archive:
        text = archive.read("modelDescription.xml").decode()
    text = text.replace('modelIdentifier="lag"', 'modelIdentifier="../../../lag"')
    with pytest.raises(InputError, match=r"got no binaries/.*/\.\./\.\./\.\./lag"):
        FmuComponent(packed(tmp_path, ("modelDescription.xml", text), ("binaries/linux64/lag.so", b"")))


def test_an_archive_behind_other_bytes_is_read(outside):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("a", b"1")
    (outside / "a.fmu").write_bytes(b"#!/bin/sh\n" + buffer.getvalue())
    assert extracted(outside / "a.fmu") == {"a": b"1"}
