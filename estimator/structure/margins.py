"""How well inputs meet each mode and outputs see it: the test of Popov, Belevitch and Hautus in degrees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.structure.distance import local_minimum, smallest_at
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
    whole, B = size(inner), inner.select(inputs=inputs)
    return tuple(
        _margin(mode, mode.adjoint, inner.A, B.B, B.inputs, scales.time, whole, tolerance)
        for mode in modes(system, scales=scales)
    )


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
    whole, C = size(inner), inner.select(outputs=outputs)
    return tuple(
        _margin(mode, mode.scaled_shape.conj(), inner.A.T, C.C.T, C.outputs, scales.time, whole, tolerance)
        for mode in modes(system, scales=scales)
    )


def _margin(
    mode: Mode,
    w: Complex,
    A: Array,
    B: Array,
    signals: tuple[str, ...],
    time: float,
    whole: float,
    tolerance: float,
) -> ModeMargin:
    s, blur = mode.eigenvalue * time, mode.uncertainty * time
    margin = smallest_at(A, B, s) / whole
    lost = margin <= tolerance
    if not lost and margin <= tolerance + blur / whole:
        lost = local_minimum(A, B, np.array([s]), _disc(s, blur))[0] / whole <= tolerance
    lengths = np.linalg.norm(B, axis=0)
    measures = np.abs(w.conj() @ B) / np.where(lengths > 0.0, lengths, 1.0)
    return ModeMargin(mode, signals, margin, tolerance, lost, measures)


def _disc(centre: complex, radius: float) -> Callable[[Complex], Complex]:
    def nearest(s: Complex) -> Complex:
        out = s - centre
        return centre + out / np.maximum(np.abs(out) / radius, 1.0)

    return nearest
