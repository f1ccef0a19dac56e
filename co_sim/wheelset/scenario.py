"""What a scenario may say: the tables of a scenario file, with bounds and descriptions.

`co_sim.wheelset.scenario_file` reads the files and tells their faults.
"""

from __future__ import annotations

import difflib
import itertools
from dataclasses import MISSING, fields
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, create_model, model_validator
from pydantic_core import PydanticCustomError

from fmu_wheelset.parameters import CONDITIONS, ContactPatch, RailCondition, WheelsetParameters

__all__ = ["MODES", "Filter", "FreeRolling", "PrescribedCreep", "Rail", "Scenario", "Sensor", "TorqueDriven"]

#: What may turn the wheels.
MODES = ("prescribed_creep", "free_rolling", "torque_driven")

Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]


class _Table(BaseModel):
    """A table of the file: no unknown keys, no silent conversions, no infinities."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Simulation(_Table):
    """Steps and length of each run."""

    step: Positive = Field(1e-3, description="communication step, s")
    duration: Positive = Field(10.0, description="length of each run, s; a multiple of the step")

    @model_validator(mode="after")
    def _step_divides(self) -> Self:
        steps = self.duration / self.step
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-9 * steps:
            whole = max(round(steps), 1)
            raise _fault(
                f"{self.step:g} s in {self.duration:g} s",
                "a step that divides the duration",
                f"use a duration of {whole * self.step:g} s or a step of {self.duration / whole:.9g} s",
            )
        return self

    @property
    def steps(self) -> int:
        """Number of steps of a run."""
        return round(self.duration / self.step)


class PrescribedCreep(_Table):
    """Drive with a common longitudinal creepage imposed on both wheels."""

    mode: Literal["prescribed_creep"] = Field(description="the paper's operation at points of the curve")
    speed: Positive = Field(20.0, description="forward speed, m/s")
    points: tuple[Literal["P1", "P2", "P3"], ...] = Field(
        ("P1", "P2", "P3"), min_length=1, description="one run each at these points of the first rail's curve"
    )
    linear: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        0.1, description="creep of P1 as a multiple of the creep of the maximum, 1"
    )
    unstable: Annotated[float, Field(gt=1.0)] = Field(
        2.0, description="creep of P3 as a multiple of the creep of the maximum, 1"
    )


class FreeRolling(_Table):
    """Drive without creepage but what the wheelset's own motion makes."""

    mode: Literal["free_rolling"] = Field(description="the paper's simplified model (6), (7)")
    speed: Positive = Field(20.0, description="forward speed, m/s")


class TorqueDriven(_Table):
    """Drive by a torque on the axle; the wheel speeds are states."""

    mode: Literal["torque_driven"] = Field(description="wheel speeds and axle twist follow from the torque")
    speed: Positive = Field(20.0, description="forward speed, held, m/s")
    times: tuple[NonNegative, ...] = Field((0.0,), min_length=1, description="corners of the torque, s")
    torque: tuple[float, ...] = Field(
        (0.0,), min_length=1, description="torque at the corners, linear between and constant after, N m"
    )

    @model_validator(mode="after")
    def _corners_match(self) -> Self:
        rising = all(a < b for a, b in itertools.pairwise(self.times))
        if len(self.times) != len(self.torque) or not rising:
            raise _fault(
                f"{len(self.times)} times and {len(self.torque)} torques",
                "one torque for each time, times in rising order",
                "pair them up",
            )
        return self


class Rail(_Table):
    """A stretch of rail."""

    since: NonNegative = Field(0.0, description="time at which the wheelset reaches it, s")
    condition: str | None = Field(None, description="condition under both wheels, by name")
    left: str | None = Field(None, description="condition under the left wheel, instead of `condition`")
    right: str | None = Field(None, description="condition under the right wheel, instead of `condition`")

    @model_validator(mode="after")
    def _both_sides(self) -> Self:
        if not (self.left or self.condition) or not (self.right or self.condition):
            raise _fault(
                "no condition for a wheel", "`condition`, or both `left` and `right`", "name the condition"
            )
        return self

    @property
    def sides(self) -> tuple[str, str]:
        """Names of the conditions under the left and the right wheel."""
        return self.left or self.condition or "", self.right or self.condition or ""


