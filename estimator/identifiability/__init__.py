"""What sensors can tell at all: information, distances between hypotheses, least errors and sensor design.

Everything is computed of `Process`, samples of any linear model that white noise drives; `wheelset` has
those of the wheelset on an irregular track.
"""

from estimator.identifiability.adhesion import (
    UNKNOWN,
    Slopes,
    creep_bound,
    peak_adhesion_bound,
    same_force,
    small_signal,
)
from estimator.identifiability.averaged import averaged_points, averaged_same_force
from estimator.identifiability.decision import (
    ErrorProbability,
    error_of_many,
    error_probability,
    window_needed,
)
from estimator.identifiability.divergence import Rates, divergence_rates
from estimator.identifiability.fisher import Bound, bound_of, cramer_rao, fisher_rate
from estimator.identifiability.innovations import Divergences, innovation_rates, innovation_sums
from estimator.identifiability.process import Family, Process, Sensor, differentiate, observe, stack
from estimator.identifiability.sensor_design import limit, ranking
from estimator.identifiability.spectra import spectrum
from estimator.identifiability.wheelset import (
    SENSORS,
    SLOPES,
    creep_amplitude,
    creep_covariance,
    driven_by_track,
    slope_family,
    wheelset_process,
)
from estimator.identifiability.windows import (
    fisher_window,
    steady_covariance,
    window_covariance,
    window_rates,
)

__all__ = [
    "SENSORS",
    "SLOPES",
    "UNKNOWN",
    "Bound",
    "Divergences",
    "ErrorProbability",
    "Family",
    "Process",
    "Rates",
    "Sensor",
    "Slopes",
    "averaged_points",
    "averaged_same_force",
    "bound_of",
    "cramer_rao",
    "creep_amplitude",
    "creep_bound",
    "creep_covariance",
    "differentiate",
    "divergence_rates",
    "driven_by_track",
    "error_of_many",
    "error_probability",
    "fisher_rate",
    "fisher_window",
    "innovation_rates",
    "innovation_sums",
    "limit",
    "observe",
    "peak_adhesion_bound",
    "ranking",
    "same_force",
    "slope_family",
    "small_signal",
    "spectrum",
    "stack",
    "steady_covariance",
    "wheelset_process",
    "window_covariance",
    "window_needed",
    "window_rates",
]
