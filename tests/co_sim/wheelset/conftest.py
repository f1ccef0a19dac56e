"""Experiments with plausible signals, made without the co-simulation, for figures and reports."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from co_sim.wheelset.results import Experiment, FilterDesign, Run, assess
from co_sim.wheelset.scenario import Scenario
from estimator import CreepCurve, NoiseModel, Tuning, design_filter, filter_model, identification_system
from estimator.linear_models import operating_points, point_at
from estimator.residuals import duels

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from co_sim.wheelset.scenario import Filter
    from estimator import OperatingPoint

#: Residuals of the filters from a time on, before normalisation.
Level = tuple[float, tuple[float, ...]]

STEP, WINDOW, DURATION = 2e-3, 0.5, 3.0


def _normalised(levels: Sequence[Level], time: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    E = np.empty((len(time), len(levels[0][1])))
    for since, values in levels:
        E[time >= since - STEP / 2] = values
    E *= 1.0 + 1e-4 * rng.normal(size=E.shape)
    return E / np.linalg.norm(E, axis=1, keepdims=True)


def _design(wanted: Filter, curve: CreepCurve, scenario: Scenario) -> FilterDesign:
    points = {point.name: point for point in operating_points(curve)}
    point = (
        points[wanted.point]
        if wanted.point
        else point_at(curve, wanted.name, curve.creep_at(wanted.adhesion))
    )
    noise = NoiseModel(2e-7, 1e-6, 0.75, (1e-3, 0.05))
    model = filter_model(point, scenario.parameters)
    filter_ = design_filter(model, noise.W, noise.R, STEP, name=wanted.name)
    return FilterDesign(wanted.name, wanted.condition, point, Tuning(filter_, noise, 1.0, 40), DURATION)


class Workshop:
    """Builds an experiment: a scenario, then runs with given residuals."""

    def __init__(self, **tables: Any) -> None:
        tables = {
            "simulation": {"step": STEP, "duration": DURATION},
            "identifier": {"window": WINDOW, "training": DURATION},
        } | tables
        self.scenario = Scenario.model_validate(tables)
        self.fuzzy = identification_system(len(self.scenario.filters))
        names = [side for rail in self.scenario.rail for side in rail.sides]
        names += [f.condition for f in self.scenario.filters]
        self.curves = {
            name: CreepCurve(self.scenario.condition(name), self.scenario.drive.speed)
            for name in dict.fromkeys(names)
        }
        self.filters = tuple(
            _design(f, self.curves[f.condition], self.scenario) for f in self.scenario.filters
        )

    def run(
        self,
        name: str,
        *levels: Level,
        amplitude: float = 1.0,
        offset: float = 1e-3,
        valid_until: float | None = None,
        until: float = DURATION,
        stopped: str | None = None,
    ) -> Run:
        """Return a run with residuals at `levels` and a motion of `amplitude` times the sensors' noise."""
        first = self.scenario.rail[0].sides[0]
        point = {p.name: p for p in operating_points(self.curves[first])}.get(name)
        time = np.arange(round(until / STEP) + 1) * STEP
        E = _normalised(levels, time, seed=1)
        fuzzy = self.fuzzy.compile()
        return Run(
            name=name,
            point=point,
            time=time,
            signals=self._signals(time, amplitude, offset, point),
            units={},
            E=E,
            probabilities=np.array([fuzzy(duels(row)) for row in E]),
            valid_until=time[-1] if valid_until is None else valid_until,
            stopped=stopped,
        )

    def _signals(
        self, time: NDArray[np.float64], amplitude: float, offset: float, point: OperatingPoint | None
    ) -> dict[str, NDArray[np.float64]]:
        rng = np.random.default_rng(2)
        wave = np.sqrt(2.0) * amplitude * np.sin(2 * np.pi * 4.0 * time)
        signals = {
            "plant.relative_displacement": offset * np.sin(2 * np.pi * 2.0 * time),
            "plant.adhesion_used": np.full(time.shape, 0.05),
        }
        for name, rms in (("yaw_rate", 1e-3), ("lateral_acceleration", 0.05)):
            signals[f"plant.{name}"] = rms * wave
            signals[f"sensors.{name}"] = rms * (wave + rng.normal(size=time.shape))
        curve = next(iter(self.curves.values()))
        slopes = (point.g11, point.g22) if point else (5e6, 6e6)
        values = {
            "creepage_x": point.creep if point else 1e-3,
            "adhesion_peak": curve.peak_adhesion,
            "g11": slopes[0],
            "g22": slopes[1],
        }
        for side in ("left", "right"):
            signals |= {f"plant.{side}.{name}": np.full(time.shape, value) for name, value in values.items()}
        return signals

    def experiment(self, *runs: Run) -> Experiment:
        """Return the experiment of these runs."""
        stretches = tuple(s for run in runs for s in assess(run, self.scenario, self.filters))
        return Experiment("made", self.scenario, self.filters, self.fuzzy, self.curves, runs, stretches)


P1: Level = (0.0, (0.45, 0.6, 0.66))
P2: Level = (0.0, (0.51, 0.507, 0.695))
P3: tuple[Level, Level] = ((0.0, (0.51, 0.5, 0.7)), (0.9, (0.7, 0.7, 0.12)))


@pytest.fixture(scope="session")
def workshop() -> Callable[..., Workshop]:
    return Workshop


@pytest.fixture(scope="session")
def paper() -> Experiment:
    """P1 identified, P2 undecided for want of signal, P3 identified and out of range from 1.6 s."""
    shop = Workshop(title="Dry rail at 20 m/s")
    return shop.experiment(
        shop.run("P1", P1, amplitude=2.0),
        shop.run("P2", P2, amplitude=0.004),
        shop.run("P3", *P3, amplitude=300.0, offset=0.06, valid_until=1.6),
    )


DROP_TABLES: dict[str, Any] = {
    "drive": {"mode": "torque_driven", "speed": 40.0, "times": (0.0, 1.0), "torque": (0.0, 4200.0)},
    "rail": (
        {"since": 0.0, "condition": "dry"},
        {"since": 0.8, "condition": "wet"},
        {"since": 1.6, "left": "low", "right": "dry"},
        {"since": 2.7, "condition": "low"},
    ),
    "identifier": {
        "window": WINDOW,
        "training": DURATION,
        "filters": tuple({"condition": name, "adhesion": 0.05} for name in ("dry", "wet", "low")),
    },
}


@pytest.fixture(scope="session")
def drop() -> Experiment:
    """One run: dry identified, wet mistaken for dry, low/dry unknown to the bank, low too short."""
    shop = Workshop(**DROP_TABLES)
    levels = ((0.0, (0.3, 0.7, 0.65)), (1.6, (0.6, 0.6, 0.5)))
    return shop.experiment(shop.run("torque_driven", *levels, amplitude=3.0))