class Track(_Table):
    """Lateral alignment of the track."""

    spectrum: Literal["erri_low", "erri_high"] = Field(
        "erri_low", description="ERRI B176 spectrum; of a measured track, what the filters assume"
    )
    file: str | None = Field(
        None, description="measured track as CSV (distance m, lateral offset m), beside the scenario file"
    )
    ramp: NonNegative = Field(5.0, description="distance over which the offset is faded in, m")


class Sensor(_Table):
    """Faults of one sensor."""

    noise_rms: Positive = Field(description="white noise of each sample, in the sensor's unit")
    bias: float = Field(0.0, description="constant error, in the sensor's unit")
    bandwidth_hz: Positive | None = Field(None, description="corner of a first-order low-pass, Hz")
    rate_hz: Positive | None = Field(None, description="sampling rate, Hz; divides the step rate")


class SensorSet(_Table):
    """The two sensors of the paper."""

    gyro: Sensor = Field(Sensor(noise_rms=1e-3), description="yaw rate, rad/s")
    accelerometer: Sensor = Field(Sensor(noise_rms=0.05), description="lateral acceleration, m/s2")


class Filter(_Table):
    """The hypothesis of one Kalman filter: a point on the creep curve of a condition."""

    condition: str = Field(description="rail condition, by name")
    point: Literal["P1", "P2", "P3"] | None = Field(None, description="point of the curve; or `adhesion`")
    adhesion: Positive | None = Field(
        None, description="used adhesion F/N below the maximum, 1; instead of `point`"
    )

    @model_validator(mode="after")
    def _one_point(self) -> Self:
        if (self.point is None) == (self.adhesion is None):
            raise _fault(
                "both or neither of `point` and `adhesion`", "exactly one of them", "keep the one you mean"
            )
        return self

    @property
    def name(self) -> str:
        """Name of the filter in results."""
        return f"{self.condition}-{self.point}" if self.point else f"{self.condition}@{self.adhesion:g}"


class IdentifierTable(_Table):
    """The filter bank and what follows it."""

    window: Positive = Field(1.0, description="moving window of the residuals (15), s")
    residual: Literal["lateral_acceleration", "yaw_rate", "both"] = Field(
        "lateral_acceleration", description="whose innovations (15) weighs; `both`: each over its noise"
    )
    training: Positive = Field(10.0, description="length of the run that tunes each filter, s")
    valid_offset: Positive = Field(
        8e-3, description="lateral offset from the track up to which models without flanges hold, m"
    )
    filters: tuple[Filter, ...] | None = Field(
        None, min_length=2, description="the bank; left out: P1, P2, P3 of the first rail"
    )

    @model_validator(mode="after")
    def _distinct(self) -> Self:
        names = [f.name for f in self.filters or ()]
        doubled = sorted({name for name in names if names.count(name) > 1})
        if doubled:
            raise _fault(f"{', '.join(doubled)} more than once", "distinct filters", "remove the others")
        return self


class Fmu(_Table):
    """Which archive of the plant runs."""

    version: Literal[2, 3] = Field(3, description="FMI version")


class Output(_Table):
    """What is written."""

    every: Annotated[int, Field(ge=1)] = Field(1, description="write every n-th step to results.csv")


def _quantity_model(name: str, quantities: type[Any], **extra: Any) -> type[_Table]:
    """Return a table with the quantities of a parameter class and their bounds."""
    members: dict[str, Any] = dict(extra)
    for declared in fields(quantities):
        if "unit" not in declared.metadata:
            continue
        facts = declared.metadata
        bounds = {"ge" if facts["minimum_allowed"] else "gt": facts["minimum"]}
        if facts["maximum"] < float("inf"):
            bounds["le"] = facts["maximum"]
        members[declared.name] = (
            float,
            Field(
                ... if declared.default is MISSING else declared.default,
                description=f"{facts['description']}, {facts['unit']}",
                **bounds,
            ),
        )
    return create_model(name, __base__=_Table, __doc__=f"See {quantities.__name__}.", **members)


