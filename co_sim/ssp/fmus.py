"""What the reader of SSP wants to know of an FMU, and how elements and components are named."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from co_sim.fmi_description import read_description
from co_sim.fmu_variables import attribute, variables_of
from co_sim.fmu_variables import units_of as units_of_fmu
from co_sim.ssp.elements import Measure

if TYPE_CHECKING:
    from collections.abc import Mapping

    from fmpy.model_description import ModelVariable

    from co_sim.ssp.elements import Path
    from co_sim.ssp.sources import PackedFile
    from co_sim.units import Unit

__all__ = ["Fmu", "element_of", "name_of"]


def name_of(path: Path) -> str:
    """Return the name of a component: its path with slashes. Dots are for ports, and written ``%2E`` here."""
    return "/".join(path).replace(".", "%2E")


def element_of(name: str) -> str:
    """Return the name of an element for a component: the inverse of `name_of` for a flat system."""
    return name.replace("%2E", ".")


@dataclass(frozen=True)
class Fmu:
    """What the description of an FMU says.

    Parameters
    ----------
    variables, units : by name.
    interfaces : those of ``"CoSimulation"`` and ``"ModelExchange"`` that there are.
    step_size : of the default experiment, s; ``None`` where it does not tell.
    """

    variables: Mapping[str, ModelVariable]
    units: Mapping[str, Unit]
    interfaces: list[str]
    step_size: float | None

    @classmethod
    def read(cls, file: PackedFile) -> Fmu:
        """Read the description of an FMU."""
        description = read_description(file.path)
        offered = {"CoSimulation": description.coSimulation, "ModelExchange": description.modelExchange}
        return cls(
            variables_of(description),
            units_of_fmu(description),
            [name for name, interface in offered.items() if interface],
            float(getattr(description.defaultExperiment, "stepSize", None) or 0.0) or None,
        )

    def measure(self, name: str) -> Measure | None:
        """Return the unit of a variable, where the FMU tells it."""
        unit = attribute(self.variables[name], "unit") if name in self.variables else None
        return None if not unit else Measure(unit, self.units.get(unit))
