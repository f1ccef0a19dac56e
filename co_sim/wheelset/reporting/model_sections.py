"""The sections of a report on one linear model: motion, what is reached, what is seen, energies."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from co_sim.wheelset.prose.words import capital, listed, number, quantity
from co_sim.wheelset.reporting.section import Column, Figure, Quantity, Section, Table
from estimator.structure import analyse, gramians

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from co_sim.wheelset.drawing.sheet import Sheet
    from co_sim.wheelset.reporting.section import Cell
    from estimator.structure import Access, Gramians, LinearSystem, Mode, Structure

__all__ = ["model_sections"]

_MOTION = "How does the model move by itself?"
#: Names told one by one in a sentence.
_TOLD = 6
#: Horizon of Gramians that have no infinite one, in time constants of the slowest mode that has one.
_HORIZON = 10.0


def model_sections(
    system: LinearSystem,
    input_sets: Mapping[str, Sequence[str]] | None = None,
    output_sets: Mapping[str, Sequence[str]] | None = None,
) -> tuple[Section, ...]:
    """Return the sections on a model; sets of signals as in `estimator.structure.analyse`."""
    if system.order == 0:
        words = "The model has no states: it passes its inputs on at once."
        return (Section("motion", _MOTION, (words,), summary=(words,)),)
    found = analyse(system, input_sets=input_sets, output_sets=output_sets)
    sections = [_motion(found)]
    if found.reached:
        sections.append(_access(found, found.reached, "reached"))
    if found.seen:
        sections.append(_access(found, found.seen, "seen"))
    if found.reached and found.seen:
        sections.append(_energy(found))
    return tuple(sections)


def _motion(found: Structure) -> Section:
    modes = found.modes
    poles = np.array([mode.exponent for mode in modes])
    participation = np.array([mode.participation for mode in modes])
    defined = "the eigenvectors of these modes meet, and no participation is defined"
    numbers = {
        "eigenvalue": Quantity(poles, "1/s", "exponent of each mode, slowest first", ("mode",)),
        "frequency": Quantity([m.frequency for m in modes], "Hz", "of the damped oscillation", ("mode",)),
        "damping_ratio": Quantity([m.damping_ratio for m in modes], "1", "-Re/|s|", ("mode",)),
        "time_constant": Quantity(
            [m.time_constant for m in modes], "s", "to decay or grow by e", ("mode",), "the mode is undamped"
        ),
        "participation": Quantity(
            participation, "1", "part of each state in each mode", ("mode", "state"), defined
        ),
        "state_unit": Quantity(list(found.system.state_units), "1", "unit of each state", ("state",)),
        "state_scale": Quantity(
            found.scales.states, "of the state", "size of each state that counts as one", ("state",)
        ),
    }
    words = _behaviour(modes)
    return Section(
        key="motion",
        title=_MOTION,
        words=(words,),
        numbers=numbers,
        axes={"mode": list(range(1, len(modes) + 1)), "state": found.system.states},
        tables=(_mode_table(modes),),
        figures=(
            Figure(
                key="poles",
                title=_MOTION,
                caption="Eigenvalues of the model; left of the line a mode decays, right of it it grows.",
                alt=words,
                draw=partial(_poles, modes, _MOTION),
            ),
        ),
        summary=(words,),
    )


def _behaviour(modes: Sequence[Mode]) -> str:
    counts = {kind: sum(m.behaviour == kind for m in modes) for kind in ("decays", "undamped", "grows")}
    if counts["decays"] == len(modes):
        slowest = max(m.time_constant for m in modes)
        return (
            f"The model is stable: all {len(modes)} modes decay, the slowest in "
            f"{quantity(slowest, 's')} by the factor e."
        )
    parts = []
    if counts["grows"]:
        fastest = min((m for m in modes if m.behaviour == "grows"), key=lambda m: m.time_constant)
        at = f" at {quantity(fastest.frequency, 'Hz')}" if fastest.frequency > 0.0 else ""
        some = "1 grows" if counts["grows"] == 1 else f"{counts['grows']} grow, the fastest"
        parts.append(f"{some} by the factor e in {quantity(fastest.time_constant, 's')}{at}")
    if counts["undamped"]:
        one = counts["undamped"] == 1
        parts.append(f"{counts['undamped']} neither decay{'s' if one else ''} nor grow{'s' if one else ''}")
    return f"The model is not asymptotically stable: of its {len(modes)} modes {listed(parts)}."


def _mode_table(modes: Sequence[Mode]) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            str(i),
            m.exponent.real,
            m.exponent.imag,
            m.frequency,
            m.damping_ratio,
            m.time_constant if np.isfinite(m.time_constant) else None,
            m.behaviour,
            m.dominant,
        )
        for i, m in enumerate(modes, 1)
    ]
    columns = (
        Column("mode"),
        Column("growth rate", "1/s"),
        Column("angular frequency", "rad/s"),
        Column("frequency", "Hz"),
        Column("damping ratio"),
        Column("time constant", "s"),
        Column("behaviour"),
        Column("moves most"),
    )
    return Table("Modes, slowest first", columns, tuple(rows))


_QUESTIONS = {
    "reached": ("What do the inputs reach?", "inputs", "reach", "stabilisable"),
    "seen": ("What do the outputs see?", "outputs", "see", "detectable"),
}


def _access(found: Structure, sets: Mapping[str, Access], kind: Literal["reached", "seen"]) -> Section:
    title, signals, verb, property_ = _QUESTIONS[kind]
    names, every = tuple(sets), tuple(sets.values())
    order = found.system.order
    margins = np.array([[m.margin for m in access.margins] for access in every]).reshape(len(names), order)
    lost = np.array([[m.lost for m in access.margins] for access in every], dtype=bool).reshape(margins.shape)
    over = ("set",)
    noun = property_.replace("able", "ability")
    numbers = {
        "rank": Quantity([a.rank.rank for a in every], "1", f"dimension that the set {_one(verb)}", over),
        "singular_value": Quantity(
            np.array([a.rank.singular_values for a in every]).reshape(len(names), order),
            "1",
            "what each direction added, of the scaled model; counted up to the rank",
            ("set", "direction"),
        ),
        "margin": Quantity(margins, "1", "smallest relative change that loses the mode", ("set", "mode")),
        "lost": Quantity(lost, "1", "whether the mode is lost", ("set", "mode")),
        "distance": Quantity(
            [a.distance.value for a in every], "1", "relative change that loses a mode", over
        ),
        "distance_at_least": Quantity([a.distance.lower for a in every], "1", "bound of the distance", over),
        "critical_distance": Quantity(
            [a.critical_distance.value for a in every], "1", f"to the loss of {noun}", over
        ),
        property_: Quantity([bool(a.verdict) for a in every], "1", f"whether the model is {property_}", over),
        "reason": Quantity([a.verdict.reason for a in every], "1", "in words", over),
    }
    words = [_best(found, sets, verb), _blind(sets, verb)]
    caption = (
        f"Smallest relative change of the scaled model after which a set of {signals} does not {verb} a mode "
        f"at its own eigenvalue."
    )
    draw = partial(_margins, names, found.modes, margins, lost, title)
    alt = f"Margins of {len(names)} sets for each mode."
    figures = (Figure(f"margins_{kind}", title, caption, alt, draw),)
    return Section(
        key=kind,
        title=title,
        words=tuple(filter(None, words)),
        numbers=numbers,
        axes={
            "set": names,
            "mode": list(range(1, order + 1)),
            "direction": list(range(1, order + 1)),
        },
        tables=(_access_table(sets, order, signals, property_),),
        figures=figures,
        summary=(words[0],),
    )


def _best(found: Structure, sets: Mapping[str, Access], verb: str) -> str:
    name = max(sets, key=lambda key: (sets[key].rank.rank, len(sets[key].signals)))
    access = sets[name]
    together = "Both" if len(access.signals) == 2 else f"All {len(access.signals)}"
    who = f"{together} together" if name == "all" else capital(name)
    does = verb if name == "all" else _one(verb)
    if access.rank.full:
        return (
            f"{who} {does} the whole model; a relative change of {number(access.distance.value, 2)} "
            f"of the scaled model would hide a mode."
        )
    hidden = [
        _described(margin.mode)
        for margin in access.margins
        if margin.lost and margin.mode.exponent.imag >= 0.0
    ]
    told = [*hidden[:_TOLD], f"{len(hidden) - _TOLD} more"] if len(hidden) > _TOLD else hidden
    lost = f"; lost: {listed(told)}" if told else ""
    return f"{who} {does} {access.rank.rank} of {found.system.order} dimensions{lost}."


def _one(verb: str) -> str:
    """Return the verb as one does it."""
    return f"{verb}{'es' if verb.endswith('ch') else 's'}"


def _described(mode: Mode) -> str:
    if mode.exponent == 0.0:
        return f"the integrator {mode.dominant}"
    if mode.exponent.imag == 0.0:
        return f"the mode of {mode.dominant} at {quantity(mode.exponent.real, '1/s')}"
    return f"the oscillation of {mode.dominant} at {quantity(mode.frequency, 'Hz')}"


def _blind(sets: Mapping[str, Access], verb: str) -> str:
    none = [name for name, access in sets.items() if access.rank.rank == 0]
    if not none:
        return ""
    told = [*none[:_TOLD], f"{len(none) - _TOLD} more"] if len(none) > _TOLD else none
    return f"{capital(listed(told))} {_one(verb) if len(none) == 1 else verb} nothing of it."


def _access_table(sets: Mapping[str, Access], order: int, signals: str, property_: str) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            name,
            f"{a.rank.rank} of {order}",
            a.distance.value,
            a.critical_distance.value,
            bool(a.verdict),
        )
        for name, a in sets.items()
    ]
    columns = (
        Column(signals),
        Column("rank"),
        Column("distance to a loss"),
        Column(f"to not {property_}"),
        Column(property_),
    )
    note = (
        "Distances are smallest changes of the scaled model, relative to its norm, that lose a mode: "
        "any, and one that does not decay."
    )
    return Table("", columns, tuple(rows), note)


def _energy(found: Structure) -> Section:
    from estimator.structure.gramians import RESOLUTION

    title = "How many directions carry the way from inputs to outputs?"
    energies, horizon = _gramians(found)
    hankel = energies.hankel
    counted = int(np.sum(hankel > RESOLUTION * hankel[0])) if hankel.size and hankel[0] > 0.0 else 0
    main = int(np.searchsorted(np.cumsum(hankel) / hankel.sum(), 0.99) + 1) if counted else 0
    words = (
        f"{counted} of {hankel.size} directions are both reached and seen beyond rounding; {main} of them "
        f"carry 99 % of the sum of the Hankel singular values ({horizon})."
    )
    over = ("direction",)
    numbers = {
        "hankel_singular_value": Quantity(hankel, "1", "in natural scales of inputs and outputs", over),
        "reached_energy": Quantity(
            energies.scaled_controllability, "1", "eigenvalues of the Gramian of controllability", over
        ),
        "seen_energy": Quantity(
            energies.scaled_observability, "1", "eigenvalues of the Gramian of observability", over
        ),
        "gramian_kind": Quantity(energies.kind, "1", "infinite or finite horizon, or split"),
        "horizon": Quantity(energies.horizon, "s", "of the Gramians", missing="the horizon is infinite"),
    }
    draw = partial(_hankel, hankel, RESOLUTION, title)
    figures = (Figure("hankel", title, words, words, draw),)
    return Section(
        key="energy",
        title=title,
        words=(words,),
        numbers=numbers,
        axes={"direction": list(range(1, hankel.size + 1))},
        figures=figures,
    )


def _gramians(found: Structure) -> tuple[Gramians, str]:
    """Return Gramians in natural scales of inputs and outputs, and their horizon in words."""
    s, scales = found.system, found.scales
    u, y = scales.inputs, scales.outputs[:, None]
    system = replace(s, B=s.B * u, C=s.C / y, D=s.D / y * u)
    if all(m.behaviour == "decays" for m in found.modes):
        return gramians(system, scales=scales), "over all time"
    constants = [m.time_constant for m in found.modes if np.isfinite(m.time_constant)]
    growing = [m.time_constant for m in found.modes if m.behaviour == "grows"]
    # Long for what decays, but not so long that what grows is all there is.
    horizon = min(growing) if growing else _HORIZON * max(constants, default=1.0 / _HORIZON)
    return gramians(system, scales=scales, horizon=horizon), f"over {quantity(horizon, 's')}"


def _poles(modes: Sequence[Mode], title: str) -> Sheet:
    from co_sim.wheelset.drawing.model import draw_poles

    return draw_poles(modes, title)


def _margins(*arguments: object) -> Sheet:
    from co_sim.wheelset.drawing.model import draw_margins

    return draw_margins(*arguments)  # type: ignore[arg-type]


def _hankel(*arguments: object) -> Sheet:
    from co_sim.wheelset.drawing.model import draw_hankel

    return draw_hankel(*arguments)  # type: ignore[arg-type]
