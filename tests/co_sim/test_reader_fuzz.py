"""Mutated archives and model descriptions: whatever is in them, the reader knows one exception."""

import io
import os
import random
import zipfile
from contextlib import suppress
from pathlib import Path

import fmpy
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree
from rich.console import Console

import fmu_wheelset
from co_sim import ExchangeFmu, FmuComponent, InputError
from co_sim.archives import safe_extract
from co_sim.checking import check_fmu
from co_sim.fmu_summary import summarise
from co_sim.tables import report_tables, summary_tables

FOLDER = Path(__file__).parent
#: To look further: WHEELSET_FUZZ_EXAMPLES=10000.
EXAMPLES = int(os.environ.get("WHEELSET_FUZZ_EXAMPLES", "60"))
BOUNDED = settings(
    max_examples=EXAMPLES,
    deadline=None,
    derandomize=EXAMPLES == 60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
#: Values that each have broken some reader of numbers, names or lists.
NASTY = [
    *("", " ", "0", "-1", "1", "2", "7", "99", "4294967295", "4294967296", "18446744073709551615", "1e400"),
    *("NaN", "INF", "-INF", "0x10", "1_0", "½", "true", "2.0", "3.0", "3.1", "1.0", "1 2 3", "0 0", "1,2"),
    *("\N{SNOWMAN}", "x" * 5000, "a.b[1]", "der(x)", "../../x", "input", "output", "parameter", "local"),
    *("structuralParameter", "independent", "continuous", "discrete", "constant", "exact", "calculated"),
    *("Real", "Voltage", "Trouble", "Colour", "lag", "m"),
]


def described(version):
    return (FOLDER / f"parrot{version}.xml").read_bytes()


def own(version):
    with zipfile.ZipFile(fmu_wheelset.path(fmi=version)) as archive:
        return archive.read("modelDescription.xml")


SOURCES = [described(2), described(3), own(2), own(3)]


def packed(folder, description):
    """Return an archive with libraries of every name that a description might ask for here."""
    path = folder / "a.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", description)
        for platform in (fmpy.platform, fmpy.platform_tuple):
            for name in ("parrot", "wheelset", "lag"):
                archive.writestr(f"binaries/{platform}/{name}{fmpy.sharedLibraryExtension}", b"no library")
    return path


def read(path):
    """Do all that is done without loading a library."""
    for component in (FmuComponent, ExchangeFmu):
        with suppress(InputError):
            component(path)
    with suppress(InputError):
        show(summary_tables(summarise(path), every=True))
    show(report_tables(check_fmu(path, run=False)))


def show(parts):
    console = Console(file=io.StringIO(), width=80)
    for part in parts:
        console.print(part)


def elements(root):
    return list(root.iter(etree.Element))


def mutate(root, chance):
    """Change a document in one way."""
    element = chance.choice(elements(root))
    parent = element.getparent()
    kind = chance.randrange(7)
    if kind == 0 and element.attrib:
        element.set(chance.choice(list(element.attrib)), chance.choice(NASTY))
    elif kind == 1 and element.attrib:
        del element.attrib[chance.choice(list(element.attrib))]
    elif kind == 2 and element.attrib:
        # The value of another attribute anywhere, which is likely to be of a type that is allowed.
        other = chance.choice([e for e in elements(root) if e.attrib])
        element.set(chance.choice(list(element.attrib)), chance.choice(list(other.attrib.values())))
    elif kind == 3 and parent is not None:
        parent.remove(element)
    elif kind == 4 and parent is not None:
        parent.append(etree.fromstring(etree.tostring(element)))
    elif kind == 5:
        other = chance.choice(elements(root))
        name = chance.choice(list(other.attrib) or ["name"])
        element.set(name, chance.choice([other.get(name) or "", chance.choice(NASTY)]))
    elif kind == 6:
        element.tag = chance.choice(elements(root)).tag


@BOUNDED
@given(source=st.sampled_from(SOURCES), seed=st.integers(0, 2**32), n=st.integers(1, 4))
def test_mutated_model_descriptions(tmp_path, source, seed, n):
    root, chance = etree.fromstring(source), random.Random(seed)
    for _ in range(n):
        mutate(root, chance)
    read(packed(tmp_path, etree.tostring(root)))


@BOUNDED
@given(
    source=st.sampled_from(SOURCES),
    places=st.lists(st.floats(0, 1), min_size=1, max_size=4),
    pieces=st.lists(
        st.sampled_from([b"", b"<", b"&", b"&x;", b'"', b"\0", b"\xff\xfe", b"]]>", b"<!--", b"1"])
    ),
)
def test_descriptions_with_bytes_put_in(tmp_path, source, places, pieces):
    data = source
    for place, piece in zip(places, [*pieces, b"<!DOCTYPE a>"], strict=False):
        k = int(place * len(data))
        data = data[:k] + piece + data[k + len(piece) % 3 :]
    read(packed(tmp_path, data))


@BOUNDED
@given(
    changes=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), min_size=1, max_size=6),
    in_table=st.booleans(),
    end=st.sampled_from([1.0, 1.0, 1.0, 0.99, 0.5]),
)
def test_mutated_archives(tmp_path, changes, in_table, end):
    folder = tmp_path / "inside"
    path = packed(tmp_path, described(3))
    data = bytearray(path.read_bytes())
    first = data.find(b"PK\x01\x02") if in_table else 0
    for place, value in changes:
        data[min(first + int(place * (len(data) - first)), len(data) - 1)] = value
    path.write_bytes(data[: int(end * len(data))])
    folder.mkdir(exist_ok=True)
    read(path)
    with suppress(InputError):
        safe_extract(path, folder)
    assert {p.name for p in tmp_path.iterdir()} == {"a.fmu", "inside"}
    remove(folder)


def remove(folder):
    for path in sorted(folder.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()


@pytest.mark.parametrize("source", SOURCES, ids=["parrot2", "parrot3", "wheelset2", "wheelset3"])
def test_what_is_mutated_is_read_as_it_is(tmp_path, source):
    """Were the sources refused, no mutation would reach what lies behind the first check."""
    FmuComponent(packed(tmp_path, source))
