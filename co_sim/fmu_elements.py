"""The elements of a model description in the same terms for FMI 2 and 3, also where it is wrong.

`co_sim.fmi_description` has fmpy read descriptions for runs, which ends at the first fault. What is to be
told about a description, with the line, is found here and in `co_sim.checking`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from co_sim.errors import Fault

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from lxml.etree import _Element

__all__ = ["FLOATS", "Declaration", "TypeDefinition", "Unknown", "Variable", "reference_faults"]

FLOATS = {"Real", "Float64", "Float32"}
_TYPES_2 = {"Real", "Integer", "Boolean", "String", "Enumeration"}
_PARAMETERS = {"parameter", "calculatedParameter", "structuralParameter"}
#: Names of the lists of the model structure, FMI 2 and 3.
_LISTS_2 = {"Outputs": "output", "Derivatives": "derivative", "InitialUnknowns": "initial unknown"}
_LISTS_3 = {
    "Output": "output",
    "ContinuousStateDerivative": "derivative",
    "ClockedState": "clocked state",
    "InitialUnknown": "initial unknown",
    "EventIndicator": "event indicator",
}
#: Elements of one array, beyond which a description is taken for a mistake or an attack.
_LARGEST_ARRAY = 10_000_000


@dataclass(frozen=True, slots=True)
class TypeDefinition:
    """A declared type: its name, the type of its variables, its attributes, and values of its literals."""

    name: str
    type: str
    attributes: Mapping[str, str]
    literals: Mapping[str, int | None]
    line: int


@dataclass(frozen=True, eq=False)
class Variable:
    """A variable as it is declared; what is missing or no number is ``None``.

    Parameters
    ----------
    element : of the variable.
    value : element with the attributes of its type; in FMI 3 the same.
    version : 2 or 3.
    """

    element: _Element
    value: _Element
    version: int

    @cached_property
    def name(self) -> str:
        """Name, empty if there is none."""
        return self.element.get("name") or ""

    @property
    def line(self) -> int:
        """Line of the element."""
        return int(self.element.sourceline or 0)

    @cached_property
    def type(self) -> str:
        """Type, as it is called in this version of FMI."""
        return str(self.value.tag)

    @cached_property
    def reference(self) -> int | None:
        """Value reference."""
        return whole(self.element.get("valueReference"))

    @cached_property
    def causality(self) -> str:
        """Causality, the default included."""
        return str(self.element.get("causality") or "local")

    @cached_property
    def variability(self) -> str:
        """Variability, the default included."""
        given = self.element.get("variability")
        if given:
            return str(given)
        if self.version == 2:
            return "continuous"
        if self.causality in _PARAMETERS:
            return "fixed"
        return "continuous" if self.type in FLOATS else "discrete"

    @cached_property
    def initial(self) -> str | None:
        """How the variable gets its first value, the default included; ``None`` for the independent one."""
        given: str | None = self.element.get("initial")
        if given or self.causality == "independent":
            return given
        if self.causality in {"parameter", "structuralParameter", "input"} or self.variability == "constant":
            return "exact"
        return "calculated"

    @cached_property
    def starts(self) -> list[str] | None:
        """The start values."""
        if self.version == 3 and self.type in {"String", "Binary"}:
            elements = self.element.findall("Start")
            return [element.get("value") or "" for element in elements] if elements else None
        text: str | None = self.value.get("start")
        if text is None or self.version == 2:
            return None if text is None else [text]
        return text.split()

    @cached_property
    def dimensions(self) -> list[_Element]:
        """Its dimensions; none for a scalar."""
        return list(self.element.findall("Dimension"))

    @cached_property
    def aliases(self) -> list[str]:
        """Further names (FMI 3)."""
        return [alias.get("name") or "" for alias in self.element.findall("Alias")]

    def get(self, attribute: str) -> str | None:
        """Return an attribute of its type."""
        text: str | None = self.value.get(attribute)
        return text


@dataclass(frozen=True, slots=True)
class Unknown:
    """An entry of the model structure; variables that do not exist are ``None``."""

    list: str
    reference: int | None
    variable: Variable | None
    dependencies: Sequence[Variable | None] | None
    kinds: Sequence[str] | None
    line: int


class Declaration:
    """A model description of FMI 2 or 3.

    Parameters
    ----------
    root : of the document; it need not be valid.
    """

    def __init__(self, root: _Element) -> None:
        self.root = root
        self.version = 2 if (root.get("fmiVersion") or "").startswith("2") else 3
        self.variables = tuple(self._variables())
        self.by_reference = {v.reference: v for v in reversed(self.variables) if v.reference is not None}
        self.units = {
            unit.get("name"): {display.get("name") for display in unit.findall("DisplayUnit")}
            for unit in root.iterfind("UnitDefinitions/Unit")
        }
        self.types = {definition.name: definition for definition in self._types()}
        self.unknowns = tuple(self._unknowns())

    def interfaces(self) -> Iterator[tuple[str, _Element]]:
        """Iterate over the interface types and their elements."""
        for kind in ("CoSimulation", "ModelExchange", "ScheduledExecution"):
            for element in self.root.findall(kind):
                yield kind, element

    def state_of(self, derivative: Variable) -> Variable | None:
        """Return the variable whose derivative another one declares to be."""
        return self.refer(derivative.get("derivative"))

    def refer(self, text: str | None) -> Variable | None:
        """Return the variable that is meant: by its place in FMI 2, by its value reference in FMI 3."""
        number = whole(text)
        if self.version == 3 or number is None:
            return self.by_reference.get(number) if number is not None else None
        return self.variables[number - 1] if 1 <= number <= len(self.variables) else None

    def attribute(self, variable: Variable, name: str) -> str | None:
        """Return an attribute of a variable or, where it has none, of its declared type."""
        given = variable.get(name)
        definition = self.types.get(variable.get("declaredType") or "")
        return given if given is not None or definition is None else definition.attributes.get(name)

    def shape(self, variable: Variable) -> tuple[int, ...] | None:
        """Return the shape by the start values of structural parameters; ``None`` if it is unclear."""
        sizes = []
        for dimension in variable.dimensions:
            size = whole(dimension.get("start"))
            if size is None:
                owner = self.refer(dimension.get("valueReference"))
                size = whole(owner.starts[0]) if owner is not None and owner.starts else None
            if size is None:
                return None
            sizes.append(size)
        return tuple(sizes)

    def _variables(self) -> Iterator[Variable]:
        for element in self.root.iterfind("ModelVariables/*"):
            if self.version == 3:
                yield Variable(element, element, 3)
            else:
                typed = next((child for child in element if child.tag in _TYPES_2), element)
                yield Variable(element, typed, 2)

    def _types(self) -> Iterator[TypeDefinition]:
        for element in self.root.iterfind("TypeDefinitions/*"):
            typed = element
            if self.version == 2:
                typed = next((child for child in element if child.tag in _TYPES_2), element)
            literals = {item.get("name") or "": whole(item.get("value")) for item in typed.findall("Item")}
            kind = str(typed.tag).removesuffix("Type") if self.version == 3 else str(typed.tag)
            attributes = dict(typed.attrib)
            yield TypeDefinition(element.get("name") or "", kind, attributes, literals, element.sourceline)

    def _unknowns(self) -> Iterator[Unknown]:
        lists = _LISTS_2 if self.version == 2 else _LISTS_3
        for element in self.root.iterfind("ModelStructure/*"):
            if element.tag not in lists:
                continue
            for entry in element.findall("Unknown") if self.version == 2 else [element]:
                yield self._unknown(lists[element.tag], entry)

    def _unknown(self, name: str, entry: _Element) -> Unknown:
        text = entry.get("index" if self.version == 2 else "valueReference")
        dependencies, kinds = entry.get("dependencies"), entry.get("dependenciesKind")
        return Unknown(
            name,
            whole(text),
            self.refer(text),
            None if dependencies is None else [self.refer(word) for word in dependencies.split()],
            None if kinds is None else kinds.split(),
            entry.sourceline,
        )


def reference_faults(declaration: Declaration, what: str) -> Iterator[Fault]:
    """Find references to variables that do not exist, names that are not unique, and arrays without a size.

    Each leaves open what is meant, so that such an FMU cannot be run.

    Parameters
    ----------
    declaration : the model description.
    what : name of the document.
    """
    yield from _double_names(declaration.variables, what)
    for variable in declaration.variables:
        where = f'{what}, line {variable.line}, variable "{variable.name}"'
        for name in ("derivative", "declaredType", "clocks"):
            missing = _missing(declaration, variable, name)
            if missing:
                yield Fault(where, f"{name}={missing!r}", "something that is declared", "correct it")
        size = _size(declaration, variable)
        if size is None:
            yield Fault(where, "an array of unclear size", "dimensions with a start value", "correct it")
        elif size > _LARGEST_ARRAY:
            yield Fault(where, f"an array of {size} elements", f"at most {_LARGEST_ARRAY}", "correct it")
    for unknown in declaration.unknowns:
        where = f"{what}, line {unknown.line}, {unknown.list} of the model structure"
        if unknown.variable is None:
            yield Fault(where, f"{unknown.reference}", "a variable that is declared", "correct it")
        elif unknown.list == "derivative" and declaration.state_of(unknown.variable) is None:
            yield Fault(where, f'"{unknown.variable.name}"', "the derivative of a variable", "correct it")
        if unknown.dependencies is not None and None in unknown.dependencies:
            yield Fault(where, "dependencies that are not declared", "variables", "correct it")


def whole(text: str | None) -> int | None:
    """Return a whole number, ``None`` for anything else."""
    try:
        return int(text) if text is not None else None
    except ValueError:
        return None


def _double_names(variables: Iterable[Variable], what: str) -> Iterator[Fault]:
    known: dict[str, int] = {}
    for variable in variables:
        for name in (variable.name, *variable.aliases):
            if name in known:
                where = f'{what}, line {variable.line}, variable "{name}"'
                yield Fault(where, f"the name of line {known[name]}", "a unique name", "rename one of them")
            known.setdefault(name, variable.line)


def _missing(declaration: Declaration, variable: Variable, attribute: str) -> str | None:
    """Return the reference of an attribute if it leads nowhere."""
    text = variable.get(attribute)
    if text is None:
        return None
    if attribute == "declaredType":
        return None if text in declaration.types else text
    lost = [word for word in text.split() if declaration.refer(word) is None]
    return " ".join(lost) or None


def _size(declaration: Declaration, variable: Variable) -> int | None:
    shape = declaration.shape(variable)
    if shape is None or any(size < 0 for size in shape):
        return None
    n = 1
    for size in shape:
        n *= size
    return n
