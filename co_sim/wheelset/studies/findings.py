"""What the windows and cases of a study say: accuracies, confusions, calibration, adhesion, alarms."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from co_sim.wheelset.identifying.answer import CONDITION_NAMES, REGIONS
from co_sim.wheelset.studies.intervals import Rate, Share, paired_difference, rate_of, share_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Mask = NDArray[np.bool_]

__all__ = ["CLASSES", "Adhesion", "Calibration", "Findings", "Latency"]

#: What is identified, and the names of its classes.
CLASSES = {"region": REGIONS, "condition": CONDITION_NAMES}
#: Edges of the probabilities over which calibration is shown.
_EDGES = np.array([0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0])
#: Use of adhesion from which on its peak is asked for, and the part by which an estimate is dangerous.
USED_ENOUGH, TOO_MUCH = 0.6, 0.1


@dataclass(frozen=True)
class Calibration:
    """How often a bank is right when it gives its answer a probability.

    Parameters
    ----------
    probability : (n,) mean probability given. right : (n,) share of right answers, with intervals.
    """

    probability: Array
    right: tuple[Share, ...]


@dataclass(frozen=True)
class Adhesion:
    """How well the peak adhesion is known where at least `USED_ENOUGH` of it is used.

    Parameters
    ----------
    windows : how many. error : median of the error relative to the truth, taken without its sign.
    bias : median with its sign. covered : share of intervals of 90 % that hold the truth.
    too_much : share of estimates more than `TOO_MUCH` above the truth, the dangerous side.
    """

    windows: int
    error: float
    bias: float
    covered: Share
    too_much: Share


@dataclass(frozen=True)
class Latency:
    """Times from drops of adhesion to the alarm.

    Parameters
    ----------
    seconds : (n,) sorted, of the drops that were announced. missed : how many were not.
    """

    seconds: Array
    missed: int

    def quantile(self, p: float) -> float:
        """Return the time within which the share `p` of all drops was announced, s; inf if never."""
        n = self.seconds.size + self.missed
        if n == 0:
            return float("nan")
        place = int(np.ceil(p * n)) - 1
        return float(self.seconds[place]) if place < self.seconds.size else float("inf")


class Findings:
    """The tables of a study, and the questions that can be put to them.

    Parameters
    ----------
    cases : a row for each case, see `co_sim.campaign.results.rows`.
    windows : a row for each window, with the number of its case. banks : that looked.
    variants : names of the variants of the plan, of which each place of the plan has a case.
    """

    def __init__(
        self,
        cases: Sequence[dict[str, Any]],
        windows: Sequence[dict[str, Any]],
        banks: Sequence[str],
        variants: Sequence[str] = (),
    ) -> None:
        self.cases = [row for row in cases if row["status"] == "done"]
        self.failures = [row for row in cases if row["status"] == "failed"]
        self.banks = tuple(banks)
        self.variants = tuple(variants)
        self._windows = list(windows)
        self._by_number = {row["case"]: row for row in self.cases}

    @cached_property
    def case(self) -> NDArray[np.int64]:
        """Number (n,) of the case of each window."""
        return self.column("case").astype(np.int64)

    def column(self, name: str) -> Array:
        """Return a column (n,) of the windows; nan where there is no value."""
        values = [row.get(name) for row in self._windows]
        return np.array([np.nan if value is None else float(value) for value in values])

    def of_case(self, name: str) -> NDArray[Any]:
        """Return a quantity (n,) of the case of each window."""
        return np.array([self._by_number[number].get(name) for number in self.case])

    def says(self, bank: str, what: str) -> bool:
        """Return whether a bank says anything about ``"region"`` or ``"condition"``."""
        return bool(self._windows) and f"{bank}.{what}" in self._windows[0]

    def right(self, bank: str, what: str) -> Mask:
        """Return where (n,) a bank is right."""
        return np.asarray(self.column(f"{bank}.{what}") == self.column(what))

    def trusted(self, bank: str) -> Mask:
        """Return where (n,) a bank says that its answer can be trusted."""
        return np.asarray(self.column(f"{bank}.identifiable") == 1.0)

    def accuracy(self, bank: str, what: str, where: Mask | None = None) -> Share:
        """Return how often a bank is right, in the windows `where` (n,)."""
        chosen = np.ones(len(self._windows), dtype=bool) if where is None else where
        return share_of(self.right(bank, what)[chosen], self.case[chosen])

    def confusion(self, bank: str, what: str) -> NDArray[np.int64]:
        """Return the windows by true (row) and declared (column) class."""
        classes = len(CLASSES[what])
        true, said = (self.column(name).astype(np.int64) for name in (what, f"{bank}.{what}"))
        return np.bincount(true * classes + said, minlength=classes**2).reshape(classes, classes)

    def calibration(self, bank: str, what: str) -> Calibration:
        """Return how often answers of each probability are right; empty bins are left out."""
        p, right = self.column(f"{bank}.p_{what}"), self.right(bank, what)
        bins = np.clip(np.digitize(p, _EDGES) - 1, 0, _EDGES.size - 2)
        used = [b for b in range(_EDGES.size - 1) if np.any(bins == b)]
        return Calibration(
            np.array([p[bins == b].mean() for b in used]),
            tuple(share_of(right[bins == b], self.case[bins == b]) for b in used),
        )

    def adhesion(self, bank: str, where: Mask | None = None) -> Adhesion | None:
        """Return how well a bank knows the peak adhesion; ``None`` if it says nothing about it."""
        if not (self._windows and f"{bank}.mu_max" in self._windows[0]):
            return None
        true, estimate = self.column("mu_max"), self.column(f"{bank}.mu_max")
        asked = (self.column("mu_used") >= USED_ENOUGH * true) & np.isfinite(estimate)
        asked &= True if where is None else where
        true, estimate, case = true[asked], estimate[asked], self.case[asked]
        low, high = (self.column(f"{bank}.mu_max_{side}")[asked] for side in ("low", "high"))
        error = estimate / true - 1.0
        return Adhesion(
            int(asked.sum()),
            float(np.median(np.abs(error))) if error.size else float("nan"),
            float(np.median(error)) if error.size else float("nan"),
            share_of((low <= true) & (true <= high), case),
            share_of(error > TOO_MUCH, case),
        )

    def latency(self, bank: str, **chosen: object) -> Latency | None:
        """Return the latencies of drops, in cases of the `chosen` quantities; ``None`` if there were none."""
        name = f"{bank}.latency"
        cases = [row for row in self.cases if all(row.get(key) == value for key, value in chosen.items())]
        dropped = [row[name] for row in cases if name in row]
        if not dropped:
            return None
        return Latency(
            np.sort([t for t in dropped if t is not None]).astype(np.float64),
            sum(t is None for t in dropped),
        )

    def false_alarms(self, bank: str) -> Rate:
        """Return the rate of false alarms."""
        events = sum(int(row.get(f"{bank}.false_alarms", 0)) for row in self.cases)
        return rate_of(events, sum(float(row.get(f"{bank}.watched", 0.0)) for row in self.cases))

    def losses(self, bank: str, what: str) -> dict[str, tuple[float, float, float]]:
        """Return for each variant the accuracy over that of the first one, with its interval.

        Cases are compared in pairs, which have their random numbers in common.
        """
        shares = self._shares_of_cases(bank, what)
        by_variant: dict[str, dict[int, float]] = {variant: {} for variant in self.variants}
        for row in self.cases:
            if row["case"] in shares:
                # Variants of one place of the plan follow each other.
                by_variant[row["variant"]][row["case"] // len(self.variants)] = shares[row["case"]]
        first = by_variant[self.variants[0]]
        found = {}
        for variant in self.variants[1:]:
            both = [place for place in first if place in by_variant[variant]]
            pair = [np.array([group[place] for place in both]) for group in (first, by_variant[variant])]
            found[variant] = paired_difference(*pair)
        return found

    def _shares_of_cases(self, bank: str, what: str) -> dict[int, float]:
        """Return the share of right windows of each case."""
        numbers, index = np.unique(self.case, return_inverse=True)
        hits = np.bincount(index, weights=self.right(bank, what).astype(np.float64))
        return dict(zip(numbers.tolist(), hits / np.bincount(index), strict=True))