_Patch = _quantity_model("Patch", ContactPatch)
_Wheelset = _quantity_model(
    "Wheelset", WheelsetParameters, patch=(_Patch, Field(_Patch(), description="contact patch"))
)
_Condition = _quantity_model("Condition", RailCondition)


class Scenario(_Table):
    """A whole scenario file."""

    title: str = Field("", description="one line for reports")
    seed: Annotated[int, Field(ge=0)] = Field(1, description="from which all random numbers follow")
    simulation: Simulation = Field(Simulation(), description="steps")
    drive: PrescribedCreep | FreeRolling | TorqueDriven = Field(
        PrescribedCreep(mode="prescribed_creep"), discriminator="mode", description="what turns the wheels"
    )
    rail: tuple[Rail, ...] = Field((Rail(condition="dry"),), min_length=1, description="stretches of rail")
    conditions: dict[str, _Condition] = Field(  # type: ignore[valid-type]
        {}, description="rail conditions of your own, by name"
    )
    track: Track = Field(Track(), description="lateral alignment")
    sensors: SensorSet = Field(SensorSet(), description="gyro and accelerometer")
    identifier: IdentifierTable = Field(IdentifierTable(), description="filter bank and fuzzy system")
    wheelset: _Wheelset = Field(_Wheelset(), description="parameters of the wheelset")  # type: ignore[valid-type]
    fmu: Fmu = Field(Fmu(), description="the plant")
    output: Output = Field(Output(), description="results")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        self._check_conditions()
        since = [stretch.since for stretch in self.rail]
        if since[0] != 0.0 or any(a >= b for a, b in itertools.pairwise(since)):
            raise _fault(f"rails since {since} s", "a first rail since 0 and rising times", "sort them")
        if since[-1] >= self.simulation.duration:
            raise _fault(
                f"a rail since {since[-1]:g} s",
                f"one within the duration of {self.simulation.duration:g} s",
                "lengthen the run or drop the rail",
            )
        for what, length in (("window", self.identifier.window), ("training", self.identifier.training)):
            if length < self.simulation.step:
                raise _fault(
                    f"identifier.{what} = {length:g} s",
                    f"at least the step of {self.simulation.step:g} s",
                    "lengthen it",
                )
        if self.identifier.window > self.simulation.duration:
            raise _fault(
                f"identifier.window = {self.identifier.window:g} s",
                f"at most the duration of {self.simulation.duration:g} s",
                "shorten the window or lengthen the run",
            )
        return self

    def _check_conditions(self) -> None:
        named = [name for stretch in self.rail for name in stretch.sides]
        named += [f.condition for f in self.identifier.filters or ()]
        known = {**CONDITIONS, **self.conditions}
        for name in named:
            if name not in known:
                closest = difflib.get_close_matches(name, known, n=1, cutoff=0.0)[0]
                raise _fault(
                    f"the rail condition {name!r}",
                    f"one of {', '.join(known)}",
                    f"define [conditions.{name}] or use {closest}",
                )

    def condition(self, name: str) -> RailCondition:
        """Return the rail condition of that name, the user's own first."""
        if name in self.conditions:
            return RailCondition(**self.conditions[name].model_dump())  # type: ignore[attr-defined]
        return CONDITIONS[name]

    @property
    def parameters(self) -> WheelsetParameters:
        """Parameters of the wheelset."""
        values = self.wheelset.model_dump()  # type: ignore[attr-defined]
        return WheelsetParameters(**{**values, "patch": ContactPatch(**values["patch"])})

    @property
    def has_flanges(self) -> bool:
        """Whether the plant has flange contact; the filters never have."""
        return self.parameters.flange_stiffness > 0.0

    @property
    def filters(self) -> tuple[Filter, ...]:
        """The bank, in order."""
        if self.identifier.filters is not None:
            return self.identifier.filters
        first = self.rail[0].sides[0]
        return (
            Filter(condition=first, point="P1"),
            Filter(condition=first, point="P2"),
            Filter(condition=first, point="P3"),
        )


def _fault(got: str, expected: str, remedy: str) -> PydanticCustomError:
    return PydanticCustomError(
        "scenario",
        "got {got}, expected {expected}; {remedy}",
        {"got": got, "expected": expected, "remedy": remedy},
    )
