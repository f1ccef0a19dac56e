"""One self-contained HTML page: what was run, what came out, and what to make of it."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import jinja2
import tomli_w

from co_sim.files import whole_file
from co_sim.wheelset.assembly import MEASURED
from co_sim.wheelset.prose.departures import departures
from co_sim.wheelset.prose.findings import CLEAR_LEAD, Outcome, find, place
from co_sim.wheelset.prose.setup import described
from co_sim.wheelset.prose.words import capital, listed, number, percent, quantity

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from co_sim.wheelset.figures import Drawing
    from co_sim.wheelset.prose.findings import Finding
    from co_sim.wheelset.results import Experiment
    from co_sim.wheelset.scenario import Scenario

__all__ = ["scenario_toml", "write_report"]

_STATE_NAMES = {
    "psi": "yaw angle",
    "y_dot": "lateral velocity",
    "psi_dot": "yaw rate",
    "y_t": "track offset",
    "y_rel": "displacement against the track",
}


def write_report(
    experiment: Experiment, drawings: Sequence[Drawing], summary: Mapping[str, Any], path: Path
) -> None:
    """Write the report of an experiment to `path`; the page needs no other file and no network.

    Parameters
    ----------
    drawings : its figures, embedded in this order.
    summary : ``"seed"`` and ``"versions"``, a version by package, are read from it.
    """
    page = _environment().get_template("report.html.jinja").render(_content(experiment, drawings, summary))
    with whole_file(path) as temporary:
        temporary.write_text(page, encoding="utf-8")


def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("co_sim.wheelset"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": number,
        "percent": percent,
        "state_name": lambda name: _STATE_NAMES.get(name, name),
    }
    return environment


def _content(
    experiment: Experiment, drawings: Sequence[Drawing], summary: Mapping[str, Any]
) -> dict[str, Any]:
    scenario = experiment.scenario
    findings = find(experiment)
    paper = scenario.drive.mode == "prescribed_creep"
    return {
        "title": scenario.title or experiment.name,
        "experiment": experiment,
        "seed": summary["seed"],
        "versions": summary["versions"],
        "versions_text": listed([f"{name} {version}" for name, version in summary["versions"].items()]),
        "findings": findings,
        "places": [capital(place(experiment, finding.stretch)) for finding in findings],
        "clear_lead": CLEAR_LEAD,
        "setup": described(experiment),
        "sensors": list(MEASURED),
        "limit_mm": scenario.identifier.valid_offset * 1e3,
        "dashes": _dashes(experiment, findings),
        "departures": departures(experiment),
        "departures_title": f"What does not come out as {'in the paper' if paper else 'it should'}, and why",
        "drawings": [_embedded(drawing) for drawing in drawings],
        "training_notes": _training_notes(experiment),
        "track_file": scenario.track.file,
        "scenario_text": scenario_toml(scenario),
    }


def _embedded(drawing: Drawing) -> dict[str, str]:
    image = base64.b64encode(drawing.file.read_bytes()).decode("ascii")
    return {"key": drawing.key, "alt": drawing.alt, "caption": drawing.caption, "image": image}


def _dashes(experiment: Experiment, findings: list[Finding]) -> list[str]:
    """Say why there are dashes in the table of results."""
    reasons = [
        f"–: {place(experiment, finding.stretch)}: {finding.text}"
        for finding in findings
        if finding.outcome is Outcome.EMPTY
    ]
    if any(not finding.stretch.expected for finding in findings):
        reasons.append("– under true: the bank has no filter for this rail and creep.")
    return reasons


def _training_notes(experiment: Experiment) -> list[str]:
    asked = experiment.scenario.identifier.training
    short = [design.name for design in experiment.filters if design.training < 0.99 * asked]
    if not short:
        return []
    sentence = (
        f"The training of {listed(short)} is shorter than the {quantity(asked, 's')} asked for: the wheelset "
        f"left the range of the model by then, and the rest of the record does not count."
    )
    return [sentence]


def scenario_toml(scenario: Scenario) -> str:
    """Return a scenario as a TOML text with every field, which reads back as the same scenario."""
    return tomli_w.dumps(scenario.model_dump(mode="json", exclude_none=True))
