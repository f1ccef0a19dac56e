"""Parameters of a vehicle and of rail conditions from a TOML file."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

from co_sim.errors import Fault, InputError, suggestion
from co_sim.wheelset.scenario import Scenario
from co_sim.wheelset.table_files import read_text, tables_of, validated
from estimator.adhesion import Unknowns
from fmu_wheelset import CONDITIONS, RailCondition, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

__all__ = ["Vehicle", "read_vehicle", "read_wheelset"]

_USUAL = Unknowns()


class _Unknown(BaseModel):
    """What the adhesion bank is told that nobody knows: the table ``unknown`` of a vehicle."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    gyro_bias: float = Field(
        _USUAL.bias[0], ge=0.0, description="standard deviation of the gyro's offset, rad/s"
    )
    accelerometer_bias: float = Field(
        _USUAL.bias[1], ge=0.0, description="standard deviation of the accelerometer's offset, m/s2"
    )
    patches: tuple[Annotated[float, Field(gt=0.5, lt=2.0)], ...] = Field(
        _USUAL.patches,
        min_length=1,
        description="sizes of the contact patches held possible, over the nominal one",
    )
    friction: float = Field(
        _USUAL.friction,
        ge=0.0,
        le=0.2,
        description="standard deviation of the friction's logarithm within a condition",
    )
    vehicle: float = Field(
        _USUAL.vehicle,
        gt=0.0,
        le=0.2,
        description="standard deviation of the peak's logarithm that errors of the vehicle leave",
    )
    unlike_rails: bool = Field(_USUAL.unlike_rails, description="whether left and right rail may differ")


class _Unknowns(BaseModel):
    """A file of which only that table is looked at."""

    unknown: _Unknown


@dataclass(frozen=True)
class Vehicle:
    """What the filters know of the vehicle and of rails.

    Parameters
    ----------
    wheelset : its parameters. conditions : by name, those of `CONDITIONS`.
    unknown : what the adhesion bank allows for besides the condition.
    """

    wheelset: WheelsetParameters = field(default_factory=WheelsetParameters)
    conditions: Mapping[str, RailCondition] = field(default_factory=lambda: dict(CONDITIONS))
    unknown: Unknowns = field(default_factory=Unknowns)


def read_vehicle(path: Path) -> Vehicle:
    """Read a vehicle: names of `WheelsetParameters`, tables ``patch``, ``conditions.NAME`` and ``unknown``.

    What is not named keeps its default, also within a condition.

    Raises
    ------
    InputError
        If the file cannot be read, a name is unknown or a value out of bounds; all faults are told.
    """
    wheelset = _tables(path)
    conditions = _completed(path.name, wheelset.pop("conditions", {}))
    said = validated(_Unknowns, {"unknown": wheelset.pop("unknown", {})}, path.name).unknown
    scenario = _scenario(path.name, wheelset, conditions)
    rails = {name: scenario.condition(name) for name in CONDITIONS}
    unknown = Unknowns(
        friction=said.friction,
        vehicle=said.vehicle,
        bias=(said.gyro_bias, said.accelerometer_bias),
        patches=said.patches,
        unlike_rails=said.unlike_rails,
    )
    return Vehicle(scenario.parameters, rails, unknown)


def read_wheelset(path: Path) -> WheelsetParameters:
    """Read the file of a vehicle where the rails are told otherwise: it has no ``conditions``.

    Raises
    ------
    InputError
        As `read_vehicle` does, and if the file has conditions.
    """
    wheelset = _tables(path)
    if "conditions" in wheelset:
        raise InputError(
            f"{path.name}: conditions",
            got="rail conditions",
            expected="parameters of the wheelset alone",
            remedy="leave them out",
        )
    return _scenario(path.name, wheelset, {}).parameters


def _tables(path: Path) -> dict[str, Any]:
    return tables_of(read_text(path, "a TOML file of parameters"), path.name)


def _scenario(file: str, wheelset: dict[str, Any], conditions: dict[str, Any]) -> Scenario:
    """Return the scenario of a wheelset and rail conditions, whose faults are those of the file."""
    try:
        return validated(Scenario, {"wheelset": wheelset, "conditions": conditions}, file)
    except InputError as error:
        shown = [replace(f, what=f.what.replace(": wheelset.", ": ", 1)) for f in error.faults]
        raise InputError.from_faults(shown) from None


def _completed(file: str, given: Any) -> dict[str, Any]:
    """Return the given conditions with the values that they leave out."""
    if not isinstance(given, dict) or not all(isinstance(table, dict) for table in given.values()):
        raise InputError(
            f"{file}: conditions", got=repr(given), expected="tables", remedy="as in [conditions.wet]"
        )
    unknown = [
        Fault(
            f"{file}: conditions.{name}",
            "an unknown condition",
            f"one of {', '.join(CONDITIONS)}",
            suggestion(name, list(CONDITIONS)),
        )
        for name in given
        if name not in CONDITIONS
    ]
    if unknown:
        raise InputError.from_faults(unknown)
    return {name: asdict(CONDITIONS[name]) | table for name, table in given.items()}
