"""Studies as files: a plan over the quantities of a trial, and the question that it answers."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, ValidationError

from co_sim.campaign.plan import Case, Plan
from co_sim.errors import InputError
from co_sim.wheelset.studies.trial import Trial
from co_sim.wheelset.table_files import faults_of, read_text, tables_of, validated

if TYPE_CHECKING:
    from collections.abc import Iterator
    from importlib.resources.abc import Traversable

    from co_sim.errors import Fault

__all__ = ["BANKS", "Study", "load_study", "packaged_studies"]

Bank = Literal["adhesion", "window", "paper", "matched", "known", "exact"]
#: The banks that a study can compare: the adhesion bank of `wheelset identify`, whose evidence fades; the
#: same with the evidence of one window; the bank of the paper; and one that knows the plant as it is, with
#: the evidence of one window, after drops with that which fades: the likelihood of the exact model, as far
#: as extended Kalman filters have it.
#: ``"known"`` and ``"exact"`` are for an imposed creep on a known rail: linear filters along its creep curve,
#: and those at the very creepages P1, knee, P2 and beyond, which know the plant as it is. What exact mistakes
#: there is not in the samples, as far as its models hold; a large oscillation or an impact of the flange is
#: not in them, and there the other one, with more creepages to choose from, may do better.
BANKS: tuple[Bank, ...] = ("adhesion", "window", "paper", "matched")


class Study(Plan):
    """A plan whose quantities are those of a `Trial`."""

    title: str = Field("", description="one line for reports")
    question: str = Field("", description="that the study answers")
    banks: tuple[Bank, ...] = Field(BANKS, min_length=1, description="which banks look at each case")
    window: float = Field(1.0, gt=0.0, description="length of the evidence and of the windows, s")

    @property
    def plan_only(self) -> dict[str, Any]:
        """What decides the cases and their results, without the words."""
        return self.model_dump(mode="json", exclude={"title", "question"})

    def trial(self, case: Case) -> Trial:
        """Return the trial of a case."""
        return Trial.model_validate(case.values)


def _packaged() -> Traversable:
    return resources.files("co_sim.wheelset.studies") / "packaged"


def packaged_studies() -> list[str]:
    """Return the names of the packaged studies."""
    names = (item.name for item in _packaged().iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def load_study(source: str) -> Study:
    """Read a study: a packaged one by its name, or a file.

    Raises
    ------
    InputError
        If there is no such study, or it has faults; all are told.
    """
    if source in packaged_studies():
        text = (_packaged() / f"{source}.toml").read_text(encoding="utf-8")
        return parse(text, f"{source}.toml")
    path = Path(source)
    text = read_text(path, f"a study file or one of the packaged {', '.join(packaged_studies())}")
    return parse(text, path.name)


def parse(text: str, name: str) -> Study:
    """Return the study in a TOML `text`; `name` stands in messages for the file."""
    study = validated(Study, tables_of(text, name), name)
    faults = list(_faults_of_cases(study, name))
    if faults:
        raise InputError.from_faults(faults)
    return study


def _faults_of_cases(study: Study, name: str) -> Iterator[Fault]:
    """Yield what is wrong with quantities and values, each fault once, whatever the number of cases."""
    told = set()
    for case in study.cases():
        try:
            study.trial(case)
        except ValidationError as error:
            for fault in faults_of(error, Trial, name):
                if fault not in told:
                    told.add(fault)
                    yield fault
            if len(told) >= _MOST_FAULTS:
                return


_MOST_FAULTS = 10
