"""Three roads to the linear model at a point: by hand, and twice through the FMU.

- *analytic*: (12) and (13) in python-control, `estimator.wheelset_model` and `estimator.filter_model`;
- *derivatives*: the directional derivatives that the FMU computes in C;
- *differences*: central differences of the FMU's right-hand side.

The creep law of the first is written in numpy and differentiated by hand, that of the others in C.
"""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from co_sim.local_model import central_differences
from co_sim.model_exchange import ExchangeFmu
from co_sim.wheelset.assembly import plant_parameters
from estimator import filter_model, wheelset_model
from estimator.linear_models import TRACK_DECAY
from fmu_wheelset import CONDITIONS, RailCondition, path

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType

    import control

    from co_sim.wheelset.reporting.grid import GridPoint
    from fmu_wheelset import WheelsetParameters

__all__ = ["BOUND", "PAIRS", "Difference", "LinearisedPlant", "differences"]

Matrix = NDArray[np.float64]

#: Largest difference of an entry, relative to its row, that rounding and the step of the differences explain.
BOUND = 1e-9
#: The roads that are compared.
PAIRS = (("analytic", "derivatives"), ("analytic", "differences"), ("derivatives", "differences"))

#: Longitudinal creepage that a step of the differences makes, as a part of the creepage of the point. The
#: error of the extrapolated formula is of its fourth power, that of rounding of its inverse.
_STEP = 1e-3
#: Step of `central_differences` at zero.
_UNIT_STEP = np.finfo(np.float64).eps ** (1.0 / 3.0)

_STATES = ("lateral_displacement", "yaw_angle", "lateral_velocity", "yaw_rate")
_OUTPUTS = ("yaw_rate", "lateral_acceleration")
_INPUTS = ("track_lateral_offset", "suspension_lateral_force", "suspension_yaw_moment")
_N = len(_STATES)


class LinearisedPlant(AbstractContextManager["LinearisedPlant"]):
    """The wheelset FMU with prescribed creepage, at rest at points of a grid, linearised.

    Its models are matrices ``[[A, B], [C, D]]`` over the four states of the guiding motion and the inputs
    track offset, lateral force and yaw moment; outputs are the two measurements. The states of the
    drive do not act on the guiding motion here, which `derivatives` checks.

    Parameters
    ----------
    wheelset : parameters of the FMU.
    """

    def __init__(self, wheelset: WheelsetParameters) -> None:
        self._wheelset = wheelset
        self._fmu = ExchangeFmu(
            path(fmi=3),
            outputs=_OUTPUTS,
            parameters={**plant_parameters(wheelset), "drive_mode": "prescribed_creep"},
        )
        self._names = [port.name for port in self._fmu.inputs]
        self._u = np.array([port.start or 0.0 for port in self._fmu.inputs], dtype=np.float64)
        self._steps = np.ones(_N + len(_INPUTS))

    def __enter__(self) -> Self:
        self._fmu.start(0.0, 1e-3)
        self._fmu.exchange(self._u, np.empty(len(_OUTPUTS)))
        self._fmu.enter_steps()
        self._point = self._fmu.point()
        self._origin = self._point.states()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._fmu.close()

    def move(self, to: GridPoint) -> None:
        """Set speed, creepage, loads and rail condition."""
        rail = CONDITIONS[to.condition]
        self._set("speed", to.speed)
        self._set("prescribed_creepage", to.point.creep)
        for side in ("left", "right"):
            self._set(f"normal_load_{side}", self._wheelset.N)
            for declared in fields(RailCondition):
                self._set(f"rail_{side}.{declared.name}", getattr(rail, declared.name))
        self._point.set_states(self._origin)
        self._point.set_inputs(self._u)
        creepage = _STEP * to.point.creep * _per_creepage(to, self._wheelset)
        # The force and the moment act linearly: any step will do.
        self._steps = np.append(creepage, [1.0, 1.0])

    def derivatives(self) -> Matrix:
        """Return the model of the present point from the FMU's directional derivatives.

        Raises
        ------
        RuntimeError
            If a state of the drive acts on the guiding motion.
        """
        drive = [state.name for state in self._fmu.states[_N:]]
        unknowns = [*(state.derivative for state in self._fmu.states[:_N]), *_OUTPUTS]
        knowns = [*_STATES, *_INPUTS, *drive]
        columns = [self._fmu.directional_derivative(unknowns, knowns, seed) for seed in np.eye(len(knowns))]
        J = np.array(columns, dtype=np.float64).T
        if J[:, _N + len(_INPUTS) :].any():
            raise RuntimeError("a state of the drive acts on the guiding motion at prescribed creepage")
        return J[:, : _N + len(_INPUTS)]

    def differences(self) -> Matrix:
        """Return the model of the present point from central differences, extrapolated from two steps."""
        amplitude = self._steps / _UNIT_STEP
        places = [self._names.index(name) for name in _INPUTS]

        def evaluate(z: Matrix) -> Matrix:
            x, u = self._origin.copy(), self._u.copy()
            x[:_N] += amplitude[:_N] * z[:_N]
            u[places] += amplitude[_N:] * z[_N:]
            self._point.set_states(x)
            self._point.set_inputs(u)
            return np.concatenate([self._point.derivatives()[:_N], self._point.outputs()])

        J, _ = central_differences(evaluate, np.zeros(_N + len(_INPUTS)))
        self._point.set_states(self._origin)
        self._point.set_inputs(self._u)
        return np.asarray(J / amplitude)

    def _set(self, name: str, value: float) -> None:
        self._u[self._names.index(name)] = value


