"""A case as an SSP package, for masters that read one."""

from __future__ import annotations

import zipfile
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from masters.cases import Case

__all__ = ["write_ssp"]

_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"


def write_ssp(case: Case, path: Path) -> Path:
    """Write the case and its FMUs; return the path."""
    with zipfile.ZipFile(path, "w") as package:
        package.writestr("SystemStructure.ssd", _structure(case))
        for fmu in case.fmus:
            package.write(fmu.path, f"resources/{fmu.path.name}")
    return path


def _structure(case: Case) -> str:
    components = []
    for fmu in case.fmus:
        connectors = "".join(
            f'<ssd:Connector name="{name}" kind="{kind}"><ssc:Real/></ssd:Connector>'
            for names, kind in ((fmu.inputs, "input"), (fmu.outputs, "output"))
            for name in names
        )
        components.append(
            f'<ssd:Component name="{fmu.name}" type="application/x-fmu-sharedlibrary" '
            f'source="resources/{fmu.path.name}"><ssd:Connectors>{connectors}</ssd:Connectors></ssd:Component>'
        )
    connections = []
    for source, target in case.connections:
        start, _, output = source.partition(".")
        end, _, put = target.partition(".")
        connections.append(
            f'<ssd:Connection startElement="{start}" startConnector="{output}" '
            f'endElement="{end}" endConnector="{put}"/>'
        )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<ssd:SystemStructureDescription xmlns:ssc="{_SSC}" xmlns:ssd="{_SSD}" version="1.0" name="case">'
        f'<ssd:System name="case"><ssd:Elements>{"".join(components)}</ssd:Elements>'
        f"<ssd:Connections>{''.join(connections)}</ssd:Connections></ssd:System>"
        "</ssd:SystemStructureDescription>\n"
    )
