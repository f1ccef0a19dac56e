"""Each fault that a check is for, put into an FMU without faults, is found and nothing else."""

import json
import struct
import zipfile
from dataclasses import asdict
from pathlib import Path

import fmpy
import pytest

import fmu_wheelset
from co_sim.checking import check_fmu, shared_library
from co_sim.checking.shared_library import read_libraries
from co_sim.wheelset.cli import main

HERE = fmpy.sharedLibraryExtension


def found(path, *, run=False, severities=("error", "warning"), **options):
    report = check_fmu(path, run=run, **options)
    return [
        f"{f.severity} {f.topic}: {f.where}: {f.message}" for f in report.findings if f.severity in severities
    ]


def only(path, *words, **options):
    """Assert that there is one finding, with these words."""
    findings = found(path, **options)
    assert len(findings) == 1, findings
    for word in words:
        assert word in findings[0], findings[0]


@pytest.mark.parametrize("version", [2, 3])
def test_what_has_no_faults_passes_and_runs(packed, version):
    path = packed(version)
    report = check_fmu(path)
    assert report.passed
    assert [(f.severity, f.topic) for f in report.findings] == [("note", "short run")]
    assert "50 steps of 0.02 s from t = 1 s" in report.findings[0].message
    json.dumps(asdict(report))


def test_the_wheelset_passes():
    assert not check_fmu(fmu_wheelset.path(fmi=2), run=False).findings
    report = check_fmu(fmu_wheelset.path(fmi=3))
    assert [(f.severity, f.where) for f in report.findings] == [
        ("note", "CoSimulation"),
        ("note", "ModelExchange"),
    ]


BOTH = [
    (('min="0.001"', 'min="2"'), "error start values", '"T"', "start value 1 is out of its bounds 2 to 100"),
    (('min="0.001" max="100"', 'min="100" max="1" '), "error", '"T"', None),
    (('start="-1" min="-1"', 'start="-2" min="-1"'), "error start values", '"steps"', "at least -1"),
    (('start="-1" min="-1"', 'start="x" min="-1"'), "error schema", "line", "'x' is not a valid value"),
    (('declaredType="Trouble" start="0"', 'declaredType="Trouble" start="1"'), "error", '"trouble"', "is no"),
    (('unit="V" start="0.5"', 'unit="W" start="0.5"'), "error units", '"u"', '"W" is not among'),
    (('displayUnit="mV"', 'displayUnit="kV"'), "error units", '"x"', 'unit "kV" is not defined for "V"'),
    (('unit="V" start="0.5"', 'displayUnit="mV" start="0.5"'), "error units", '"u"', "without a unit"),
    (('name="u"', 'name="u v"'), "error names", '"u v"', "structured naming convention"),
    (('name="u"', 'name="der(u"'), "error names", '"der(u"', "structured naming convention"),
    (('name="u"', 'name="a&#9;b"'), "error names", "line", "line break or tab"),
    (('name="u"', 'name="T"'), "error references", '"T"', "the name of line"),
    (('declaredType="Voltage"', 'declaredType="Volt"'), "error references", '"x"', "declaredType='Volt'"),
    (('variability="fixed"', 'variability="discrete"'), "error variability", '"T"', "does not go with"),
    (('Kind="constant"', 'Kind="constant fixed"'), "error", "line", "1 dependencies and 2 kinds"),
    (('unit="V" start="0.5"', 'unit="V" start="INF"'), "warning start values", '"u"', "INF"),
]  # fmt: skip


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(("change", "topic", "where", "message"), BOTH)
def test_faults_of_either_version(packed, version, change, topic, where, message):
    findings = found(packed(version, change))
    fitting = [f for f in findings if f.startswith(topic) and where in f and (message or "") in f]
    assert fitting, findings


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((' start="0.5"/>', "/>"), ['"u"', "no start value, which an input needs"]),
        (
            ('<Real unit="s" start="1" ', '<Real unit="s" '),
            ['"T"', 'no start value, which initial="exact" needs'],
        ),
        (('<Integer start="-1" min="-1"/>', '<Integer start="-1" min="0"/>'), ['"steps"', "at least 0"]),
        (
            ('valueReference="3" causality', 'valueReference="2" causality'),
            None,
        ),
        (('<Real declaredType="Voltage"/>', '<Real declaredType="Trouble"/>'), ["is Real", "is Enumeration"]),
        (
            ('<Unknown index="2" dependencies="3" dependenciesKind="constant"/>', ""),
            ['"direct"', "missing from"],
        ),
        (('<Unknown index="1" dependencies=""/>', '<Unknown index="3" dependencies=""/>'), None),
        (
            ('index="7" dependencies="1 3"', 'index="7" dependencies="1 8"'),
            ["dependencies that are not declared"],
        ),
        (('index="7" dependencies="1 3"', 'index="7" dependencies="1 1"'), ['depends 2 times on "x"']),
        (
            ('index="7" dependencies="1 3"', 'index="7" dependencies="1 2"'),
            ["warning", "neither an input nor a"],
        ),
        (('index="2" dependencies', 'index="0" dependencies'), None),
        (('derivative="1"', 'derivative="77"'), None),
        (('derivative="1"', 'derivative="7"'), None),
        (('<Unknown index="7"/>', ""), ["warning", '"der(x)"', "missing from the initial unknowns"]),
        (('causality="input">', 'causality="input" variability="fixed">'), ["input does not go with"]),
        (('name="x" ', 'name="x" initial="exact" '), None),
        (
            (
                'valueReference="9"><Real unit="V/s" derivative="1"/>',
                'valueReference="9"><Integer start="0"/>',
            ),
            None,
        ),
    ],
)
def test_faults_of_fmi_2(packed, change, words):
    path = packed(2, change)
    if words is None:  # several things are wrong then
        assert found(path)
    else:
        only(path, *words)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ('<Float64 name="time" valueReference="99" causality="independent"/>', ""),
            ["no variable with causality"],
        ),
        (('valueReference="21"', 'valueReference="3"'), ["value reference 3", '"T"']),
        (('start="1 2"', 'start="1 2 3"'), ['"v"', "3 start values for 2 elements"]),
        (('start="2"/>', 'start="99999999"/>'), None),
        (('<Dimension valueReference="20"/>', '<Dimension valueReference="77"/>'), None),
        (
            ('<Dimension valueReference="20"/>', '<Dimension valueReference="20" start="2"/>'),
            ["either a size or"],
        ),
        (
            ('causality="structuralParameter"', 'causality="parameter"'),
            ["no structural parameter of type UInt64"],
        ),
        (('<Output valueReference="0" dependencies=""/>', ""), ['"x"', "is missing from the outputs"]),
        (('<Output valueReference="0"', '<Output valueReference="77"'), None),
    ],
)
def test_faults_of_fmi_3(packed, change, words):
    path = packed(3, change)
    if words is None:
        assert found(path)
    else:
        only(path, *words)


