"""Rows as values in compiled code against numpy, and the bits that they must not change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from numba import njit
from numba.core.errors import TypingError

from estimator.adhesion import Hypothesis
from estimator.adhesion.rows import put, quad, row, total, transpose

from .conftest import bank, compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


@pytest.fixture
def A() -> Array:
    return np.random.default_rng(1).standard_normal((5, 4, 12))


@njit
def _combine(A: Array, out: Array) -> float:
    put(out, 0, 2.0 * row(A, 1) - row(A, 19) * 3.0)
    put(out, 1, row(A, 2) * row(A, 3) + row(A, 4))
    put(out, 2, quad(A, 6))
    return total(row(A, 5))


def test_rows_are_those_of_numpy_bit_by_bit(A: Array) -> None:
    out, R = np.full((3, 12), 7.0), A.reshape(20, 12)
    found = _combine(A, out)
    assert np.array_equal(out[0], 2.0 * R[1] - R[19] * 3.0)
    assert np.array_equal(out[1], R[2] * R[3] + R[4])
    assert np.array_equal(out[2], np.append(R[6, :4], np.full(8, 7.0)))
    assert found == pytest.approx(R[5].sum(), rel=1e-14)


@njit
def _turn(A: Array, out: Array) -> None:
    transpose(A, 3, out, 4)


def test_transposes(A: Array) -> None:
    out = np.zeros((5, 4, 12))
    _turn(A, out)
    assert np.array_equal(out.reshape(20, 12)[4:16], A.reshape(20, 12)[3:15].T)
    assert not out[0].any()
    assert not out[4].any()


def test_other_layouts_are_refused() -> None:
    with pytest.raises(TypingError):
        _combine(np.zeros((4, 5, 12), order="F"), np.zeros((3, 12)))


def test_triangles_of_the_covariance_are_equal_bits(z: Array) -> None:
    design = bank().design([Hypothesis("low"), Hypothesis("dry", "held", 1.7)])
    for C in compiled(design, z).filters.C:
        assert np.array_equal(C, C.T)
        assert np.linalg.eigvalsh(C / np.sqrt(np.outer(np.diag(C), np.diag(C)))).min() > 0.0
