"""What a linear model does, what inputs reach of it and what outputs see, and how nearly not.

Pure functions on any `control.StateSpace`, or on a `LinearSystem` where units are known. They judge in
scaled units (`natural_scales`), in which the answers do not depend on the units the model came in.
"""

from estimator.structure.analysis import Access, Structure, analyse
from estimator.structure.distance import Distance, distance_to_uncontrollable, distance_to_unobservable
from estimator.structure.filters import (
    SteadyFilter,
    Verdict,
    detectable,
    filter_exists,
    stabilisable,
    steady_filter,
)
from estimator.structure.gramians import Gramians, gramians
from estimator.structure.margins import ModeMargin, controllability_margins, observability_margins
from estimator.structure.modes import Mode, modes
from estimator.structure.scaling import Scales, natural_scales, scaled
from estimator.structure.subspaces import Rank, controllability_rank, observability_rank, observable_part
from estimator.structure.system import LinearSystem

__all__ = [
    "Access",
    "Distance",
    "Gramians",
    "LinearSystem",
    "Mode",
    "ModeMargin",
    "Rank",
    "Scales",
    "SteadyFilter",
    "Structure",
    "Verdict",
    "analyse",
    "controllability_margins",
    "controllability_rank",
    "detectable",
    "distance_to_uncontrollable",
    "distance_to_unobservable",
    "filter_exists",
    "gramians",
    "modes",
    "natural_scales",
    "observability_margins",
    "observability_rank",
    "observable_part",
    "scaled",
    "stabilisable",
    "steady_filter",
]
