"""What fmpy leaves out of the description of an FMU for FMI 3."""

from __future__ import annotations

import zipfile
from typing import TYPE_CHECKING
from xml.etree import ElementTree

if TYPE_CHECKING:
    from pathlib import Path

    from fmpy.model_description import ModelDescription

__all__ = ["complete"]


def complete(description: ModelDescription, path: Path) -> None:
    """Add directional derivatives, bounds of unsigned integers and start values of arrays of texts.

    Parameters
    ----------
    description : as fmpy reads it.
    path : the archive.
    """
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
    for kind, interface in (
        ("CoSimulation", description.coSimulation),
        ("ModelExchange", description.modelExchange),
    ):
        element = root.find(kind)
        if element is not None:
            provided = element.get("providesDirectionalDerivatives") in {"true", "1"}
            interface.providesDirectionalDerivative = provided
    elements = {element.get("name"): element for element in root.iterfind("ModelVariables/*")}
    for variable in description.modelVariables:
        element = elements.get(variable.name)
        if element is None:
            continue
        if variable.type.startswith("UInt"):
            variable.min, variable.max = element.get("min"), element.get("max")
        if variable.type == "String" and variable.dimensions:
            variable.start = [start.get("value", "") for start in element.iterfind("Start")] or None