def test_names_of_one_value_in_fmi_2(packed):
    """Two outputs may share a value reference, not two inputs or parameters; their units are the same."""
    assert not found(packed(2, ('valueReference="1" causality', 'valueReference="0" causality')))
    findings = found(packed(2, ('valueReference="3" causality', 'valueReference="2" causality')))
    assert "and both can be set" in findings[0]
    assert "but another unit" in findings[1]


def test_everything_is_told_at_once(packed):
    changes = [BOTH[i][0] for i in (0, 3, 5, 6, 8)]
    findings = found(packed(2, *changes))
    topics = {line.split(":")[0] for line in findings}
    assert topics >= {"error start values", "error schema", "error units", "error names"}
    assert [line for line in findings if "display unit" in line]


def test_an_archive_or_document_that_cannot_be_read_is_the_finding(tmp_path):
    path = tmp_path / "a.fmu"
    path.write_bytes(b"no archive")
    only(path, "error archive", "File is not a zip file")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("../evil", "")
        archive.writestr("/evil", "")
    assert [f.split(":")[0] for f in found(path)] == ["error archive", "error archive"]
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", '<!DOCTYPE a [<!ENTITY b "c">]><a/>')
    only(path, "error model description", "line 1", "DOCTYPE")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", '<a fmiVersion="7.0"/>')
    only(path, "error model description", 'fmiVersion="7.0"')


def test_fmi_1_is_told(tmp_path):
    path = tmp_path / "a.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(
            "modelDescription.xml",
            '<fmiModelDescription fmiVersion="1.0" modelName="a" modelIdentifier="a" guid="a" '
            'numberOfContinuousStates="0" numberOfEventIndicators="0"/>',
        )
    only(path, "is for FMI 1.0; this master runs FMI 2.0 and 3.0")


