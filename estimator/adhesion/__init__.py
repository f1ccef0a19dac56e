"""The adhesion bank: which rail is under the wheels, how much it can give and how much of it is used."""

from estimator.adhesion.bank import AdhesionBank, AdhesionIdentification
from estimator.adhesion.curves import REGIONS
from estimator.adhesion.hypotheses import Hypothesis

__all__ = ["REGIONS", "AdhesionBank", "AdhesionIdentification", "Hypothesis"]
