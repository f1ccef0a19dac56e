"""Studies: files that tell their faults, trials that are what they say, scores against hand-made answers."""

from dataclasses import replace

import numpy as np
import pytest

from co_sim.campaign import Case
from co_sim.errors import InputError
from co_sim.wheelset.identifying.answer import REGIONS, Answer
from co_sim.wheelset.recordings import record
from co_sim.wheelset.studies.evaluation import evaluate
from co_sim.wheelset.studies.findings import Findings
from co_sim.wheelset.studies.output import report_on
from co_sim.wheelset.studies.place_section import place_section
from co_sim.wheelset.studies.scoring import alarms_of, score
from co_sim.wheelset.studies.study import load_study, packaged_studies, parse
from co_sim.wheelset.studies.trial import POINTS, Trial


@pytest.mark.parametrize("name", packaged_studies())
def test_packaged_studies_are_sound(name):
    study = load_study(name)
    assert study.title
    assert study.question.endswith("?")
    assert 40 <= study.size <= 2000


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("grid = ", "not TOML"),
        ("[grid]\nspeeed = [20.0]", 'did you mean "speed"'),
        ('[grid]\ncondition = ["dry", "icy"]', "icy"),
        ("[fixed]\nspeed = 0.0", "greater than or equal to 1"),
        ("[fixed]\nmass = 3.0", "less than 2"),
        ("colour = 1", "unknown key"),
        ("[draw.speed]\nuniforn = [20.0, 30.0]", 'one of uniform, normal, choice; did you mean "uniform"'),
        ('[fixed]\nmanoeuvre = "drop"\nduration = 3.0', "lengthen"),
        ("[grid]\nspeed = [20.0, 20.0]", "distinct"),
    ],
)
def test_faults_of_files_are_told(text, told):
    with pytest.raises(InputError, match=told):
        parse(text, "mine.toml")


def test_several_faults_are_told_at_once():
    with pytest.raises(InputError) as caught:
        parse('[fixed]\nspeed = -1.0\nmas = 1.1\ncondition = "icy"', "mine.toml")
    assert len(caught.value.faults) == 3


def test_torque_is_the_utilisation_of_the_true_plant():
    trial = Trial(condition="wet", utilisation=0.5, load=1.1, speed=30.0, duration=4.0, direction="braking")
    made = record(trial.journey(1))
    settled = made.time > 3.0
    used = np.abs(made.truth["adhesion_used"][settled]).mean()
    assert used == pytest.approx(0.5 * made.peak_adhesion[-1], rel=0.01)
    assert made.traction_torque[-1] < 0.0


def test_points_are_where_they_say():
    creeps = [Trial(manoeuvre="prescribed", point=point).creep for point in ("P1", "knee", "P2", "beyond")]
    curve = Trial().curve
    assert creeps == pytest.approx([0.1 * creeps[2], curve.knee_creep, curve.peak_creep, 1.7 * creeps[2]])
    assert float(curve.tangent(curve.knee_creep)) == pytest.approx(0.15 * curve.initial_slope, rel=1e-6)


def test_points_are_in_their_regions():
    for name, point in POINTS.items():
        trial = Trial(manoeuvre="prescribed", point=name)
        curve = trial.curve
        expected = 0 if trial.creep < 0.999 * curve.knee_creep else 1
        expected += trial.creep > 1.001 * curve.peak_creep
        assert REGIONS[expected] == point.region


@pytest.mark.parametrize(("point", "region"), [("P1", 0), ("beyond", 2)])
def test_linear_filters_find_the_region_of_an_imposed_creep(point, region):
    # Flanges, for without them it is less than 8 mm off the track for too short a time.
    trial = {"manoeuvre": "prescribed", "point": point, "speed": 20.0, "duration": 3.0, "flanges": True}
    windows = evaluate(Case(number=0, values=trial, seed=1003), ("known", "exact"), 1.0)["windows"]
    # An imposed creep is there from the start, so that the first window counts.
    assert windows["time"][0] == pytest.approx(1.0)
    assert windows["region"] == windows["known.region"] == windows["exact.region"]
    assert set(windows["region"]) == {region}


