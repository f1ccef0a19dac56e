"""Systems that several test modules of this folder ask."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

    import control
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Make = Callable[..., control.StateSpace]


@pytest.fixture(scope="session")
def make() -> Make:
    """Make a model of matrices given as nested lists; B and C are of ones where left out."""
    import control

    def model(A: object, B: object = None, C: object = None, dt: float = 0.0) -> control.StateSpace:
        A = np.atleast_2d(np.asarray(A, dtype=np.float64))
        n = A.shape[0]
        B = np.ones((n, 1)) if B is None else np.asarray(B, dtype=np.float64).reshape(n, -1)
        C = np.ones((1, n)) if C is None else np.asarray(C, dtype=np.float64).reshape(-1, n)
        D = np.zeros((C.shape[0], B.shape[1]))
        return control.ss(A, B, C, D, dt, remove_useless_states=False)

    return model
