"""The variables of the wheelset FMU: the one table that both standards, the C code and the docs are made of.

The position of a variable is its value reference in FMI 2 and FMI 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import IntEnum
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

from fmu_wheelset.parameters import CONDITIONS, V_REGULAR, RailCondition, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from dataclasses import Field

__all__ = ["REFERENCES", "UNITS", "VARIABLES", "DriveMode", "Variable"]

Kind = Literal["Float64", "Enumeration", "Boolean"]
Causality = Literal["independent", "parameter", "input", "output", "local"]
Variability = Literal["fixed", "discrete", "continuous"]
Initial = Literal["exact", "calculated"]


class DriveMode(IntEnum):
    """How the wheels are driven: the values of the parameter ``drive_mode``."""

    PRESCRIBED_CREEP = 1
    FREE_ROLLING = 2
    TORQUE_DRIVEN = 3


#: Units by name, as exponents of SI base units.
UNITS: Mapping[str, Mapping[str, int]] = MappingProxyType(
    {
        "1": {},
        "s": {"s": 1},
        "m": {"m": 1},
        "m/s": {"m": 1, "s": -1},
        "m/s2": {"m": 1, "s": -2},
        "s/m": {"s": 1, "m": -1},
        "1/m": {"m": -1},
        "rad": {"rad": 1},
        "rad/s": {"rad": 1, "s": -1},
        "rad/s2": {"rad": 1, "s": -2},
        "rad/m": {"rad": 1, "m": -1},
        "kg": {"kg": 1},
        "kg.m2": {"kg": 1, "m": 2},
        "N": {"kg": 1, "m": 1, "s": -2},
        "N/m": {"kg": 1, "s": -2},
        "N.s/m": {"kg": 1, "s": -1},
        "N.m": {"kg": 1, "m": 2, "s": -2},
        "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
        "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
        "Pa": {"kg": 1, "m": -1, "s": -2},
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Variable:
    """One scalar variable of the FMU.

    Parameters
    ----------
    name, unit, description : as in ``modelDescription.xml``; enumerations and Booleans have no unit.
    field : where the C struct ``Component`` holds the value.
    kind, causality, variability, initial : FMI attributes; `initial` is ``None`` where FMI has none.
    start : value before initialisation; ``None`` if the model computes it.
    minimum, maximum : bounds, both allowed.
    nominal : typical magnitude; also scales the error of the integrator for states.
    derivative_of : name of the variable whose time derivative this is.
    depends_on : inputs and states on which an output or derivative depends directly.
    """

    name: str
    field: str
    causality: Causality
    description: str
    kind: Kind = "Float64"
    variability: Variability = "continuous"
    initial: Initial | None = None
    unit: str | None = None
    start: float | None = None
    minimum: float = -math.inf
    maximum: float = math.inf
    nominal: float | None = None
    derivative_of: str | None = None
    depends_on: tuple[str, ...] = ()

    @property
    def is_state(self) -> bool:
        """Whether the variable is a continuous state."""
        return self.field.startswith("wheelset.x[")


SIDES = ("left", "right")
Facts = dict[str, Any]


def _bounds(declared: Field[Any]) -> Facts:
    """Bounds of a quantity; the smallest number above an excluded minimum stands for it."""
    facts = declared.metadata
    lowest = facts["minimum"] if facts["minimum_allowed"] else math.nextafter(facts["minimum"], math.inf)
    return {"unit": facts["unit"], "minimum": lowest, "maximum": facts["maximum"]}


def _quantity_parameters(owner: object, prefix: str, field: str, skip: frozenset[str]) -> Iterator[Variable]:
    """One fixed parameter for each quantity of a frozen dataclass with defaults."""
    for declared in fields(owner):  # type: ignore[arg-type]
        if "unit" in declared.metadata and declared.name not in skip:
            yield Variable(
                name=prefix + declared.name,
                field=field + declared.name,
                causality="parameter",
                variability="fixed",
                initial="exact",
                start=getattr(owner, declared.name),
                description=declared.metadata["description"],
                **_bounds(declared),
            )


def _parameters() -> Iterator[Variable]:
    fixed: Facts = {"causality": "parameter", "variability": "fixed", "initial": "exact"}
    wheelset = WheelsetParameters()
    # The normal load is an input of each wheel, so that a vehicle can supply it.
    yield from _quantity_parameters(wheelset, "", "wheelset.p.", frozenset({"N"}))
    yield from _quantity_parameters(wheelset.patch, "patch.", "wheelset.p.patch.", frozenset())
    yield Variable(
        name="v0",
        field="wheelset.p.v0",
        unit="m/s",
        start=V_REGULAR,
        minimum=math.nextafter(0.0, 1.0),
        description="speed below which creepages are divided by a regularised speed",
        **fixed,
    )
    yield Variable(
        name="initial_creepage",
        field="wheelset.p.initial_creepage",
        unit="1",
        start=0.0,
        description="longitudinal creepage of both wheels at the start, torque driven",
        **fixed,
    )
    yield Variable(
        name="drive_mode",
        field="wheelset.p.drive_mode",
        kind="Enumeration",
        start=DriveMode.PRESCRIBED_CREEP.value,
        minimum=min(DriveMode),
        maximum=max(DriveMode),
        description="how the wheels are driven",
        **fixed,
    )
    yield Variable(
        name="forward_dynamics",
        field="wheelset.p.forward_dynamics",
        kind="Boolean",
        start=0,
        minimum=0,
        maximum=1,
        description="true: the forward speed is a state that starts from `speed`; false: it follows `speed`",
        **fixed,
    )


def _input(name: str, unit: str, description: str, **facts: Any) -> Variable:
    defaults: Facts = {"start": 0.0, "field": f"wheelset.u.{name}", "causality": "input"}
    return Variable(name=name, unit=unit, description=description, **(defaults | facts))


def _inputs() -> Iterator[Variable]:
    yield _input("speed", "m/s", "forward speed, or its start with forward dynamics", start=20.0)
    yield _input("prescribed_creepage", "1", "longitudinal creepage imposed on both wheels")
    yield _input("traction_torque", "N.m", "drive torque on the right wheel, torque driven")
    yield _input("suspension_lateral_force", "N", "lateral force of the suspension on the wheelset")
    yield _input("suspension_yaw_moment", "N.m", "yaw moment of the suspension besides the yaw stiffness")
    yield _input("curve_force", "N", "lateral force in curves besides that of the wheelset's own mass")
    yield _input("curvature", "1/m", "curvature of the track, positive to the left", nominal=1e-3)
    yield _input("cant", "m", "height of the right rail above the left", nominal=0.1)
    yield _input("running_resistance", "N", "force against the motion with forward dynamics")
    yield _input("track_lateral_offset", "m", "lateral irregularity of the track", nominal=1e-3)
    for side in SIDES:
        wheel = f"wheelset.u.wheel[{side.upper()}]"
        yield _input(
            f"normal_load_{side}",
            "N",
            f"normal load of the {side} wheel; none or less lifts it",
            field=f"{wheel}.normal_load",
            start=WheelsetParameters().N,
            nominal=WheelsetParameters().N,
        )
        for declared in fields(RailCondition):
            yield _input(
                f"rail_{side}.{declared.name}",
                description=f"{declared.metadata['description']}, {side} rail",
                field=f"{wheel}.rail.{declared.name}",
                start=getattr(CONDITIONS["dry"], declared.name),
                **_bounds(declared),
            )


SPEED = ("speed", "state.forward_speed")
GUIDANCE = (*SPEED, "curvature", "track_lateral_offset", "lateral_displacement", "yaw_rate")
LATERAL_CREEPAGE = (*SPEED, "yaw_angle", "lateral_velocity")


def _longitudinal_creepage(side: str) -> tuple[str, ...]:
    return (*GUIDANCE, "prescribed_creepage", f"state.wheel_speed_{side}")


def _contact(side: str) -> tuple[str, ...]:
    return (f"normal_load_{side}", *(f"rail_{side}.{declared.name}" for declared in fields(RailCondition)))


def _creep_force(side: str) -> tuple[str, ...]:
    names = (*_longitudinal_creepage(side), *LATERAL_CREEPAGE, *_contact(side))
    return tuple(dict.fromkeys(names))


BOTH_FORCES = tuple(dict.fromkeys((*_creep_force("left"), *_creep_force("right"))))
TWIST = ("axle_twist", "state.wheel_speed_left", "state.wheel_speed_right")


def _state(name: str, index: str, unit: str, nominal: float, description: str, **facts: Any) -> Variable:
    exact: Facts = {"causality": "output", "initial": "exact", "start": 0.0, "depends_on": (name,)}
    return Variable(
        name=name,
        field=f"wheelset.x[{index}]",
        unit=unit,
        nominal=nominal,
        description=description,
        **(exact | facts),
    )


def _states() -> Iterator[Variable]:
    computed: Facts = {"causality": "local", "initial": "calculated", "start": None, "depends_on": ()}
    yield _state("lateral_displacement", "Y", "m", 1e-3, "lateral displacement of the wheelset")
    yield _state("yaw_angle", "PSI", "rad", 1e-3, "yaw angle of the wheelset")
    yield _state(
        "lateral_velocity", "Y_DOT", "m/s", 1e-2, "lateral velocity", derivative_of="lateral_displacement"
    )
    yield _state("yaw_rate", "PSI_DOT", "rad/s", 1e-3, "yaw rate", derivative_of="yaw_angle")
    for side in SIDES:
        yield _state(
            f"state.wheel_speed_{side}",
            f"OMEGA_{side[0].upper()}",
            "rad/s",
            1e-1,
            f"spin of the {side} wheel, torque driven",
            **computed,
        )
    yield _state("axle_twist", "THETA", "rad", 1e-3, "twist of the axle, right against left")
    yield _state("state.forward_speed", "V", "m/s", 1e-1, "forward speed with forward dynamics", **computed)


def _computed(name: str, field: str, unit: str, description: str, **facts: Any) -> Variable:
    output: Facts = {"causality": "output", "initial": "calculated"}
    return Variable(name=name, field=field, unit=unit, description=description, **(output | facts))


def _derivative(state: str, index: str, unit: str, depends_on: tuple[str, ...]) -> Variable:
    return _computed(
        f"der({state})",
        f"x_dot[{index}]",
        unit,
        f"time derivative of {state}",
        causality="local",
        derivative_of=state,
        depends_on=depends_on,
    )


def _derivatives() -> Iterator[Variable]:
    yield _computed(
        "lateral_acceleration",
        "x_dot[Y_DOT]",
        "m/s2",
        "lateral acceleration",
        derivative_of="lateral_velocity",
        depends_on=(*BOTH_FORCES, "suspension_lateral_force", "curve_force", "cant"),
    )
    yield _derivative("yaw_rate", "PSI_DOT", "rad/s2", (*BOTH_FORCES, "suspension_yaw_moment"))
    for side in SIDES:
        torques = TWIST if side == "left" else (*TWIST, "traction_torque")
        known = dict.fromkeys((*_creep_force(side), *torques))
        del known["prescribed_creepage"]  # the wheel speeds move only where no creepage is prescribed
        state = f"state.wheel_speed_{side}"
        yield _derivative(state, f"OMEGA_{side[0].upper()}", "rad/s2", tuple(known))
    yield _derivative("axle_twist", "THETA", "rad/s", TWIST[1:])
    known = dict.fromkeys((*BOTH_FORCES, "running_resistance"))
    del known["speed"]  # the speed moves only where it does not follow the input
    yield _derivative("state.forward_speed", "V", "m/s2", tuple(known))


def _axle_outputs() -> Iterator[Variable]:
    yield _computed(
        "relative_displacement",
        "outputs.relative_displacement",
        "m",
        "lateral displacement of the wheelset against the track",
        depends_on=("lateral_displacement", "track_lateral_offset"),
    )
    yield _computed("forward_speed", "outputs.forward_speed", "m/s", "forward speed", depends_on=SPEED)
    yield _computed(
        "axle_torque", "outputs.axle_torque", "N.m", "torque in the axle, left to right", depends_on=TWIST
    )
    yield _computed(
        "adhesion_used",
        "outputs.adhesion_used",
        "1",
        "longitudinal creep force of both wheels over their normal load",
        depends_on=BOTH_FORCES,
    )
    yield _computed(
        "flange_force",
        "outputs.flange_force",
        "N",
        "lateral force of the rail on the flange",
        depends_on=("lateral_displacement", "lateral_velocity", "track_lateral_offset"),
    )


def _wheel_outputs(side: str) -> Iterator[Variable]:
    def output(group: str, name: str, unit: str, description: str, depends_on: tuple[str, ...]) -> Variable:
        field = f"{group}[{side.upper()}].{name}"
        return _computed(f"{side}.{name}", field, unit, f"{description}, {side} wheel", depends_on=depends_on)

    wheel = "outputs.wheel"
    force = _creep_force(side)
    spin = (*SPEED, "prescribed_creepage", f"state.wheel_speed_{side}")
    yield output(wheel, "wheel_speed", "rad/s", "spin", spin)
    yield output(wheel, "creepage_x", "1", "longitudinal creepage", _longitudinal_creepage(side))
    yield output(wheel, "creepage_y", "1", "lateral creepage", LATERAL_CREEPAGE)
    yield output(wheel, "creep_force_x", "N", "longitudinal creep force", force)
    yield output(wheel, "creep_force_y", "N", "lateral creep force", force)
    yield output(wheel, "adhesion_used", "1", "resulting creep force over normal load", force)
    yield output(wheel, "g11", "N", "tangent dF/dlambda of the creep force along the creepage", force)
    yield output(wheel, "g22", "N", "secant F/lambda of the creep force", force)
    contact = (*SPEED, *_contact(side))
    yield output("peak", "adhesion_peak", "1", "largest longitudinal creep force over normal load", contact)
    yield output("peak", "creep_peak", "1", "creep at the largest longitudinal creep force", contact)


def _table() -> Iterator[Variable]:
    yield Variable(name="time", field="time", causality="independent", unit="s", description="time")
    yield from _parameters()
    yield from _inputs()
    yield from _states()
    yield from _derivatives()
    yield from _axle_outputs()
    for side in SIDES:
        yield from _wheel_outputs(side)


#: All variables in the order of their value references.
VARIABLES: tuple[Variable, ...] = tuple(_table())

#: Value reference of each variable by name.
REFERENCES: Mapping[str, int] = MappingProxyType({v.name: i for i, v in enumerate(VARIABLES)})
