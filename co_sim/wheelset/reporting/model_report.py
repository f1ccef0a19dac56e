"""Reports on one linear model: any `control.StateSpace`, any system of the master, any FMU or SSP."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from co_sim.errors import InputError
from co_sim.linearize import Linearization, linearize
from co_sim.master import Master
from co_sim.tool.loading import load, parse_settings, with_settings
from co_sim.wheelset.prose.words import capital, listed, quantity
from co_sim.wheelset.reporting.model_sections import model_sections
from co_sim.wheelset.reporting.report import Report, with_images
from estimator.structure import LinearSystem

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import control

    from co_sim.system import System

__all__ = ["report_fmu", "report_model", "report_system"]


def report_model(
    model: control.StateSpace | LinearSystem | Linearization,
    *,
    input_sets: Mapping[str, Sequence[str]] | None = None,
    output_sets: Mapping[str, Sequence[str]] | None = None,
    title: str = "What does the model do, what is reached and seen of it?",
    about: Sequence[tuple[str, str]] = (),
) -> Report:
    """Return the report on a linear model; `co_sim.wheelset.reporting.page.write_report` writes it.

    Parameters
    ----------
    model : continuous or sampled; names and units are kept where the model has them.
    input_sets, output_sets : name of a set to names of its signals; ``None`` takes each alone and all.
    title : of the page. about : what was assumed, as (subject, sentences).

    Raises
    ------
    ValueError
        If a set names a signal that the model has not.
    """
    system = _of(model) if isinstance(model, Linearization) else model
    system = system if isinstance(system, LinearSystem) else LinearSystem.of(system)
    system, idle = _without_idle(system)
    sections, images = with_images(model_sections(system, input_sets, output_sets))
    kind = f"sampled every {quantity(system.dt, 's')}" if system.sampled else "continuous"
    size = (
        f"{len(system.states)} states, {len(system.inputs)} inputs and {len(system.outputs)} outputs, {kind}."
    )
    return Report(
        title=title,
        about=(*about, ("Model", size), *([("Left out", _left_out(idle))] if idle else ())),
        setup={
            "states": list(system.states),
            "state_units": list(system.state_units),
            "inputs": list(system.inputs),
            "input_units": list(system.input_units),
            "outputs": list(system.outputs),
            "output_units": list(system.output_units),
            "sampling_time_s": system.dt,
            "A": system.A.tolist(),
            "B": system.B.tolist(),
            "C": system.C.tolist(),
            "D": system.D.tolist(),
        },
        grid={},
        sections=sections,
        images=images,
    )


def _left_out(idle: Sequence[str]) -> str:
    return (
        f"{capital(listed(idle))}: nothing moves {'them' if len(idle) > 1 else 'it'}, and nothing feels it."
    )


def _of(found: Linearization) -> LinearSystem:
    """Return a linearised system with units; names of a system of one component do without the component."""
    m = found.model
    owners = {name.partition(".")[0] for name in (*found.states, *found.inputs, *found.outputs)}

    def short(names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(name.partition(".")[2] for name in names) if len(owners) == 1 else names

    return LinearSystem(
        *(m.A, m.B, m.C, m.D),
        *(short(found.states), short(found.inputs), short(found.outputs)),
        *(found.state_units, found.input_units, found.output_units),
        float(m.dt or 0.0),
    )


def _without_idle(system: LinearSystem) -> tuple[LinearSystem, tuple[str, ...]]:
    """Return the system without states that nothing moves and that move nothing, and their names."""
    A = system.A
    moves = A - np.eye(system.order) if system.sampled else A
    moved = moves.any(axis=1) | system.B.any(axis=1)
    felt = moves.any(axis=0) | system.C.any(axis=0)
    kept = np.flatnonzero(moved | felt)
    idle = tuple(name for i, name in enumerate(system.states) if i not in kept)
    part = replace(
        system,
        A=A[np.ix_(kept, kept)],
        B=system.B[kept],
        C=system.C[:, kept],
        states=tuple(system.states[i] for i in kept),
        state_units=tuple(system.state_units[i] for i in kept),
    )
    return (part, idle) if idle else (system, idle)


def report_system(
    system: System,
    *,
    start: float = 0.0,
    at: float | None = None,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] = ("*",),
    title: str = "What does the system do, what is reached and seen of it?",
) -> Report:
    """Linearise a system of the master and return the report on it.

    Parameters
    ----------
    start : time at which the system starts, s. at : time until which it runs first, s; ``None`` for none.
    inputs, outputs : patterns as in `co_sim.linearize`.

    Raises
    ------
    InputError
        If the system has faults, `at` is before `start`, or there is no linear model.
    """
    if at is not None and at < start:
        raise InputError(
            "time of the linear model",
            got=f"{at:g} s",
            expected=f"at least the start at {start:g} s",
            remedy="choose a later time",
        )
    with Master(system, start) as master:
        if at is not None and at > start:
            master.run(at - start)
        found = linearize(master, inputs, outputs)
    methods = listed([f"{name} ({method})" for name, method in found.methods.items()])
    about = [("Point", f"At {quantity(found.time, 's')}, linearised by component: {methods}.")]
    return report_model(found, title=title, about=about)


def report_fmu(
    path: Path | str,
    *,
    at: float | None = None,
    settings: Sequence[str] = (),
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
) -> Report:
    """Linearise an FMU or an SSP and return the report on it.

    Parameters
    ----------
    path : an FMU (FMI 2.0 or 3.0) or an SSP.
    at : time until which it runs first, s; ``None`` for its start.
    settings : ``NAME=VALUE`` of parameters and of free inputs, as in ``wheelset simulate --set``.
    inputs, outputs : patterns as in `co_sim.linearize`; ``None`` takes what nothing feeds, and all.

    Raises
    ------
    InputError
        If the file has faults, `at` is before its start, or there is no linear model.
    """
    loaded = load(Path(path))
    system = with_settings(loaded.system, parse_settings(settings))
    system.check()
    if outputs is None:
        # Not those of the constants that hold inputs.
        outputs = [f"{name}.*" for name, component in loaded.system.components.items() if component.outputs]
    title = f"What does {Path(path).name} do, what is reached and seen of it?"
    return report_system(
        system, start=loaded.start or 0.0, at=at, inputs=inputs, outputs=outputs, title=title
    )
