"""The ports of an FMU bound to its C functions: from the interpreter, and as a table for compiled steps."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim import fmi_table as at
from co_sim.fmi import FmuError
from co_sim.fmi_values import UnfitError, grouped, misfit
from co_sim.native import Call, NativeState, NativeStep

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from co_sim.component import Port, Vector
    from co_sim.fmi import Slave
    from co_sim.fmi_values import Group

__all__ = ["Binding", "interpolated", "is_native"]

#: What the words of an error call the actions of a step.
_ACTIONS = {
    at.SETTING: "setting the inputs",
    at.DERIVING: "setting the derivatives of the inputs",
    at.STEPPING: "doStep",
    at.GETTING: "getting the outputs",
}


def is_native(ports: Sequence[Port]) -> bool:
    """Tell whether a compiled step can pass the values of these ports: it knows no texts."""
    return all(port.kind != "string" for port in ports)


def interpolated(ports: Sequence[Port]) -> list[int]:
    """Return the positions of the inputs whose derivatives an FMU for FMI 2 takes."""
    smooth = [port.kind == "float64" and port.continuous for port in ports]
    return [i for i, is_smooth in enumerate(smooth) if is_smooth]


class Binding:
    """The calls of one instance, between `start` and `close`.

    Parameters
    ----------
    slave : instantiated.
    inputs, outputs : the ports, in the order of `u` and `y`.
    references : value references by the name of the port.
    slopes : whether compiled steps get derivatives of the inputs.
    """

    def __init__(
        self,
        slave: Slave,
        inputs: Sequence[Port],
        outputs: Sequence[Port],
        references: Mapping[str, int],
        *,
        slopes: bool,
    ) -> None:
        self._slave = slave
        self._inputs = [(name, port.kind) for port in inputs for name in port.elements]
        self._outputs = [(name, port.kind) for port in outputs for name in port.elements]
        self._set = [(g, self._call("Set", g)) for g in grouped(slave.version, inputs, references)]
        self._get = [(g, self._call("Get", g)) for g in grouped(slave.version, outputs, references)]
        self._slopes = self._derivatives(inputs, references) if slopes else None
        groups = [group for group, _ in (*self._set, *self._get)]
        #: Whether the calls can work on `u` and `y` themselves: one row for each, also without values.
        self._is_plain = not slopes and all(group.code == at.FLOAT64 for group in groups)
        self._table = self._tabulate()
        self.native = self._native() if is_native([*inputs, *outputs]) else None

    def exchange(self, u: Vector, y: Vector) -> None:
        """Set the inputs and get the outputs."""
        self.set_inputs(u)
        self._get_outputs(y)

    def step(self, t: float, h: float, u: Vector, y: Vector) -> None:
        """Advance with the inputs held, in the interpreter."""
        self.set_inputs(u)
        self._slave.do_step(t, h)
        self._get_outputs(y)

    def failure(self, action: int) -> Exception:
        """Return the error of a compiled step that returned `action`."""
        status, position = int(self._table[at.STATUS]), int(self._table[at.ELEMENT])
        value = self._table[at.VALUE : at.VALUE + 1]
        if action == at.UNFIT_INPUT:
            return FmuError(misfit("input", *self._inputs[position], value.view(np.float64)[0].item()))
        if action == at.UNFIT_OUTPUT:
            name, kind = self._outputs[position]
            return FmuError(misfit("output", name, kind, value.view(kind)[0].item()))
        if action == at.ENDED:
            return self._slave.ended(self._table[at.LAST : at.LAST + 1].view(np.float64)[0].item())
        state = self._slave.state
        words = _ACTIONS | {
            at.KEEPING: f"Get{state}",
            at.GOING_BACK: f"Set{state}",
            at.FREEING: f"Free{state}",
        }
        return self._slave.refusal(words[action], status)

    def native_state(self) -> NativeState | None:
        """Return the calls that keep the state and go back to it."""
        from co_sim.fmi_state import go_back, keep

        self.may_return()
        self._slave.own(self._table[at.KEPT : at.KEPT + 1])
        for place, name in ((at.GET_STATE, "Get"), (at.SET_STATE, "Set"), (at.FREE_STATE, "Free")):
            self._table[place] = self._slave.address(name + self._slave.state)
        kept: Any = keep
        back: Any = go_back
        return NativeState(kept.address, back.address, self._table.ctypes.data)

    def may_return(self) -> None:
        """Tell the FMU in each later step that an earlier state may be restored."""
        self._slave.never_back = False
        self._table[at.NEVER_BACK] = 0

    @property
    def memory(self) -> bytes:
        """What belongs to the state besides that of the instance: the order of its input derivatives."""
        return bytes([self._table[at.LAST_ORDER]])

    @memory.setter
    def memory(self, data: bytes) -> None:
        (self._table[at.LAST_ORDER],) = data

    def set_inputs(self, u: Vector) -> None:
        """Set the inputs."""
        for group, call in self._set:
            try:
                group.fill(u)
            except UnfitError as error:
                raise FmuError(misfit("input", *self._inputs[error.position], error.value)) from None
            self._slave.check(_ACTIONS[at.SETTING], call())

    def _get_outputs(self, y: Vector) -> None:
        for group, call in self._get:
            self._slave.check(_ACTIONS[at.GETTING], call())
            try:
                group.empty(y)
            except UnfitError as error:
                raise FmuError(misfit("output", *self._outputs[error.position], error.value)) from None

    def _call(self, direction: str, group: Group) -> Callable[[], int]:
        """Return the call that sets or gets a group."""
        numbers = (group.references.ctypes.data, len(group.references), group.address, len(group.positions))
        return partial(self._slave.transfer, self._slave.function(direction + group.function), *numbers)

    def _derivatives(self, inputs: Sequence[Port], references: Mapping[str, int]) -> tuple[NDArray[Any], ...]:
        """Return references, orders, values and positions of the first and second derivatives."""
        positions = np.array(interpolated(inputs), dtype=np.int64)
        each = [references[inputs[i].name] for i in positions]
        orders = np.repeat(np.array([1, 2], dtype=np.int32), len(each))
        return np.array(each * 2, dtype=np.uint32), orders, np.zeros(2 * len(each)), positions

    def _tabulate(self) -> NDArray[np.int64]:
        """Return the table of the compiled step."""
        rows = [self._row("Set", group) for group, _ in self._set]
        if self._is_plain and not rows:
            rows.append([0] * at.ROW)
        rows += [self._row("Get", group) for group, _ in self._get]
        if self._is_plain and not self._get:
            rows.append([0] * at.ROW)
        table = np.zeros(at.HEADER + at.ROW * len(rows), dtype=np.int64)
        table[at.HEADER :] = np.ravel(rows)
        table[at.INSTANCE] = self._slave.instance
        table[at.DO_STEP] = self._slave.address("DoStep")
        table[at.NEVER_BACK] = self._slave.never_back
        table[at.VERSION] = self._slave.version
        table[at.N_SET], table[at.N_GET] = len(self._set), len(self._get)
        table[at.N_INPUTS], table[at.N_OUTPUTS] = len(self._inputs), len(self._outputs)
        if self._slopes:
            table[at.SET_DERIVATIVES] = self._slave.address("SetRealInputDerivatives")
            table[at.N_SLOPES] = len(self._slopes[-1])
            table[at.SLOPE_REFERENCES : at.SLOPE_POSITIONS + 1] = [a.ctypes.data for a in self._slopes]
        return table

    def _row(self, direction: str, group: Group) -> list[int]:
        row = [0] * at.ROW
        if group.code is not None:
            row[at.FUNCTION] = self._slave.address(direction + group.function)
            row[at.REFERENCES], row[at.N_REFERENCES] = group.references.ctypes.data, len(group.references)
            row[at.CODE], row[at.VALUES] = group.code, group.address
            row[at.POSITIONS], row[at.N_VALUES] = group.positions.ctypes.data, len(group.positions)
            row[at.LOW], row[at.HIGH] = group.limits
        return row

    def _native(self) -> NativeStep:
        # Compiled code is loaded when it is needed: that takes a while.
        step: Any
        call = Call.FUNCTION
        if self._is_plain:
            from co_sim.fmi_step import step2, step3

            step, call = (step2, Call.FMI2) if self._slave.version == 2 else (step3, Call.FMI3)
        else:
            from co_sim.fmi_step_mixed import step_mixed

            step = step_mixed
        return NativeStep(step.address, self._table.ctypes.data, call)
