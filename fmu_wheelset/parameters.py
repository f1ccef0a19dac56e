"""The parameters of the wheelset and its contact: the only home of constants.

Every field carries its unit, symbol, description and source as metadata, so that the FMU's variable
table, the linear models, the scenario files and the documentation read the same numbers.

Sources: *Hussain 2012* is Hussain et al., Mehran Univ. Res. J. 31(4), Table 1. *Polach 2005* is
O. Polach, Wear 258, 992-1000. *Hertz/Kalker* follows from the normal load of 79.7 kN. *assumed* is ours.
"""

from __future__ import annotations

import math
from dataclasses import Field, dataclass, field, fields
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:
    from collections.abc import Mapping


def quantity(
    default: float | None,
    unit: str,
    symbol: str,
    description: str,
    source: str,
    *,
    minimum: float = 0.0,
    maximum: float = math.inf,
    minimum_allowed: bool = False,
) -> float:
    """Declare a physical quantity as a dataclass field.

    Parameters
    ----------
    default : value in SI units; ``None`` makes the field required.
    unit, symbol, description, source : facts that documentation and the FMU show.
    minimum, maximum : bounds; ``maximum`` is allowed, ``minimum`` only if ``minimum_allowed``.
    """
    facts = {
        "unit": unit,
        "symbol": symbol,
        "description": description,
        "source": source,
        "minimum": minimum,
        "maximum": maximum,
        "minimum_allowed": minimum_allowed,
    }
    declared = field(metadata=facts) if default is None else field(default=default, metadata=facts)
    return cast("float", declared)


def _check_bounds(owner: object, declared: Field[Any]) -> None:
    """Raise ``ValueError`` naming what, got, expected and remedy if a quantity is out of bounds."""
    value = getattr(owner, declared.name)
    facts = declared.metadata
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(
            f"{declared.name}: got {value!r}, expected a number in {facts['unit']}; write it without quotes"
        )
    lower_ok = value >= facts["minimum"] if facts["minimum_allowed"] else value > facts["minimum"]
    if not (math.isfinite(value) and lower_ok and value <= facts["maximum"]):
        relation = ">=" if facts["minimum_allowed"] else ">"
        upper = "" if math.isinf(facts["maximum"]) else f" and <= {facts['maximum']:g}"
        raise ValueError(
            f"{declared.name}: got {value:g} {facts['unit']}, expected a finite value "
            f"{relation} {facts['minimum']:g}{upper} {facts['unit']}; "
            f"give the {facts['description']} in SI units"
        )


class Quantities:
    """Mix-in for frozen dataclasses of quantities: checks all bounds at construction."""

    __slots__ = ()

    def __post_init__(self) -> None:
        for declared in fields(cast("Any", self)):
            if "unit" in declared.metadata:
                _check_bounds(self, declared)


