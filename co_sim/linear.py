"""Linear models of python-control as components, stepped exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.compiled_component import CompiledComponent
from co_sim.component import Port
from co_sim.errors import Fault, InputError
from co_sim.local_model import LocalModel

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from numpy.typing import ArrayLike

    from co_sim.component import Vector

__all__ = ["LinearComponent", "LinearModel"]

#: The step may differ from the sampling time of a discrete model by the rounding of either, relative.
SAME_STEP = 1e-9


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A linear state space; ``x' = A x + B u``, or ``x(t + dt) = A x + B u``, and ``y = C x + D u``.

    Parameters
    ----------
    A, B, C, D : shapes ``(n, n)``, ``(n, n_u)``, ``(n_y, n)`` and ``(n_y, n_u)``; read-only.
    states, inputs, outputs : the names.
    dt : sampling time, s; 0 for a continuous model, ``True`` for any.
    """

    A: Vector
    B: Vector
    C: Vector
    D: Vector
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    dt: float | bool


class LinearComponent(CompiledComponent):
    """A `control.StateSpace` or `control.TransferFunction` as a component.

    A continuous model is stepped by its exact solution for inputs that are polynomials up to the second
    degree over the step: held inputs where nothing is extrapolated. A discrete model takes its inputs at
    the start of the step and must be sampled with the step of the master. In both, ``y = C x + D u``
    at the end of the step with the inputs extrapolated to there.

    Parameters
    ----------
    model : a transfer function with several inputs or outputs needs the package slycot.
    inputs, outputs : ports or names, in the order of the model; an array port stands for as many as it
        has elements. ``None`` takes the model's labels. Ports carry units and start values.
    x0 : state at the start of a run; zero if left out.

    Raises
    ------
    InputError
        If the model is of another type or improper, or the number of ports or states is wrong; at
        the start of a run, if a discrete model has another sampling time than the step.
    """

    def __init__(
        self,
        model: Any,
        inputs: Sequence[Port | str] | None = None,
        outputs: Sequence[Port | str] | None = None,
        x0: ArrayLike | None = None,
    ) -> None:
        from co_sim.steps import linear_exchange, linear_step

        space = _state_space(model)
        state = np.zeros(space.nstates) if x0 is None else np.array(x0, dtype=np.float64)
        in_ports = _ports(space.input_labels if inputs is None else inputs)
        out_ports = _ports(space.output_labels if outputs is None else outputs)
        faults = [
            *_size_faults("inputs", len(_elements(in_ports)), space.ninputs),
            *_size_faults("outputs", len(_elements(out_ports)), space.noutputs),
            *_size_faults("x0", state.size, space.nstates),
        ]
        if faults:
            raise InputError.from_faults(faults)
        self._model = _linear_model(space, in_ports, out_ports)
        self._h = 0.0
        super().__init__(
            linear_step,
            exchange=linear_exchange,
            inputs=in_ports,
            outputs=out_ports,
            state=state,
            prepare=self._matrices,
            feedthrough=_feedthrough(self._model.D, in_ports, out_ports),
            takes_derivatives=True,
        )

    @property
    def linear_model(self) -> LinearModel:
        """The matrices, with the names of states and ports."""
        return self._model

    def linearize(self, t: float, u: Vector) -> LocalModel:
        """Return the model itself, which holds at every point."""
        model = self._model
        dt = self._h if model.dt is True else float(model.dt)
        return LocalModel(model.A, model.B, model.C, model.D, model.states, ("1",) * len(model.states), dt=dt)

    def start(self, t0: float, h: float) -> None:
        """Set the state and the matrices of this run."""
        self._h = h
        super().start(t0, h)

    def _matrices(self, h: float, _: Mapping[str, float]) -> Vector:
        model = self._model
        discrete = model.dt is True or model.dt > 0.0
        if discrete and model.dt is not True and not math.isclose(h, model.dt, rel_tol=SAME_STEP):
            raise InputError(
                "discrete linear model",
                got=f"a step of {h:g} s",
                expected=f"its sampling time, {model.dt:g} s",
                remedy="run it at that rate, or sample the model anew with control.sample_system",
            )
        phi, gamma = _sampled(model) if discrete else _integrated(model, h)
        E = np.hstack([model.D, h * model.D, 0.5 * h * h * model.D])
        if not (np.isfinite(phi).all() and np.isfinite(gamma).all()):
            raise InputError(
                "linear model",
                got=f"a state that overflows within one step of {h:g} s",
                expected="finite values",
                remedy="take a smaller step, or look at the poles of the model",
            )
        return np.concatenate([M.ravel() for M in (phi, gamma, model.C, E, np.zeros(len(phi)))])


