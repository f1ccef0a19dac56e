"""What a bank of Kalman filters costs, beside C by hand and the packages that have such filters.

    python -m pip install '.[benchmark]'
    python benchmarks/filter_bank.py

All take the same filters (six states, two sensors, steady gains; those that know only moving covariances
start at the steady one, so that theirs stands still) over the same samples, and their innovations or
likelihoods must agree. Each is run in turns with the loop in C compiled with -O2; a ratio is that of
neighbours in time, the median over the rounds with the smallest and the largest. Times are of the processor,
for one filter and one sample. A package that is not installed is told so.

Then the whole scheme: the plant FMU, the sensors, 12 filters, residuals, fuzzy system and the recording of
all signals, in multiples of real time.
"""

from __future__ import annotations

import ctypes
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scheme_cost import whole
from scipy import signal
from threadpoolctl import threadpool_limits

from co_sim.wheelset.assembly import assemble
from co_sim.wheelset.experiment import Laboratory
from co_sim.wheelset.scenario import Scenario
from estimator import ERRI_B176, CreepCurve, Disturbances, FilterBank, LikelihoodBank, coloured_filter
from estimator.kalman import LinearFilter
from estimator.linear_models import point_at
from fmu_wheelset import CONDITIONS, WheelsetParameters

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from estimator import RecursiveFilter

    Array = NDArray[np.float64]
    #: Runs the bank over samples (T, m); returns the innovations (T, n, m) or the losses (T / EVERY, n).
    Runner = Callable[[Array], Array]

H, EVERY, ROUNDS = 1e-3, 10, 5
COUNTS = (3, 12, 48)
SAMPLES = 100_000
#: Samples for those that take the interpreter through every one of them.
FEW = {"filterpy": 200, "simdkalman": 100, "pykalman": 50}
FLAGS = {"C, -O2": ("-O2",), "C, -O3 -march=native": ("-O3", "-march=native")}


def filters_of(n: int) -> list[RecursiveFilter]:
    """Return filters at `n` creepages of the dry curve."""
    curve = CreepCurve(CONDITIONS["dry"], v=20.0)
    disturbances = Disturbances(ERRI_B176["erri_low"], acceleration=1e-6)
    multiples = np.geomspace(0.05, 0.9, n)
    return [
        coloured_filter(
            point_at(curve, f"{x:.3f}", x * curve.peak_creep), WheelsetParameters(), disturbances, H
        )
        for x in multiples
    ]


def compile_c(folder: Path) -> dict[str, ctypes.CDLL]:
    """Compile filter_bank.c once for each set of flags."""
    libraries = {}
    for i, (name, flags) in enumerate(FLAGS.items()):
        output = folder / f"filter_bank_{i}.so"
        source = str(Path(__file__).with_suffix(".c"))
        command = [
            sys.executable,
            "-m",
            "ziglang",
            "cc",
            *flags,
            "-Wall",
            "-Wextra",
            "-shared",
            "-fPIC",
            source,
        ]
        subprocess.run([*command, "-o", str(output)], check=True)
        libraries[name] = ctypes.CDLL(str(output))
    return libraries


def address(array: Array) -> ctypes.c_void_p:
    """Return the address of an array for C."""
    return ctypes.c_void_p(array.ctypes.data)