@dataclass(frozen=True, slots=True, kw_only=True)
class RailCondition(Quantities):
    """Friction and stiffness reduction of one wheel-rail contact, after Polach 2005."""

    k_A: float = quantity(None, "1", "k_A", "reduction factor in the area of adhesion", "Polach 2005")
    k_S: float = quantity(None, "1", "k_S", "reduction factor in the area of slip", "Polach 2005")
    mu_0: float = quantity(None, "1", "mu_0", "friction coefficient at zero slip speed", "Polach 2005")
    A: float = quantity(
        None, "1", "A", "ratio of friction at infinite to zero slip speed", "Polach 2005", maximum=1.0
    )
    B: float = quantity(
        None, "s/m", "B", "decay of friction with slip speed", "Polach 2005", minimum_allowed=True
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactPatch(Quantities):
    """Hertzian contact ellipse and Kalker's linear creep coefficients of one wheel on its rail."""

    G: float = quantity(82e9, "Pa", "G", "shear modulus of wheel and rail", "Polach 2005")
    a: float = quantity(6.94e-3, "m", "a", "semi-axis of the contact ellipse along the rail", "Hertz/Kalker")
    b: float = quantity(4.94e-3, "m", "b", "semi-axis of the contact ellipse across the rail", "Hertz/Kalker")
    C11: float = quantity(4.626, "1", "C11", "Kalker coefficient, longitudinal", "Hertz/Kalker")
    C22: float = quantity(4.238, "1", "C22", "Kalker coefficient, lateral", "Hertz/Kalker")


@dataclass(frozen=True, slots=True, kw_only=True)
class WheelsetParameters(Quantities):
    """Inertias, geometry and stiffnesses of a solid-axle wheelset."""

    m_w: float = quantity(1250.0, "kg", "m_w", "mass of the wheelset", "Hussain 2012")
    I_w: float = quantity(700.0, "kg.m2", "I_w", "yaw moment of inertia of the wheelset", "Hussain 2012")
    r0: float = quantity(0.5, "m", "r_0", "rolling radius at the central position", "Hussain 2012")
    gamma: float = quantity(
        0.15, "rad", "gamma", "conicity of the wheel tread", "Hussain 2012", minimum_allowed=True
    )
    L_g: float = quantity(0.75, "m", "L_g", "half of the track gauge", "Hussain 2012")
    k_w: float = quantity(
        5.0e6, "N.m/rad", "k_w", "yaw stiffness to the frame", "Hussain 2012", minimum_allowed=True
    )
    I_L: float = quantity(
        133.2, "kg.m2", "I_L", "spin inertia of the left wheel", "Hussain 2012 (both are printed I_R)"
    )
    I_R: float = quantity(
        68.2, "kg.m2", "I_R", "spin inertia of the right wheel", "Hussain 2012 (both are printed I_R)"
    )
    k_s: float = quantity(6.06e6, "N.m/rad", "k_s", "torsional stiffness of the axle", "literature")
    # The axle has no damping of its own by default; a steel axle with 0.1 % of critical damping has 33.
    c_s: float = quantity(
        0.0, "N.m.s/rad", "c_s", "torsional damping of the axle", "assumed", minimum_allowed=True
    )
    M_v: float = quantity(15.0e3, "kg", "M_v", "vehicle mass carried by the wheelset", "assumed")
    N: float = quantity(79.7e3, "N", "N", "normal load of each wheel", "literature")
    # What the paper does not have is off: differences, stiffnesses and angles are zero.
    delta_r: float = quantity(
        0.0,
        "m",
        "Delta r",
        "rolling radius of the left wheel less that of the right",
        "off",
        minimum=-0.1,
        maximum=0.1,
        minimum_allowed=True,
    )
    k_y: float = quantity(
        0.0, "N/m", "k_y", "lateral stiffness of the suspension to the ground", "off", minimum_allowed=True
    )
    c_y: float = quantity(
        0.0, "N.s/m", "c_y", "lateral damping of the suspension to the ground", "off", minimum_allowed=True
    )
    c_w: float = quantity(
        0.0, "N.m.s/rad", "c_w", "yaw damping of the suspension to the ground", "off", minimum_allowed=True
    )
    contact_angle: float = quantity(
        0.0,
        "rad",
        "delta_0",
        "contact angle at the central position, for gravitational stiffness",
        "off; gamma for conical wheels",
        minimum_allowed=True,
    )
    contact_angle_rate: float = quantity(
        0.0,
        "rad/m",
        "delta'",
        "change of the contact angle with displacement, for gravitational stiffness",
        "off; 1/(R_wheel - R_rail) of circular profiles",
        minimum_allowed=True,
    )
    flange_stiffness: float = quantity(
        0.0,
        "N/m",
        "k_f",
        "lateral stiffness of flange on rail, 0 for no flanges",
        "off",
        minimum_allowed=True,
    )
    flange_clearance: float = quantity(
        8e-3,
        "m",
        "y_f",
        "displacement from the track at which the flange touches",
        "assumed",
        minimum_allowed=True,
    )
    flange_transition: float = quantity(
        5e-4, "m", "s_f", "depth over which the flange's stiffness builds up", "assumed"
    )
    flange_damping: float = quantity(
        0.5,
        "s/m",
        "d_f",
        "part of the flange's force added per speed of approach",
        "assumed",
        minimum_allowed=True,
    )
    g: float = quantity(
        9.81, "m/s2", "g", "gravitational acceleration, for cant", "literature", minimum_allowed=True
    )
    patch: ContactPatch = field(default_factory=ContactPatch)


#: Rail conditions by name; parameters for near-dry to extremely low adhesion.
CONDITIONS: Mapping[str, RailCondition] = MappingProxyType(
    {
        "dry": RailCondition(k_A=1.0, k_S=0.4, mu_0=0.55, A=0.40, B=0.60),
        "wet": RailCondition(k_A=0.3, k_S=0.1, mu_0=0.30, A=0.40, B=0.20),
        "low": RailCondition(k_A=1.0, k_S=1.0, mu_0=0.06, A=0.40, B=0.20),
        "very_low": RailCondition(k_A=1.0, k_S=1.0, mu_0=0.03, A=0.40, B=0.10),
    }
)

#: Below this speed (m/s) the creepages are divided by a regularised speed, see docs/model.md.
V_REGULAR = 0.1