@dataclass(frozen=True, slots=True)
class Difference:
    """The entry in which two roads differ most.

    Parameters
    ----------
    value : difference over the largest entry of its row, each state measured by the creepage it causes.
    entry : such as ``"(12): der(y_dot) over psi"``.
    """

    value: float
    entry: str

    @property
    def is_small(self) -> bool:
        """Whether it is within `BOUND`; a number that is none is not."""
        return self.value <= BOUND


def differences(
    plant: LinearisedPlant, at: GridPoint, wheelset: WheelsetParameters
) -> tuple[Difference, ...]:
    """Return the largest difference of each of `PAIRS` at a point with a creepage above zero."""
    plant.move(at)
    size = _per_creepage(at, wheelset)
    roads = {
        "analytic": (
            _of_model("(12)", wheelset_model(at.point, wheelset)),
            _of_model("(13)", filter_model(at.point, wheelset)),
        ),
        "derivatives": _of_plant(plant.derivatives(), wheelset),
        "differences": _of_plant(plant.differences(), wheelset),
    }
    return tuple(_largest(roads[first], roads[second], size) for first, second in PAIRS)


def _per_creepage(at: GridPoint, wheelset: WheelsetParameters) -> Matrix:
    """Return (5,) the y, psi, y_dot, psi_dot and y_t that each cause a creepage of one; see (1) to (3)."""
    p, v = wheelset, at.speed
    displacement = p.r0 / p.gamma if p.gamma > 0.0 else 1.0
    return np.array([displacement, 1.0, v, v / p.L_g, displacement])


@dataclass(frozen=True, slots=True)
class _Equation:
    """An equation of the paper as one matrix ``[[A, B], [C, D]]`` with the names of its rows and columns."""

    name: str
    matrix: Matrix
    rows: tuple[str, ...]
    columns: tuple[str, ...]


def _of_model(name: str, model: control.StateSpace) -> _Equation:
    matrix = np.block([[model.A, model.B], [model.C, model.D]])
    return _Equation(name, matrix, _rows(model.state_labels), (*model.state_labels, *model.input_labels))


def _rows(states: Sequence[str]) -> tuple[str, ...]:
    return *(f"der({state})" for state in states), *_OUTPUTS


def _of_plant(J: Matrix, wheelset: WheelsetParameters) -> tuple[_Equation, _Equation]:
    """Return a model of the plant in the form of (12) and of (13)."""
    y, psi, y_dot, psi_dot, y_t, force, moment = range(_N + len(_INPUTS))
    states = ("y", "psi", "y_dot", "psi_dot")
    plant = _Equation("(12)", J[:, : y_t + 1], _rows(states), (*states, "y_t"))
    # In (13), y = y_t + y_rel: a row has for y_t what it has for y and for the input y_t.
    over = np.column_stack([J[:, [psi, y_dot, psi_dot]], J[:, y] + J[:, y_t], J[:, y], np.zeros(len(J))])
    accelerations = J[:, [force, moment]] * [wheelset.m_w, wheelset.I_w]
    # The measurement (14) leaves out what these accelerations are to the accelerometer at once.
    accelerations[_N:] = 0.0
    M = np.hstack([over, accelerations])
    states13, inputs13 = ("psi", "y_dot", "psi_dot", "y_t", "y_rel"), ("w", "a_y", "a_psi")
    offset = np.array([0.0, 0.0, 0.0, -TRACK_DECAY, 0.0, 1.0, 0.0, 0.0])
    matrix = np.vstack([M[[psi, y_dot, psi_dot]], offset, M[y] - offset, M[_N:]])
    return plant, _Equation("(13)", matrix, _rows(states13), (*states13, *inputs13))


def _largest(
    first: tuple[_Equation, _Equation], second: tuple[_Equation, _Equation], size: Matrix
) -> Difference:
    y, psi, y_dot, psi_dot, y_t = size
    sizes = (size, np.array([psi, y_dot, psi_dot, y_t, y, 1.0, 1.0, 1.0]))
    found = [_compared(one, other, s) for one, other, s in zip(first, second, sizes, strict=True)]
    return max(found, key=lambda difference: (math.isnan(difference.value), difference.value))


def _compared(one: _Equation, other: _Equation, size: Matrix) -> Difference:
    reference = np.abs(one.matrix * size).max(axis=1, keepdims=True)
    relative = np.abs((one.matrix - other.matrix) * size) / reference
    i, j = np.unravel_index(np.argmax(relative), relative.shape)
    return Difference(float(relative[i, j]), f"{one.name}: {one.rows[i]} over {one.columns[j]}")