def _integrated(model: LinearModel, h: float) -> tuple[Vector, Vector]:
    """Return the exact solution over `h`, ``Phi x + Gamma (u, u', u'')``, from one matrix exponential.

    The input and its derivatives are the states of a chain of integrators that drives the model.
    """
    from scipy.linalg import expm

    n, m = model.B.shape
    chain = np.zeros((n + 3 * m, n + 3 * m))
    chain[:n, : n + m] = np.hstack([model.A, model.B])
    chain[n : n + 2 * m, n + m :] = np.eye(2 * m)
    with np.errstate(all="ignore"):
        solution = expm(chain * h) if np.isfinite(chain * h).all() else np.full_like(chain, np.nan)
    return solution[:n, :n], solution[:n, n:]


def _sampled(model: LinearModel) -> tuple[Vector, Vector]:
    return model.A, np.hstack([model.B, np.zeros_like(model.B), np.zeros_like(model.B)])


def _state_space(model: Any) -> Any:
    import control

    if isinstance(model, control.StateSpace):
        return model
    if not isinstance(model, control.TransferFunction):
        raise InputError(
            "linear model",
            got=type(model).__name__,
            expected="a control.StateSpace or a control.TransferFunction",
            remedy="make one with control.ss or control.tf",
        )
    try:
        return control.ss(model)
    except (ValueError, NotImplementedError) as error:
        raise InputError(
            "transfer function",
            got=str(error),
            expected="a proper one, with one input and one output where slycot is not installed",
            remedy="give a control.StateSpace, or install slycot",
        ) from error


def _linear_model(space: Any, inputs: Sequence[Port], outputs: Sequence[Port]) -> LinearModel:
    A, B, C, D = (np.array(M, dtype=np.float64) for M in (space.A, space.B, space.C, space.D))
    for M in (A, B, C, D):
        M.setflags(write=False)
        if not np.isfinite(M).all():
            raise InputError(
                "linear model",
                got="nan or inf in its matrices",
                expected="finite numbers",
                remedy="look at how it was made",
            )
    dt = True if space.dt is True else float(space.dt or 0.0)
    return LinearModel(A, B, C, D, tuple(space.state_labels), _elements(inputs), _elements(outputs), dt)


def _ports(given: Sequence[Port | str]) -> list[Port]:
    return [port if isinstance(port, Port) else Port(port) for port in given]


def _elements(ports: Sequence[Port]) -> tuple[str, ...]:
    return tuple(element for port in ports for element in port.elements)


def _feedthrough(D: Vector, inputs: Sequence[Port], outputs: Sequence[Port]) -> dict[str, set[str]]:
    sources = [port.name for port in inputs for _ in port.elements]
    targets = [port.name for port in outputs for _ in port.elements]
    direct: dict[str, set[str]] = {name: set() for name in targets}
    for i, j in zip(*np.nonzero(D), strict=True):
        direct[targets[i]].add(sources[j])
    return direct


def _size_faults(what: str, size: int, expected: int) -> Iterator[Fault]:
    if size != expected:
        yield Fault(
            f"{what} of a linear model", f"{size}", f"{expected}, as the model has", "give one for each"
        )
