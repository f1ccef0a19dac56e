"""A Model Exchange FMU bound to its integrator: the table for the compiled step, and its failures."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from co_sim.fmi import FmuError
from co_sim.fmi_binding import Binding, is_native
from co_sim.native import _STEP_C, NativeStep, _c_function

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import ArrayLike, NDArray

    from co_sim.component import Port, Vector
    from co_sim.exchange_model import ExchangeModel

__all__ = ["METHODS", "ExchangeBinding", "Integration", "is_smooth"]

#: Nodes and weights of explicit Runge-Kutta methods whose stages each use the slope of the one before only.
METHODS = {
    "euler": ((0.0,), (1.0,)),
    "midpoint": ((0.0, 0.5), (0.0, 1.0)),
    "rk4": ((0.0, 0.5, 0.5, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6)),
}
#: What the integration knows of the present point: numbers and arrays of the table.
_SCALARS = ("time", "next_event", "running")
_ARRAYS = ("x", "z", "discrete_values")
#: What a function for the ports returns if the interpreter has raised an exception there.
_RAISED = 100


class Integration(NamedTuple):
    """How an FMU is integrated from `t0` (s): by which of `METHODS`, in substeps of which length.

    A `substep` (s) of 0 stands for the whole step.
    """

    method: str
    substep: float
    t0: float


def is_smooth(port: Port) -> bool:
    """Return whether an input may change in continuous-time mode; only float64 is taken to."""
    return port.kind == "float64" and port.continuous


class ExchangeBinding(Binding):
    """The calls of one instance, between `start` and `close`.

    Attributes
    ----------
    table : the instance as compiled code sees it; an array of the type `co_sim.exchange_calls.MODEL`.
    arrays : those that the table points to, by the names of its fields.
    """

    def __init__(
        self,
        model: ExchangeModel,
        inputs: Sequence[Port],
        outputs: Sequence[Port],
        references: Mapping[str, int],
        integration: Integration,
    ) -> None:
        from co_sim.exchange_calls import MODEL, Action

        self.table: NDArray[np.void] = np.zeros((), MODEL)
        self.arrays: dict[str, NDArray[Any]] = {}
        super().__init__(model, inputs, outputs, references, slopes=False)
        self._model = model
        self._raised: Exception | None = None
        self._callbacks: list[object] = []
        self._first_inputs = np.zeros(3 * len(self._inputs))
        self.table["version"] = model.version
        self.table["instance"] = model.instance
        self.table["time"] = integration.t0
        self.table["completes_steps"] = model.completes_steps
        self.table["never_back"] = True
        for action in Action:
            name = action.name.lower()
            self.table[name] = model.address(model.functions[name])
        self._place_method(integration)
        self._place_inputs(inputs, references)
        self._place("output_references", _references(outputs, references), "n_output_references")
        self.table["n_outputs"] = len(self._outputs)
        self._place_functions(inputs, outputs)

    def exchange(self, u: Vector, y: Vector) -> None:
        """Set the inputs and get the outputs in initialisation mode."""
        self._first_inputs[: u.size] = u
        super().exchange(u, y)

    def enter_steps(self) -> None:
        """End initialisation mode with the inputs of the last exchange."""
        self.step(float(self.table["time"]), 0.0, self._first_inputs, np.zeros(len(self._outputs)))
        self._model.is_stepping = True

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Advance; the ports may need the interpreter."""
        address, data, _ = self._native()
        status = _c_function(address)(t, h, u.ctypes.data, y.ctypes.data, data)
        if status:
            raise self.failure(status)

    def failure(self, status: int) -> Exception:
        """Return the error for what a step returned."""
        from co_sim.exchange_calls import OWN_FAILURES, Action, Failure
        from co_sim.exchange_step import MAX_EVENTS, MAX_ITERATIONS

        if status < 0:
            raised, self._raised = self._raised, None
            return raised or super().failure(-status)
        t = f"t = {float(self.table['time']):.12g} s"
        if status >= OWN_FAILURES:
            action, fmi_status = divmod(status, OWN_FAILURES)
            name = self._model.name_of(Action(action).name.lower())
            return self._model.refusal(f"{name}, on the way from {t},", fmi_status)
        if status == Failure.TERMINATED:
            return self._model.ended(float(self.table["time"]))
        if status == Failure.UNSETTLED:
            return FmuError(f"the event at {t} did not settle in {MAX_ITERATIONS} iterations")
        return FmuError(
            f"more than {MAX_EVENTS} events in one step, the last at {t}: they follow each other ever faster,"
            " or an indicator returns to zero after each"
        )

    def native_state(self) -> None:
        """Return nothing: what the integration knows is kept by the interpreter."""

    def may_return(self) -> None:
        """Tell the FMU in each later step that an earlier state may be restored."""
        self.table["never_back"] = False

    def set_smooth(self, u: Vector) -> None:
        """Set the inputs that may change in continuous-time mode, out of all inputs."""
        values, references = self.arrays["smooth_values"], self.arrays["smooth_references"]
        values[:] = u[self.arrays["smooth"]]
        if values.size:
            function = self._model.function(self._model.functions["set_floats"])
            numbers = (references.ctypes.data, references.size, values.ctypes.data, values.size)
            self._model.check("setting the inputs", self._model.transfer(function, *numbers))

    def outputs(self) -> Vector:
        """Return the outputs."""
        y = np.zeros(len(self._outputs))
        self._get_outputs(y)
        return y

    @property
    def memory(self) -> bytes:
        """What the integration knows of the present point: it belongs to the state."""
        scalars = [float(self.table[name]) for name in _SCALARS]
        return np.concatenate([scalars, *(self.arrays[name] for name in _ARRAYS)]).tobytes()

    @memory.setter
    def memory(self, data: bytes) -> None:
        values = np.frombuffer(data)
        for name, value in zip(_SCALARS, values, strict=False):
            self.table[name] = value
        end = len(_SCALARS)
        for name in _ARRAYS:
            array = self.arrays[name]
            array[:] = values[end : end + array.size]
            end += array.size
        self.table["failure"] = self.table["terminates"] = 0

    def _native(self) -> NativeStep:
        # Compiled code is loaded when it is needed: that takes a while.
        from co_sim.exchange_step import exchange_step

        return NativeStep(cast("int", exchange_step.address), self.table.ctypes.data)

    def _place(self, name: str, values: ArrayLike, size: str | None = None) -> None:
        """Keep an array and enter its address, and its size where a field of the table is named for it."""
        array = np.ascontiguousarray(values)
        self.arrays[name] = array
        self.table[name] = array.ctypes.data
        if size is not None:
            self.table[size] = array.size

    def _place_method(self, integration: Integration) -> None:
        nodes, weights = METHODS[integration.method]
        self._place("nodes", nodes, "n_stages")
        self._place("weights", weights)
        n_states, n_indicators = self._model.sizes
        for name in ("x", "x_new", "x_stage", "derivatives"):
            self._place(name, np.zeros(n_states), "n_states")
        for name in ("z", "z_new", "z_low", "z_high"):
            self._place(name, np.zeros(n_indicators), "n_indicators")
        self._place("flags", np.zeros(4))
        self.table["substep"] = integration.substep
        self.table["next_event"] = np.inf

    def _place_inputs(self, inputs: Sequence[Port], references: Mapping[str, int]) -> None:
        smooth = np.repeat([is_smooth(port) for port in inputs], [port.size for port in inputs]).astype(bool)
        for name, chosen in (("smooth", smooth), ("discrete", ~smooth)):
            self._place(name, np.flatnonzero(chosen).astype(np.int64), f"n_{name}")
            self._place(f"{name}_values", np.zeros(chosen.sum()))
        chosen_ports = [port for port in inputs if is_smooth(port)]
        self._place("smooth_references", _references(chosen_ports, references), "n_smooth_references")
        self._place("input_references", _references(inputs, references), "n_input_references")
        self.table["n_inputs"] = len(self._inputs)

    def _place_functions(self, inputs: Sequence[Port], outputs: Sequence[Port]) -> None:
        """Enter the functions for ports of other types than float64; the interpreter passes texts."""
        self.table["ports"] = self._table.ctypes.data
        for name, ports, function in (
            ("set_ports", inputs, self._set_from),
            ("get_ports", outputs, self._get_into),
        ):
            if not is_native(ports):
                callback = _STEP_C(function)
                self._callbacks.append(callback)
                self.table[name] = ctypes.cast(callback, ctypes.c_void_p).value
            elif any(port.kind != "float64" for port in ports):
                from co_sim import exchange_ports

                self.table[name] = getattr(exchange_ports, name).address

    def _set_from(self, t: float, h: float, u: int, y: int, data: int) -> int:
        return self._guarded(self.set_inputs, u, len(self._inputs))

    def _get_into(self, t: float, h: float, u: int, y: int, data: int) -> int:
        return self._guarded(self._get_outputs, y, len(self._outputs))

    def _guarded(self, function: Any, address: int, n: int) -> int:
        """Call a function with the array at an address; an exception must not pass through C."""
        try:
            function(np.ctypeslib.as_array((ctypes.c_double * n).from_address(address)))
        except Exception as error:
            self._raised = error
            return _RAISED
        return 0


def _references(ports: Sequence[Port], references: Mapping[str, int]) -> NDArray[np.uint32]:
    return np.array([references[port.name] for port in ports], dtype=np.uint32)