def places_of(said):
    """The section on a study at two points and two speeds, without and with flanges."""
    study = parse(
        'banks = ["known"]\n[grid]\npoint = ["P1", "beyond"]\nspeed = [20.0, 60.0]\nflanges = [false, true]\n'
        '[fixed]\nmanoeuvre = "prescribed"\n',
        "t.toml",
    )
    cases = [row(case, {}) for case in study.cases()]
    windows = [
        {"case": case["case"], "region": 2 * (case["point"] == "beyond"), "known.region": said(case)}
        for case in cases
        if not (case["point"] == "beyond" and case["speed"] == 60.0 and not case["flanges"])
    ]
    return place_section(study, Findings(cases, windows, study.banks), study.banks)


def test_places_tell_each_point_speed_and_flanges():
    # Right, but for an unstable wheelset at 20 m/s, which is called linear.
    section = places_of(lambda case: 2 if case["point"] == "beyond" and case["speed"] == 60.0 else 0)
    assert section.numbers["unstable_windows"].value == 3
    assert section.numbers["unstable_called_linear"].value == [2]
    right = section.numbers["right"].value
    assert right[0, 0].tolist() == [[1.0, 1.0], [1.0, 1.0]]
    assert right[0, 1, 0].tolist() == [0.0, 0.0]
    assert np.isnan(right[0, 1, 1, 0])
    assert right[0, 1, 1, 1] == 1.0
    without, flanged = section.tables
    assert without.rows[1] == ("beyond", "known", "0\u00a0% (1)", None)
    assert flanged.rows[1] == ("beyond", "known", "0\u00a0% (1)", "100\u00a0% (1)")
    assert section.summary == (
        "Of 3 windows of an unstable wheelset, these are called linear: 2 by the known bank.",
    )


@pytest.fixture(scope="module")
def dropped():
    trial = Trial(manoeuvre="drop", condition="low", before="dry", change=3.0, duration=6.0, utilisation=0.7)
    return trial, record(trial.journey(3))


def answer_with(time, low):
    """An answer that gives low adhesion the probability `low` (n,), and is else sure of dry."""
    p = np.zeros((time.size, 4))
    p[:, 2], p[:, 0] = low, 1.0 - low
    region = np.tile([0.8, 0.1, 0.1], (time.size, 1))
    mu = np.full(time.size, 0.06)
    return Answer(
        bank="adhesion",
        time=time,
        samples=np.arange(time.size),
        p_region=region,
        identifiable=np.ones(time.size, dtype=bool),
        p_condition=p,
        mu_max=mu,
        mu_max_low=0.9 * mu,
        mu_max_high=np.where(time > 5.0, np.nan, 1.1 * mu),
    )


def test_alarms_have_hysteresis_and_latency(dropped):
    trial, recording = dropped
    time = np.arange(0.01, 6.0, 0.01)
    # A false alarm at 2 s that flickers above one half, and the true one 0.4 s after the drop.
    low = np.where((time > 2.0) & (time < 2.2), 0.95, 0.0)
    low[(time > 2.05) & (time < 2.1)] = 0.6
    low[time >= 3.4] = 0.99
    answer = answer_with(time, low)
    assert alarms_of(answer, recording, trial).onsets == pytest.approx((2.01, 3.4))
    said = score(recording, trial, {"adhesion": answer})
    assert said["adhesion.false_alarms"] == 1
    assert said["adhesion.watched"] == pytest.approx(2.0)
    assert said["adhesion.latency"] == pytest.approx(0.4)


def test_no_alarm_without_trust(dropped):
    trial, recording = dropped
    answer = replace(answer_with(np.arange(0.01, 6.0, 0.01), 0.99), identifiable=np.zeros(599, dtype=bool))
    assert alarms_of(answer, recording, trial).onsets == ()


def test_a_drop_that_nobody_announces_has_no_latency(dropped):
    trial, recording = dropped
    said = score(recording, trial, {"adhesion": answer_with(np.arange(0.01, 6.0, 0.01), 0.0)})
    assert said["adhesion.latency"] is None


