import io

import numpy as np
import pytest
from rich.console import Console

from co_sim import InputError, Live, Overruns, Pace, Progress, Signal
from co_sim.texts import number_of

X = [Signal("a.x", "m")]


class Clock:
    """A clock that only goes on when somebody computes or sleeps."""

    def __init__(self, overshoot=0.0):
        self.now, self.slept, self.overshoot = 1000.0, [], overshoot

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        assert seconds > 0.0
        self.slept.append(seconds)
        self.now += seconds + self.overshoot


def paced(drive, costs, *, factor=1.0, h=0.1, overshoot=0.0, start_cost=5.0, t0=20.0):
    """Run one step for each of `costs` (s); return the pace, its clock and when each row was let go."""
    clock = Clock(overshoot)
    pace = Pace(factor, clock=clock, sleep=clock.sleep)
    seen, cost = [], iter([start_cost, *costs])

    class Computes:
        def begin(self, *args): ...

        def observe(self, k, time, values):
            clock.now += next(cost)

        def end(self, error): ...

    class Sees(Computes):
        def observe(self, k, time, values):
            seen.append(clock.now - 1000.0 - start_cost)

    drive([Computes(), pace, Sees()], X, np.zeros((len(costs) + 1, 1)), t0=t0, h=h)
    return pace, clock, seen


@pytest.mark.parametrize("factor", [0.5, 1.0, 4.0])
def test_rows_are_let_go_at_their_time(drive, factor):
    pace, _, seen = paced(drive, [0.01] * 1000, factor=factor)
    np.testing.assert_allclose(seen, 0.1 * np.arange(1001) / factor, rtol=0, atol=1e-9)
    assert pace.overruns == Overruns(steps=1000)
    assert str(pace.overruns) == "all 1000 steps in time"


def test_waits_that_last_too_long_do_not_add_up(drive):
    pace, _, seen = paced(drive, [0.01] * 1000, overshoot=0.02)
    np.testing.assert_allclose(seen[1:], 0.1 * np.arange(1, 1001) + 0.02, rtol=0, atol=1e-9)
    assert pace.overruns.count == 0


def test_late_steps_are_counted_until_the_run_has_caught_up(drive):
    # The third step takes 0.25 s: its end is 0.15 s late, the next 0.07 s, then the run has caught up.
    pace, clock, seen = paced(drive, [0.02, 0.02, 0.25, 0.02, 0.02, 0.02])
    np.testing.assert_allclose(seen, [0.0, 0.1, 0.2, 0.45, 0.47, 0.5, 0.6], rtol=0, atol=1e-9)
    overruns = pace.overruns
    assert (overruns.steps, overruns.count) == (6, 2)
    assert overruns.first == pytest.approx(20.3)
    assert overruns.worst == pytest.approx(0.15)
    assert overruns.mean == pytest.approx(0.11)
    assert str(overruns) == (
        "2 of 6 steps late, first at t = 20.3 s, by 110 ms in the mean and 150 ms at worst"
    )
    assert len(clock.slept) == 4


def test_a_sleep_that_ends_early_is_gone_on_with(drive):
    clock = Clock()
    pace = Pace(clock=clock, sleep=lambda seconds: clock.sleep(max(seconds / 2, 1e-6)))
    drive([pace], X, [[0.0], [0.0]], h=0.1)
    assert clock.now == pytest.approx(1000.1, abs=2e-6)
    assert clock.now >= 1000.1


def test_a_new_run_starts_its_own_clock_and_count(drive):
    clock = Clock()
    pace = Pace(clock=clock, sleep=clock.sleep)

    class Late(Pace):
        def observe(self, k, time, values):
            clock.now += 1.0

    drive([Late(), pace], X, [[0.0]] * 3, h=0.1)
    assert pace.overruns.count == 2
    assert clock.now == pytest.approx(1003.0)
    drive([pace], X, [[0.0]] * 3, h=0.1)
    assert clock.now == pytest.approx(1003.2)
    assert pace.overruns == Overruns(steps=2)


def test_blocks_are_as_short_as_asked_for():
    assert Pace().max_block == 1
    assert Live(print, every=50).max_block == 50


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), float("inf")])
def test_a_pace_that_is_none_is_refused(factor):
    with pytest.raises(InputError, match="factor: got"):
        Pace(factor)


@pytest.mark.parametrize("sizes", [(1,), (4,), (3, 1, 2), (100,)])
def test_a_function_sees_python_values_by_name(drive, sizes):
    signals = [
        *X,
        Signal("a.n", "1", kind="int32"),
        Signal("a.on", "1", kind="boolean"),
        Signal("a.text", "1", kind="string"),
        Signal("b.x", "1"),
    ]
    values = [[0.5 * k, k, k % 2, number_of(f"text {k}"), np.nan] for k in range(10)]
    calls = []
    drive([Live(lambda t, seen: calls.append((t, seen)), "a.*", 3)], signals, values, sizes=sizes)
    assert calls == [
        (0.5 * k, {"a.x": 0.5 * k, "a.n": k, "a.on": bool(k % 2), "a.text": f"text {k}"})
        for k in (0, 3, 6, 9)
    ]
    assert [type(value) for value in calls[0][1].values()] == [float, int, bool, str]


def test_a_function_stops_the_run(drive):
    def stop(t, seen):
        raise StopIteration(t)

    with pytest.raises(StopIteration):
        drive([Live(stop)], X, [[0.0]])


def terminal():
    return Console(file=io.StringIO(), force_terminal=True, width=120, color_system=None)


def test_progress_shows_time_speed_and_end(drive):
    console, clock = terminal(), Clock()
    progress = Progress(console=console, clock=clock)

    class Computes:
        def begin(self, *args): ...

        def observe(self, k, time, values):
            clock.now += 0.25

        def end(self, error): ...

    drive([progress, Computes()], X, np.zeros((41, 1)), t0=10.0, h=0.5, sizes=(1, 3, 3))
    shown = console.file.getvalue()
    assert "t = 30 of 30 s" in shown
    assert "x real time" in shown
    assert "100%" in shown
    assert shown.count("Co-simulation") > 5


def test_progress_stays_where_the_run_stopped(drive):
    console = terminal()
    drive([Progress(console=console)], X, np.zeros((5, 1)), n_steps=8, error=RuntimeError())
    assert "t = 2 of 4 s" in console.file.getvalue()
    assert "100%" not in console.file.getvalue()


def test_progress_draws_seldom(drive):
    console, clock = terminal(), Clock()
    drive([Progress(console=console, clock=clock)], X, np.zeros((10_001, 1)))
    assert console.file.getvalue().count("Co-simulation") <= 4


def test_progress_is_silent_without_a_terminal(drive, capsys):
    drive([Progress(console=Console(file=io.StringIO())), Progress()], X, np.zeros((5, 1)))
    captured = capsys.readouterr()
    assert captured.out + captured.err == ""


def test_progress_of_a_run_without_steps(drive):
    console = terminal()
    drive([Progress(console=console)], X, [[1.0]], t0=1.0)
    assert "t = 1 of 1 s" in console.file.getvalue()
