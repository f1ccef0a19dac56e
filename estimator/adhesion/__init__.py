"""The adhesion bank: which rail is under the wheels, how much it can give and how much of it is used."""

from estimator.adhesion.assumptions import Unknowns
from estimator.adhesion.bank import AdhesionBank
from estimator.adhesion.curves import REGIONS
from estimator.adhesion.fuzzy import FuzzyIdentifier, Verdict
from estimator.adhesion.fuzzy_rules import fuzzy_system
from estimator.adhesion.hypotheses import Hypothesis, unlike_rails
from estimator.adhesion.judgement import new_judgement
from estimator.adhesion.result import AdhesionIdentification

__all__ = [
    "REGIONS",
    "AdhesionBank",
    "AdhesionIdentification",
    "FuzzyIdentifier",
    "Hypothesis",
    "Unknowns",
    "Verdict",
    "fuzzy_system",
    "new_judgement",
    "unlike_rails",
]
