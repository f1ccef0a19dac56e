"""The watch for signals that grow without end, over rows made for it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from co_sim import Connection, FunctionComponent, Port, System
from co_sim.watch import Watch

H = 0.01


def watch(n=1, looped=("p0",)):
    """A watch over `n` components of one signal each."""
    parts = {
        f"p{i}": FunctionComponent(lambda t, u: [u[0]], inputs=[Port("u", start=0.0)], outputs=[Port("y")])
        for i in range(n)
    }
    wires = [Connection(f"{name}.y", f"{name}.u") for name in looped]
    return Watch(System(parts, wires, step=H), set(looped))


def seen(signal, cuts=(), watching=None):
    """Show a signal, or several in columns, in blocks; return what was found on the way and at the end."""
    watching = watching or watch()
    rows = np.ascontiguousarray(np.reshape(signal, (len(signal), -1)), dtype=float)
    for begin, end in zip([0, *cuts], [*cuts, len(rows)], strict=True):
        found = watching.see(rows[begin:end], begin + 1, 0.0, H)
        if found:
            return found
    return watching.unfinished()


def test_a_short_run_that_diverges_is_stopped():
    step, growth = seen(1e-3 * 1.3 ** np.arange(150))
    assert step < 100
    assert growth.factor > 1e6
    assert growth.value == pytest.approx(1e-3 * 1.3 ** (step - 1))


def test_a_short_run_that_ends_in_growth_is_told():
    growth = seen(1e-6 * 1.15 ** np.arange(80))
    assert growth.factor > 1e3
    assert growth.until <= 80 * H


@pytest.mark.parametrize("power", [1, 2, 3])
@pytest.mark.parametrize("n", [60, 150, 256])
def test_a_parabola_is_no_exponential_growth(power, n):
    assert seen(1e3 * np.arange(1.0, n + 1) ** power) is None


def test_growth_at_the_beginning_that_has_ended_is_forgotten():
    assert seen(np.minimum(1e-3 * 1.2 ** np.arange(500), 1e3)) is None


def test_only_what_acts_back_is_watched():
    rows = np.ones((200, 4))
    rows[:, 2] = 1e-3 * 1.3 ** np.arange(200)
    assert seen(rows, watching=watch(4, looped=("p1", "p3"))) is None
    _, growth = seen(rows, watching=watch(4, looped=("p1", "p2")))
    assert growth.signal == "p2.y"


@settings(deadline=None, max_examples=40)
@given(st.lists(st.integers(1, 1199), max_size=6), st.floats(1.0, 1.1), st.integers(1, 5))
def test_how_a_run_is_cut_changes_nothing(cuts, growth, n):
    t = np.arange(1200.0)
    rows = np.cos(np.outer(t, np.linspace(0.03, 2.0, n))) * np.minimum(growth**t, 1e150)[:, None]
    names = [f"p{i}" for i in range(n)]
    whole, cut = (seen(rows, each, watch(n, names)) for each in ([], sorted(set(cuts))))
    assert str(whole) == str(cut)
