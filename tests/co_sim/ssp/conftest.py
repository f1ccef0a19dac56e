"""Packages written by hand from the standard, around the small FMUs of the other tests."""

import zipfile
from pathlib import Path

import pytest

NAMESPACES = " ".join(
    f'xmlns:{short}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for short, name in {
        "ssd": "Description",
        "ssc": "Common",
        "ssv": "ParameterValues",
        "ssm": "ParameterMapping",
        "ssb": "SignalDictionary",
    }.items()
)


def ssd(system, rest="", version="1.0"):
    """Return a description with a root system."""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<ssd:SystemStructureDescription {NAMESPACES} '
        f'version="{version}" name="test">\n{system}\n{rest}\n</ssd:SystemStructureDescription>\n'
    )


def system(elements, connections="", *, name="root", before="", after="", attributes=""):
    """Return a system; `before` holds its connectors and bindings, `after` its dictionaries."""
    wires = f"<ssd:Connections>{connections}</ssd:Connections>" if connections else ""
    return (
        f'<ssd:System name="{name}" {attributes}>{before}<ssd:Elements>{elements}</ssd:Elements>'
        f"{wires}{after}</ssd:System>"
    )


def component(name, inside="", source="resources/lag.fmu", attributes=""):
    return f'<ssd:Component name="{name}" source="{source}" {attributes}>{inside}</ssd:Component>'


def connectors(*entries):
    """Return connectors from ``"name:kind"`` or ``"name:kind:unit"``."""
    found = []
    for entry in entries:
        name, kind, *unit = entry.split(":")
        typed = f'<ssc:Real unit="{unit[0]}"/>' if unit else ""
        found.append(f'<ssd:Connector name="{name}" kind="{kind}">{typed}</ssd:Connector>')
    return f"<ssd:Connectors>{''.join(found)}</ssd:Connectors>"


def wire(source, target, inside="", attributes=""):
    """Return a connection between ``"element.connector"``, or ``".connector"`` of the system itself."""
    ends = []
    for side, end in (("start", source), ("end", target)):
        element, _, connector = end.rpartition(".")
        owner = f'{side}Element="{element}" ' if element else ""
        ends.append(f'{owner}{side}Connector="{connector}"')
    return f"<ssd:Connection {' '.join(ends)} {attributes}>{inside}</ssd:Connection>"


def values(*parameters, units="", version="1.0"):
    """Return a parameter set from ``(name, type, attributes)``."""
    rows = "".join(
        f'<ssv:Parameter name="{name}"><ssv:{kind} {attributes}/></ssv:Parameter>'
        for name, kind, attributes in parameters
    )
    return (
        f'<ssv:ParameterSet {NAMESPACES} version="{version}" name="p"><ssv:Parameters>{rows}</ssv:Parameters>'
        f"{units}</ssv:ParameterSet>"
    )


def bindings(*inside):
    """Return parameter bindings, each from its attributes and its contents."""
    rows = "".join(f"<ssd:ParameterBinding {a}>{b}</ssd:ParameterBinding>" for a, b in inside)
    return f"<ssd:ParameterBindings>{rows}</ssd:ParameterBindings>"


def inline(*parameters, attributes="", mapping="", units=""):
    """Return one binding with its values in place."""
    return (
        attributes,
        f"<ssd:ParameterValues>{values(*parameters, units=units)}</ssd:ParameterValues>{mapping}",
    )


def real(name, value, unit=""):
    return name, "Real", f'value="{value}"' + (f' unit="{unit}"' if unit else "")


UNITS = """<ssd:Units>
<ssc:Unit name="V"><ssc:BaseUnit kg="1" m="2" s="-3" A="-1"/></ssc:Unit>
<ssc:Unit name="mV"><ssc:BaseUnit kg="1" m="2" s="-3" A="-1" factor="0.001"/></ssc:Unit>
<ssc:Unit name="shifted"><ssc:BaseUnit kg="1" m="2" s="-3" A="-1" offset="5"/></ssc:Unit>
<ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit>
<ssc:Unit name="ell"><ssc:BaseUnit m="1" factor="0.5"/></ssc:Unit>
</ssd:Units>"""


@pytest.fixture
def pack(tmp_path, lag_fmus, parrots):
    """Write an archive, or with ``bare=True`` a folder; return the path to be read."""

    def write(description, files=(), *, bare=False, name="test"):
        contents = {
            "SystemStructure.ssd": description.encode() if isinstance(description, str) else description,
            "resources/lag.fmu": lag_fmus[2].read_bytes(),
            "resources/lag3.fmu": lag_fmus[3].read_bytes(),
            "resources/the parrot.fmu": parrots[3].read_bytes(),
            **{key: data.encode() if isinstance(data, str) else data for key, data in dict(files).items()},
        }
        if bare:
            for key, data in contents.items():
                path = tmp_path / name / key
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(data)
            return tmp_path / name / "SystemStructure.ssd"
        path = Path(tmp_path / f"{name}.ssp")
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for key, data in contents.items():
                archive.writestr(key, data)
        return path

    return write
