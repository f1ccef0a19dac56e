"""How well inputs meet each mode and outputs see it: the test of Popov, Belevitch and Hautus in degrees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.structure.distance import local_minimum, smallest
from estimator.structure.modes import Mode, modes
from estimator.structure.scaling import natural_scales, scaled, size
from estimator.structure.subspaces import TOLERANCE
from estimator.structure.system import LinearSystem, as_system

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import control

    from estimator.structure.scaling import Scales

__all__ = ["ModeMargin", "controllability_margins", "observability_margins"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class ModeMargin:
    """How far one mode is from being lost to some inputs or outputs.

    Parameters
    ----------
    mode : the mode. signals : inputs or outputs asked for.
    margin : smallest singular value of ``[A - s I, B]`` (of ``[A - s I; C]``) at the mode, relative to the
        norm of the scaled model: so large must a change of the model be to hide the mode at this very s.
    tolerance : what counts as zero, relative to the same.
    lost : whether the mode is out of reach, or out of sight: the margin vanishes at the mode, or as near to
        it as rounding may have moved it.
    measures : (len(signals),) cosine of the angle between the mode's left eigenvector and each column of B
        (right eigenvector and row of C) in scaled units (Hamdan & Nayfeh 1989); for modes that share an
        eigenvalue only `margin` has a meaning.
    """

    mode: Mode
    signals: tuple[str, ...]
    margin: float
    tolerance: float
    lost: bool
    measures: Array


def controllability_margins(
    model: control.StateSpace | LinearSystem,
    inputs: Sequence[str] | None = None,
    *,
    scales: Scales | None = None,
    tolerance: float = TOLERANCE,
) -> tuple[ModeMargin, ...]:
    """Return the margin of each mode, in the order of `modes`, for some inputs (all if ``None``).

    Parameters
    ----------
    model : continuous or sampled. inputs : names. scales : `natural_scales` if ``None``.
    tolerance : what counts as zero, relative to the norm of the scaled model.

    Raises
    ------
    ValueError
        If the model has no input of that name.
    """
    system = as_system(model)
    scales = natural_scales(system) if scales is None else scales
    inner = scaled(system, scales)
    part = inner.select(inputs=inputs)
    found = modes(system, scales=scales)
    w = [mode.adjoint for mode in found]
    return _margins(found, w, part, scales.time, size(inner), tolerance)


def observability_margins(
    model: control.StateSpace | LinearSystem,
    outputs: Sequence[str] | None = None,
    *,
    scales: Scales | None = None,
    tolerance: float = TOLERANCE,
) -> tuple[ModeMargin, ...]:
    """Return the margin of each mode, in the order of `modes`, for some outputs (all if ``None``).

    As `controllability_margins`, of outputs.
    """
    system = as_system(model)
    scales = natural_scales(system) if scales is None else scales
    inner = scaled(system, scales)
    part = inner.select(outputs=outputs).dual
    found = modes(system, scales=scales)
    v = [mode.scaled_shape.conj() for mode in found]
    return _margins(found, v, part, scales.time, size(inner), tolerance)


def _margins(
    found: tuple[Mode, ...],
    vectors: list[Complex],
    part: LinearSystem,
    time: float,
    whole: float,
    tolerance: float,
) -> tuple[ModeMargin, ...]:
    """Return the margins of the inputs of `part`, whose left eigenvectors are `vectors`."""
    if not found:
        return ()
    margins = (
        smallest(part.A, part.B, time * np.array([mode.eigenvalue for mode in found], dtype=np.complex128))
        / whole
    )
    lengths = np.linalg.norm(part.B, axis=0)
    measures = np.abs(np.array(vectors).conj() @ part.B) / np.where(lengths > 0.0, lengths, 1.0)
    return tuple(
        ModeMargin(
            mode,
            part.inputs,
            float(margin),
            tolerance,
            _lost(mode, float(margin), part, time, whole, tolerance),
            cosines,
        )
        for mode, margin, cosines in zip(found, margins, measures, strict=True)
    )


def _lost(mode: Mode, margin: float, part: LinearSystem, time: float, whole: float, tolerance: float) -> bool:
    s, blur = mode.eigenvalue * time, mode.uncertainty * time
    if tolerance < margin <= tolerance + blur / whole:
        margin = local_minimum(part.A, part.B, np.array([s]), _disc(s, blur))[0] / whole
    return margin <= tolerance


def _disc(centre: complex, radius: float) -> Callable[[Complex], Complex]:
    def nearest(s: Complex) -> Complex:
        out = s - centre
        return centre + out / np.maximum(np.abs(out) / radius, 1.0)

    return nearest