def test_further_documents_are_validated(packed):
    bad = (
        "terminalsAndIcons/terminalsAndIcons.xml",
        '<fmiTerminalsAndIcons fmiVersion="3.0"><x/></fmiTerminalsAndIcons>',
    )
    only(packed(3, extra=[bad]), "error schema", "terminalsAndIcons.xml, line 1", "Element 'x'")
    evil = ("sources/buildDescription.xml", '<!DOCTYPE a SYSTEM "http://localhost:9/a"><a/>')
    only(packed(3, extra=[evil]), "error schema", "buildDescription.xml", "DOCTYPE")


def test_an_entry_that_cannot_be_unpacked_is_told(packed):
    path = packed(3, extra=[("resources/table.csv", "0123456789" * 10)])
    path.write_bytes(path.read_bytes().replace(b"0123456789", b"0123456780", 1))
    only(path, "error archive", "resources/table.csv", "Bad CRC-32")


# Libraries.


def test_a_missing_function_is_named(packed, renamed):
    path = packed(2, library=renamed("fmi2DoStep", "fmi2DoSlip"))
    only(path, f"binaries/{fmpy.platform}/lag{HERE}", "lacks fmi2DoStep")


def test_a_function_of_another_interface_type_is_a_warning_in_fmi_3(packed, renamed):
    path = packed(3, library=renamed("fmi3EnterContinuousTimeMode", "fmi3EnterContinuousTimeMood"))
    only(path, "warning libraries", "lacks fmi3EnterContinuousTimeMode")


def test_a_library_that_is_none_or_has_another_name_is_told(packed):
    only(packed(2, library=b"no library"), "error libraries", "is no shared library")
    assert any("is missing; CoSimulation needs it" in line for line in found(packed(2, name="lead")))


def test_a_platform_that_is_not_here_is_told_with_those_that_are(packed):
    findings = found(packed(2, folder="win64"), run=True)
    assert any("libraries for win64, but not for" in line for line in findings)


def test_a_library_in_the_folder_of_another_platform_is_told(packed):
    path = packed(
        2,
        extra=[("binaries/win64/lag.dll", elf_of(packed(2))), ("binaries/linux32/lag.so", elf_of(packed(2)))],
    )
    findings = found(path)
    assert len(findings) == 2
    assert "win64/lag.dll: is ELF for X86_64, but its folder is for PE X86_64" in findings[1]
    assert "linux32/lag.so: is ELF for X86_64, but its folder is for ELF X86" in findings[0]


def elf_of(path):
    with zipfile.ZipFile(path) as archive:
        return archive.read(next(name for name in archive.namelist() if name.startswith("binaries/")))


def test_a_library_that_is_missing_here_is_named(packed, lag_fmus):
    data = elf_of(lag_fmus[2])
    name = next(name for name in (b"libc.so.6", b"libm.so.6") if name in data)
    only(
        packed(2, library=data.replace(name, name.replace(b"6", b"9"))),
        "needs lib",
        ".so.9, which is not on this",
    )


def test_a_tool_that_is_needed_is_told(packed):
    path = packed(
        2,
        ('modelIdentifier="lag"', 'modelIdentifier="lag" needsExecutionTool="true"'),
        ('guid="lag"', 'guid="lag" generationTool="Tool 7"'),
    )
    only(path, "warning libraries", "Tool 7")


# The short run.

CRASH, HANG = b"\x0f\x0b", b"\xeb\xfe"


@pytest.mark.parametrize(
    ("function", "phase"),
    [
        ("fmi2Instantiate", "instantiation"),
        ("fmi2DoStep", "step at t = 1 s"),
        ("fmi2FreeInstance", "termination"),
    ],
)
def test_a_crash_is_told_with_its_phase(packed, patched, function, phase):
    only(packed(2, library=patched(function, CRASH)), f"died in the {phase}: signal SIGILL", run=True)


def test_a_hang_is_told(packed, patched):
    path = packed(2, library=patched("fmi2DoStep", HANG))
    only(path, "did not come back from the step at t = 1 s within 2 s", run=True, timeout=2.0)


def test_outputs_that_are_no_numbers_are_told(packed):
    findings = found(packed(2, ('start="0.5"', 'start="NaN"')), run=True, severities=["error"])
    assert len(findings) == 1
    assert 'output "direct" is nan' in findings[0]


