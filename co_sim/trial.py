"""The process in which an FMU is tried: ``python -m co_sim.trial FMU KIND FILE``.

It writes its phases to a file, and at last what came out, line by line, so that whoever waits for it
knows what it was doing when it died. `co_sim.checking.trial` starts it.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.errors import InputError
from co_sim.fmu import FmuComponent
from co_sim.model_exchange import ExchangeFmu
from co_sim.texts import as_number

if TYPE_CHECKING:
    from collections.abc import Callable

    from co_sim.component import Vector

__all__: list[str] = []

_STEPS = 100
#: Step where the FMU suggests none, s.
_STEP = 0.01
#: Outputs named where several are not finite.
_MOST_NAMES = 5

_Outcome = list[tuple[str, str]]


def _run(path: Path, kind: str, tell: Callable[[str], None]) -> _Outcome:
    """Run the FMU; return severities and messages."""
    try:
        component = (FmuComponent if kind == "CoSimulation" else ExchangeFmu)(path)
    except InputError as error:
        return [("error", f"cannot be run: {fault.got}, expected {fault.expected}") for fault in error.faults]
    t0, h, n = _experiment(component._description.defaultExperiment, component)
    phase = "instantiation"

    def enter(name: str) -> None:
        nonlocal phase
        phase = name
        tell(name)

    try:
        return _steps(component, t0, h, n, enter)
    except Exception as error:
        return [("error", f"refused in the {phase}: {' '.join(str(error).split())}")]


def _steps(component: FmuComponent, t0: float, h: float, n: int, enter: Callable[[str], None]) -> _Outcome:
    """Step through the life of a component."""
    u = _inputs(component)
    names = [name for port in component.outputs for name in port.elements]
    y = np.zeros(len(names))
    try:
        enter("instantiation")
        component.start(t0, h)
        enter("initialisation")
        component.exchange(u[: len(u) // 3 if component.takes_derivatives else len(u)], y)
        component.enter_steps()
        for k in range(n):
            if not np.isfinite(y).all():
                break
            enter(f"step at t = {t0 + k * h:g} s")
            component.step(t0 + k * h, h, u, y)
        else:
            k = n
    except Exception:
        component.close()
        raise
    enter("termination")
    component.close()
    wrong = [f'output "{names[i]}" is {y[i]:g}' for i in np.flatnonzero(~np.isfinite(y))]
    if wrong:
        more = f" and {len(wrong) - _MOST_NAMES} more" if len(wrong) > _MOST_NAMES else ""
        return [("error", f"at t = {t0 + k * h:g} s {', '.join(wrong[:_MOST_NAMES])}{more}")]
    return [("note", f"{n} steps of {h:g} s from t = {t0:g} s, inputs at their start values: outputs finite")]


def _inputs(component: FmuComponent) -> Vector:
    """Return the start values of the inputs, zeros where there are none, and zeros for their derivatives."""
    values = [
        as_number(start)
        for port in component.inputs
        for start in (port.starts or (("",) if port.kind == "string" else (0.0,)) * port.size)
    ]
    derivatives = 2 * len(values) if component.takes_derivatives else 0
    return np.array([*values, *[0.0] * derivatives])


def _experiment(default: Any, component: FmuComponent) -> tuple[float, float, int]:
    """Return the start, step and number of steps of a run that the FMU suggests."""
    t0, stop, h = (
        float(getattr(default, name, None) or math.nan) for name in ("startTime", "stopTime", "stepSize")
    )
    fixed = getattr(component._interface, "fixedInternalStepSize", None)
    t0 = t0 if math.isfinite(t0) else 0.0
    candidates = (float(fixed or math.nan), h, (stop - t0) / _STEPS, _STEP)
    h = next(value for value in candidates if 0.0 < value < math.inf)
    n = round((stop - t0) / h) if math.isfinite(stop) else _STEPS
    return t0, h, max(1, min(n, _STEPS))


def _main(path: str, kind: str, told: str) -> None:
    with Path(told).open("w", encoding="utf-8") as file:

        def tell(line: str) -> None:
            file.write(f"{line}\n")
            file.flush()

        tell("reading")
        tell(json.dumps({"findings": _run(Path(path), kind, tell)}))


if __name__ == "__main__":
    _main(*sys.argv[1:])