class Bank:
    """The filters as each contender wants them."""

    def __init__(self, filters: list[RecursiveFilter]) -> None:
        self.filters = filters
        self.likelihood = LikelihoodBank(filters, tolerance=1e9)  # steady from the first sample on
        d = self.likelihood.design
        self.F, self.H, self.K = (np.ascontiguousarray(M[0]) for M in (d.F, d.H, d.K))
        self.whitener, self.log_det = d.whitener[0].copy(), d.log_det[0].copy()
        self.innovations = FilterBank([self._linear(i) for i in range(len(filters))])

    def _linear(self, i: int) -> LinearFilter:
        f = self.filters[i]
        assert f.P is not None
        S = f.H @ f.P @ f.H.T + f.R
        return LinearFilter(f.name, f.F, f.H, self.K[i], S, f.P, f.Q, f.R, f.states)

    def c_innovations(self, library: ctypes.CDLL) -> Runner:
        """Return the loop in C that writes innovations."""
        n, s, m = self.K.shape

        def run(z: Array) -> Array:
            x, e = np.zeros((n, s)), np.empty((len(z), n, m))
            sizes = [ctypes.c_size_t(k) for k in (len(z), n, s, m)]
            library.innovations(*map(address, (self.F, self.H, self.K, z)), *sizes, address(x), address(e))
            return e

        return run

    def c_likelihoods(self, library: ctypes.CDLL) -> Runner:
        """Return the loop in C that adds up losses."""
        n, s, m = self.K.shape

        def run(z: Array) -> Array:
            x, loss = np.zeros((n, s)), np.empty((len(z) // EVERY, n))
            arrays = map(address, (self.F, self.H, self.K, self.whitener, self.log_det, z))
            sizes = [ctypes.c_size_t(k) for k in (len(z), n, s, m, EVERY)]
            library.likelihoods(*arrays, *sizes, address(x), address(loss))
            return loss

        return run

    def our_likelihoods(self, z: Array) -> Array:
        """Run this package's bank; a loss is what remains of a likelihood without its constant."""
        m = z.shape[1]
        found = self.likelihood.run(z, every=EVERY).log_likelihood
        return -2.0 * found - EVERY * m * np.log(2.0 * np.pi)

    def scipy(self, z: Array) -> Array:
        """Run lfilter over each mode; as transfer functions of sixth order the filters would be off by %."""
        e = np.empty((len(z), len(self.filters), z.shape[1]))
        for i, f in enumerate(self.filters):
            modes, V = np.linalg.eig(f.F @ (np.eye(len(f.F)) - self.K[i] @ f.H))
            driven = z @ np.linalg.solve(V, f.F @ self.K[i]).T
            e[:, i] = z
            for k, (mode, column) in enumerate(zip(modes, (f.H @ V).T, strict=True)):
                if mode.imag >= 0.0:  # of a conjugate pair, one stands for both
                    x = signal.lfilter([0.0, 1.0], [1.0, -mode], driven[:, k])
                    e[:, i] -= (2.0 if mode.imag > 0.0 else 1.0) * np.outer(x, column).real
        return e

    def filterpy(self, z: Array) -> Array:
        """Run filterpy with its steps for steady gains."""
        from filterpy.kalman import KalmanFilter

        e = np.empty((len(z), len(self.filters), z.shape[1]))
        for i, f in enumerate(self.filters):
            kf = KalmanFilter(dim_x=len(f.F), dim_z=z.shape[1])
            kf.F, kf.H, kf.Q, kf.R, kf.P, kf.K = f.F, f.H, f.Q, f.R, f.P, self.K[i]
            for t, sample in enumerate(z):
                kf.update_steadystate(sample)
                e[t, i] = np.ravel(kf.y)
                kf.predict_steadystate()
        return e

    def simdkalman(self, z: Array) -> Array:
        """Run simdkalman, one filter after the other."""
        import simdkalman

        n, m = len(self.filters), z.shape[1]
        e = np.empty((len(z), n, m))
        for i, f in enumerate(self.filters):
            kf = simdkalman.KalmanFilter(f.F, f.Q, f.H, f.R)
            P = f.P
            said = kf.compute(
                z[None],
                0,
                initial_value=np.zeros(len(f.F)),
                initial_covariance=P,
                filtered=True,
                smoothed=False,
            )
            e[:, i] = self._from_states(i, z, said.filtered.states.mean[0])
        return e

    def pykalman(self, z: Array) -> Array:
        """Run pykalman, one filter after the other."""
        from pykalman import KalmanFilter

        e = np.empty((len(z), len(self.filters), z.shape[1]))
        for i, f in enumerate(self.filters):
            kf = KalmanFilter(
                f.F, f.H, f.Q, f.R, initial_state_mean=np.zeros(len(f.F)), initial_state_covariance=f.P
            )
            e[:, i] = self._from_states(i, z, kf.filter(z)[0])
        return e

    def _from_states(self, i: int, z: Array, updated: Array) -> Array:
        """Return the innovations from the updated states (T, s)."""
        f = self.filters[i]
        predicted = np.vstack([np.zeros(len(f.F)), updated[:-1] @ f.F.T])
        return z - predicted @ f.H.T


def cost(run: Runner, z: Array) -> float:
    """Return the processor's time of a run, s."""
    begin = time.thread_time()
    run(z)
    return time.thread_time() - begin


def compare(run: Runner, floor: Runner, z: Array, few: int | None) -> tuple[float, list[float], float]:
    """Return the time for a sample, the ratios to the floor, and the largest relative difference."""
    own = z[:few] if few else z
    expected, found = floor(own), run(own)
    scale = np.abs(expected).max(axis=0)
    off = float((np.abs(found - expected).max(axis=0) / scale).max())
    times, ratios = [], []
    for _ in range(ROUNDS):
        base = cost(floor, z) / len(z)
        times.append(cost(run, own) / len(own))
        ratios.append(times[-1] / base)
    return statistics.median(times), ratios, off


def table(n: int, libraries: dict[str, ctypes.CDLL]) -> None:
    """Print the rows of `n` filters."""
    bank = Bank(filters_of(n))
    z = np.random.default_rng(1).standard_normal((SAMPLES, 2)) * [1e-3, 0.05]
    plain, optimised = libraries.values()
    floor, likelihood_floor = bank.c_innovations(plain), bank.c_likelihoods(plain)
    rows: list[tuple[str, Runner, Runner]] = [
        ("C, -O2", floor, floor),
        ("C, -O3 -march=native", bank.c_innovations(optimised), floor),
        ("FilterBank", bank.innovations.innovations, floor),
        ("scipy lfilter, by modes", bank.scipy, floor),
        ("filterpy", bank.filterpy, floor),
        ("simdkalman", bank.simdkalman, floor),
        ("pykalman", bank.pykalman, floor),
        ("C with likelihoods, -O2", likelihood_floor, likelihood_floor),
        ("C with likelihoods, -O3 ...", bank.c_likelihoods(optimised), likelihood_floor),
        ("LikelihoodBank", bank.our_likelihoods, likelihood_floor),
    ]
    print(f"\n{n} filters, {SAMPLES} samples\n")
    print(f"| {'bank':27} | {'ns':>9} | {'ratio to C, -O2':>28} | difference |")
    print(f"|{'-' * 29}|{'-' * 11}|{'-' * 30}|{'-' * 12}|")
    for name, run, base in rows:
        try:
            seconds, ratios, off = compare(run, base, z, FEW.get(name))
        except ImportError:
            print(f"| {name:27} | {'not installed':>9} | {'':28} | {'':10} |")
            continue
        assert off < 1e-6, f"{name}: off by {off}"
        spread = f"{statistics.median(ratios):.2f} ({min(ratios):.2f} .. {max(ratios):.2f})"
        print(f"| {name:27} | {1e9 * seconds / n:9.1f} | {spread:>28} | {off:10.0e} |")


def whole_scheme() -> None:
    """Print the cost of the scheme with 12 filters."""
    filters = tuple({"condition": c, "point": p} for c in CONDITIONS for p in ("P1", "P2", "P3"))
    scenario = Scenario.model_validate(
        {"simulation": {"duration": 10.0}, "identifier": {"filters": filters, "training": 2.0}}
    )
    laboratory = Laboratory(scenario, "twelve filters", Path())
    identifier = laboratory.identifier(laboratory.run().filters)
    case, h = laboratory.cases[0], scenario.simulation.step
    system = assemble(scenario, case, identifier)
    n = round(case.duration / h)
    whole(system, n)
    used = statistics.median(whole(system, n)[0] for _ in range(ROUNDS))
    signals = len(whole(system, 1)[1].names)
    print(f"\nWhole scheme, {len(filters)} filters, {signals} signals recorded, {n} steps of {h:g} s:")
    print(f"{1e6 * used / n:.2f} us a step, {n * h / used:.0f} x real time")


def main() -> None:
    """Print a table for each number of filters, and the cost of the whole scheme."""
    with threadpool_limits(1, user_api="blas"), tempfile.TemporaryDirectory() as folder:
        libraries = compile_c(Path(folder))
        for n in COUNTS:
            table(n, libraries)
        whole_scheme()


if __name__ == "__main__":
    main()