def test_a_refusal_is_told_with_the_words_of_the_fmu(packed):
    only(packed(2, ('guid="lag"', 'guid="x"')), "refused in the instantiation", "wrong token x", run=True)


# The command.


def call(*arguments):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    return caught.value.code


def test_the_command_tells_errors_by_its_exit_code(packed, capsys):
    assert call("check", str(packed(2)), "--no-run") == 0
    assert "0 errors, 0 warnings" in " ".join(capsys.readouterr().out.split())
    assert call("check", str(packed(2, BOTH[0][0])), "--no-run") == 1
    out = " ".join(capsys.readouterr().out.split())
    assert "error start values:" in out
    assert "1 error, 0 warnings" in out


def test_findings_as_json(packed, capsys):
    path = packed(2, BOTH[0][0])
    assert call("check", str(path), "--no-run", "--json") == 1
    told = json.loads(capsys.readouterr().out)
    assert told["passed"] is False
    assert told["findings"] == [asdict(f) for f in check_fmu(path, run=False).findings]


def test_texts_from_the_fmu_are_neither_markup_nor_commands_to_the_terminal(packed, capsys):
    path = packed(2, ('name="u"', 'name="[red]u[/] \u202e\x9b2J"'))
    assert call("check", str(path), "--no-run") == 1
    out = capsys.readouterr().out
    assert "[red]u[/]" in out
    assert not set("\u202e\x9b\x1b") & set(out)


def test_a_file_that_is_no_fmu_is_refused(tmp_path, capsys):
    path = tmp_path / "a.txt"
    path.write_text("", encoding="utf-8")
    assert call("check", str(path)) == 2
    assert "expected one of .fmu" in capsys.readouterr().err


def test_what_is_no_library_is_none(tmp_path):
    files = []
    for i, data in enumerate((b"", b"MZ" + bytes(100), b"\x7fELF", struct.pack(">2I", 0xCAFEBABE, 0))):
        files.append(tmp_path / str(i))
        files[i].write_bytes(data)
    assert list(read_libraries(files)) == [None] * 4


@pytest.mark.parametrize(
    ("deed", "expected"),
    [
        ("os.abort()", "was ended by SIGABRT"),
        ("os.kill(os.getpid(), 11)", "was ended by SIGSEGV"),
        ("os._exit(3)", "ended with exit code 3"),
        ("time.sleep(60)", "did not come back within 3 s"),
        ("print('{half', end=''); sys.stdout.flush(); os._exit(0)", "ended with exit code 0"),
    ],
)
def test_a_library_that_kills_its_reader_is_told_and_the_others_are_read(
    tmp_path, monkeypatch, deed, expected
):
    """In place of a library that breaks lief stands a reader that breaks by itself."""
    reader = tmp_path / "reader.py"
    reader.write_text(
        "import json, os, sys, time\n"
        "for file in sys.argv[3:]:\n"
        f"    if file.endswith('bad'): {deed}\n"
        "    print('null', flush=True)\n",
        encoding="utf-8",
    )
    monkeypatch.setattr(shared_library, "_READER", reader)
    monkeypatch.setattr(shared_library, "_TIME", 3)
    files = [tmp_path / name for name in ("good", "bad", "better", "best")]
    for file in files:
        file.touch()
    first, bad, *others = read_libraries(files)
    assert first is None
    assert expected in bad
    assert others == [None, None]


def test_a_reader_that_dies_is_a_finding(packed, tmp_path, monkeypatch):
    reader = tmp_path / "reader.py"
    reader.write_text("import os\nos.abort()\n", encoding="utf-8")
    monkeypatch.setattr(shared_library, "_READER", reader)
    only(packed(2), "error libraries: binaries/", "the process that read it was ended by SIGABRT")


@pytest.mark.parametrize(
    ("name", "form", "machine"),
    [
        ("win64/logging.dll", "PE", "X86_64"),
        ("darwin64/logging.dylib", "MACHO", "X86_64"),
        ("linux64/logging.so", "ELF", "X86_64"),
    ],
)
def test_libraries_of_other_systems_are_read(name, form, machine):
    """The libraries are those that fmpy brings for each system."""
    (library,) = read_libraries([Path(fmpy.__file__).parent / "logging" / name])
    assert library.format == form
    assert machine in library.machines
    assert "addLoggerProxy" in library.exports
    assert library.needs
