"""One case of a study: what the wheelset does, what its sensors are like, what the filters do not know."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from co_sim.wheelset.recordings import Journey, Profile, Stretch
from co_sim.wheelset.sensors import SensorSpec
from estimator import ERRI_B176, CreepCurve, RegionHypothesis
from fmu_wheelset import CONDITIONS, RailCondition, WheelsetParameters

__all__ = ["NOISE", "POINTS", "Trial"]

Condition = Literal["dry", "wet", "low", "very_low"]
Factor = Annotated[float, Field(gt=0.5, lt=2.0)]
Positive = Annotated[float, Field(gt=0.0)]

#: Noise of each sample at a noise factor of 1: of the gyro, rad/s, and the accelerometer, m/s2.
NOISE = (1e-3, 0.05)
#: Creepages that can be imposed, and their regions: the four of the aim, then what is near the borders.
POINTS = {
    "P1": RegionHypothesis("P1", "linear", 1.0, 0.1),
    "knee": RegionHypothesis("knee", "peak", 0.0),
    "P2": RegionHypothesis("P2", "peak", 1.0),
    "beyond": RegionHypothesis("beyond", "unstable", 1.0, 1.7),
    "before_knee": RegionHypothesis("before_knee", "linear", 0.0, 0.75),
    "before_peak": RegionHypothesis("before_peak", "peak", 1.0, 0.98),
    "after_peak": RegionHypothesis("after_peak", "unstable", 1.0, 1.2),
}
#: Stiffness of a flange, where a case has flanges, N/m.
_FLANGE = 1e7


class Trial(BaseModel):
    """A case by the names that a study may use; the defaults are a matched case without any fault."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    manoeuvre: Literal["steady", "drop", "prescribed"] = Field(
        "steady",
        description="steady: constant torque; drop: the rail changes from `before` to `condition` under it; "
        "prescribed: the creep of `point` is imposed",
    )
    condition: Condition = Field("dry", description="rail condition")
    before: Condition = Field("dry", description="rail condition before a drop")
    point: Literal["P1", "knee", "P2", "beyond", "before_knee", "before_peak", "after_peak"] = Field(
        "P1",
        description="creep where it is imposed: .1 times that of the peak, the knee, the peak, 1.7 times "
        "that of the peak; .75 times that of the knee, .98 and 1.2 times that of the peak",
    )
    speed: Annotated[float, Field(ge=1.0, le=150.0)] = Field(20.0, description="forward speed, m/s")
    utilisation: Annotated[float, Field(gt=0.0, le=1.5)] = Field(
        0.6, description="torque as part of what the condition can carry, after a drop, 1"
    )
    direction: Literal["traction", "braking"] = Field("traction", description="sign of the torque")
    duration: Positive = Field(10.0, description="length, s")
    change: Positive = Field(5.0, description="time of the drop, s")
    flanges: bool = Field(False, description="whether the plant has flange contact")
    track: Literal["erri_low", "erri_high"] = Field("erri_low", description="spectrum of the track")
    assumed_track: Literal["erri_low", "erri_high", "same"] = Field(
        "same", description="spectrum that the filters assume"
    )
    noise: Positive = Field(1.0, description="noise of both sensors, times 1 mrad/s and .05 m/s2")
    assumed_noise: Positive | None = Field(None, description="noise that the filters assume; left out: true")
    unknown: Literal["usual", "vehicle", "nothing"] = Field(
        "usual",
        description="what the filters hold possible besides friction: offsets of sensors and sizes of the "
        "contact patch, as `AdhesionBank` does by default; vehicle: its other parameters are known to 10 % "
        "as well; or nothing",
    )
    gyro_bias: float = Field(0.0, description="bias of the gyro, rad/s")
    accelerometer_bias: float = Field(0.0, description="bias of the accelerometer, m/s2")
    mass: Factor = Field(1.0, description="true mass over that of the filters, 1")
    yaw_inertia: Factor = Field(1.0, description="true yaw inertia over that of the filters, 1")
    yaw_stiffness: Factor = Field(1.0, description="true yaw stiffness over that of the filters, 1")
    conicity: Factor = Field(1.0, description="true conicity over that of the filters, 1")
    patch: Factor = Field(1.0, description="true semi-axes of the contact over those of the filters, 1")
    friction: Factor = Field(1.0, description="true friction over that of the filters, on all rails, 1")
    load: Factor = Field(1.0, description="true normal load over that of the filters, 1")
    speed_error: Factor = Field(1.0, description="measured speed over the true one, 1")
    torque_error: Factor = Field(1.0, description="torque told to the filters over the true one, 1")

    @model_validator(mode="after")
    def _change_inside(self) -> Self:
        if self.manoeuvre == "drop" and self.change >= self.duration:
            raise PydanticCustomError(
                "scenario",
                "got {got}, expected {expected}; {remedy}",
                {
                    "got": f"a drop at {self.change:g} s",
                    "expected": f"one within the duration of {self.duration:g} s",
                    "remedy": "lengthen the case",
                },
            )
        return self

    @property
    def wheelset(self) -> WheelsetParameters:
        """Parameters of the plant, which the filters do not know."""
        known = WheelsetParameters()
        return replace(
            known,
            m_w=self.mass * known.m_w,
            I_w=self.yaw_inertia * known.I_w,
            k_w=self.yaw_stiffness * known.k_w,
            gamma=self.conicity * known.gamma,
            N=self.load * known.N,
            patch=replace(known.patch, a=self.patch * known.patch.a, b=self.patch * known.patch.b),
            flange_stiffness=_FLANGE if self.flanges else 0.0,
        )

    @property
    def conditions(self) -> dict[str, RailCondition]:
        """Rail conditions of the plant by name."""
        return {name: replace(rail, mu_0=self.friction * rail.mu_0) for name, rail in CONDITIONS.items()}

    @property
    def curve(self) -> CreepCurve:
        """Creep curve of the plant at the speed of the case, after a drop."""
        return self.curve_of(self.condition)

    def curve_of(self, condition: str) -> CreepCurve:
        """Return the creep curve of the plant on a rail, at the speed of the case."""
        wheelset = self.wheelset
        return CreepCurve(self.conditions[condition], self.speed, wheelset.N, wheelset.patch)

    @property
    def creep(self) -> float:
        """Longitudinal creepage that is imposed."""
        return POINTS[self.point].creep(self.curve)

    @property
    def torque(self) -> float:
        """Torque on the axle after it has risen, N m."""
        wheelset, sign = self.wheelset, 1.0 if self.direction == "traction" else -1.0
        return sign * 2.0 * wheelset.r0 * self.utilisation * self.curve.peak_adhesion * wheelset.N

    def journey(self, seed: int) -> Journey:
        """Return the journey of the plant, with random numbers from `seed`."""
        prescribed = self.manoeuvre == "prescribed"
        conditions = self.conditions
        rails = [Stretch(0.0, conditions[self.condition])]
        if self.manoeuvre == "drop":
            rails = [
                Stretch(0.0, conditions[self.before]),
                Stretch(self.change, conditions[self.condition]),
            ]
        return Journey(
            duration=self.duration,
            speed=self.speed,
            torque=None if prescribed else Profile((0.0, 0.5), (0.0, self.torque)),
            creep=self.creep if prescribed else None,
            rails=tuple(rails),
            track=ERRI_B176[self.track],
            wheelset=self.wheelset,
            gyro=SensorSpec(noise_rms=self.noise * NOISE[0], bias=self.gyro_bias),
            accelerometer=SensorSpec(noise_rms=self.noise * NOISE[1], bias=self.accelerometer_bias),
            seed=seed,
        )