def test_windows_do_not_lie_across_the_drop(dropped):
    trial, recording = dropped
    time = np.arange(0.01, 6.0, 0.01)
    windows = score(recording, trial, {"adhesion": answer_with(time, np.where(time > 3.0, 1.0, 0.0))})[
        "windows"
    ]
    assert windows["time"] == pytest.approx([2.0, 3.0, 4.0, 5.0, 6.0])
    assert windows["condition"] == [0, 0, 2, 2, 2]
    # The row that counts is the last one within the window: at the end of the second one nothing has dropped.
    assert windows["adhesion.condition"] == [0, 0, 2, 2, 2]
    assert [value is None for value in windows["adhesion.mu_max_high"]] == [False] * 4 + [True]
    assert windows["mu_max"][0] > 3.0 * windows["mu_max"][-1]


@pytest.fixture(scope="module")
def tables(dropped):
    trial, recording = dropped
    time = np.arange(0.01, 6.0, 0.01)
    study = parse(
        '[grid]\nutilisation = [0.7, 0.8]\n[fixed]\nmanoeuvre = "drop"\ncondition = "low"\nchange = 3.0\n'
        'duration = 6.0\n[variant]\n"as it is" = {}\n"heavy" = {mass = 1.1}\n',
        "t.toml",
    )
    cases, windows = [], []
    for case in study.cases():
        late = 3.2 if case.variant == "as it is" else 4.3
        answers = {
            "adhesion": answer_with(time, np.where(time > late, 0.97, 0.02)),
            "matched": answer_with(time, np.where(time > 3.05, 0.99, 0.01)),
        }
        said = score(recording, trial, answers)
        columns = said.pop("windows")
        cases.append(row(case, said))
        windows += [
            {"case": case.number, **{name: values[i] for name, values in columns.items()}} for i in range(5)
        ]
    cases.append(
        row(Case(number=4, values={"speed": 20.0}, seed=1), {}) | {"status": "failed", "reason": "why"}
    )
    return replace_banks(study), cases, windows


def row(case, said):
    return {
        "case": case.number,
        "variant": case.variant,
        "seed": case.seed,
        "status": "done",
        "reason": "",
        **case.values,
        **said,
    }


def replace_banks(study):
    return study.model_copy(update={"banks": ("adhesion", "matched")})


def test_findings_are_what_was_put_in(tables):
    study, cases, windows = tables
    findings = Findings(cases, windows, study.banks, tuple(study.variant))
    assert findings.accuracy("matched", "condition").value == 1.0
    assert findings.accuracy("adhesion", "condition").value == pytest.approx(18 / 20)
    assert findings.confusion("adhesion", "condition")[2].tolist() == [2, 0, 10, 0]
    assert findings.latency("adhesion").quantile(0.5) == pytest.approx(0.21)
    assert findings.latency("adhesion").quantile(0.95) == pytest.approx(1.31)
    assert findings.losses("adhesion", "condition")["heavy"][0] == pytest.approx(-0.2)
    assert findings.false_alarms("matched").events == 0
    assert [row["case"] for row in findings.failures] == [4]


def test_report_tells_failures_and_finds_its_numbers(tables):
    study, cases, windows = tables
    report = report_on(study, cases, windows)
    keys = [section.key for section in report.sections]
    assert keys == [
        "accuracy_condition",
        "confusion_condition",
        "calibration_condition",
        "adhesion",
        "latency",
        "false_alarms",
        "losses",
        "failures",
    ]
    assert any("1 of 5 cases failed" in text for text in report.summary)
    crossed = report.sections[0].tables[1]
    assert crossed.title == "Windows right by true condition and utilisation"
    assert [row[2:] for row in crossed.rows if row[1] == "matched"] == [("100\u00a0%",) * 2] * 2
    content = report.as_json()
    numbers = {section["key"]: section for section in content["sections"]}
    assert numbers["accuracy_condition"]["numbers"]["share_right"]["value"] == pytest.approx([18 / 20, 1.0])


def test_an_incomplete_study_has_a_report(tables):
    study, _, _ = tables
    assert [section.key for section in report_on(study, [], []).sections] == ["failures"]


def test_a_bank_that_trusts_nothing_is_not_left_out(tables):
    study, cases, windows = tables
    doubted = [row | {"matched.identifiable": False} for row in windows]
    adhesion, matched = report_on(study, cases, doubted).sections[0].words[:2]
    assert "The adhesion bank has the condition right in" in adhesion
    assert "and is right in" in adhesion
    assert matched.endswith("it trusts none of its answers.")
