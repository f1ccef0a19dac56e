"""Estimation of the wheel-rail contact: creep law, linear models, filter bank and fuzzy identifier.

This package knows neither FMI nor the co-simulation master.
"""

from estimator.bank import FilterBank
from estimator.coloured import Disturbances, SensorBias, coloured_filter, coloured_model
from estimator.contact import CreepCurve
from estimator.finite_amplitude import averaged_point
from estimator.fuzzy import FuzzySystem, identification_system
from estimator.identifier import Identification, Identifier
from estimator.kalman import LinearFilter, design_filter
from estimator.likelihood import Evidence, LikelihoodBank
from estimator.linear_models import OperatingPoint, filter_model, operating_points, wheelset_model
from estimator.log import Log
from estimator.region import RegionBank, RegionHypothesis, RegionIdentification
from estimator.sensor_noise import SensorNoise
from estimator.track_spectrum import ERRI_B176, TrackSpectrum
from estimator.tuning import NoiseModel, Tuning, tune

__all__ = [
    "ERRI_B176",
    "CreepCurve",
    "Disturbances",
    "Evidence",
    "FilterBank",
    "FuzzySystem",
    "Identification",
    "Identifier",
    "LikelihoodBank",
    "LinearFilter",
    "Log",
    "NoiseModel",
    "OperatingPoint",
    "RegionBank",
    "RegionHypothesis",
    "RegionIdentification",
    "SensorBias",
    "SensorNoise",
    "TrackSpectrum",
    "Tuning",
    "averaged_point",
    "coloured_filter",
    "coloured_model",
    "design_filter",
    "filter_model",
    "identification_system",
    "operating_points",
    "tune",
    "wheelset_model",
]
