"""The report: self-contained, well-formed, and saying what the numbers say."""

import base64
import html
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from co_sim.wheelset.figures import Drawing
from co_sim.wheelset.prose.departures import departures
from co_sim.wheelset.prose.findings import Outcome, find, place, valid_windows
from co_sim.wheelset.prose.setup import described
from co_sim.wheelset.prose.words import capital, listed, number, percent, quantity
from co_sim.wheelset.report import scenario_toml, write_report
from co_sim.wheelset.scenario import Scenario
from co_sim.wheelset.scenario_file import load_scenario, packaged_names, parse

LAW = settings(deadline=None, derandomize=True, max_examples=60)
SUMMARY = {"seed": 1, "versions": {"python": "3.11.2", "wheelset-cosim": "0.1.0", "numpy": "2.4.0"}}
DOT = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)


@pytest.fixture
def write(tmp_path):
    """Write the report of an experiment with one stand-in figure; return the page."""

    def write(experiment, summary=SUMMARY, caption="A caption."):
        file = tmp_path / "dot.png"
        file.write_bytes(DOT)
        write_report(
            experiment, [Drawing("dot", file, "Title", caption, "A dot.")], summary, tmp_path / "report.html"
        )
        return (tmp_path / "report.html").read_text(encoding="utf-8")

    return write


def text_of(page):
    """What a reader sees, white space and line breaks folded."""
    root = ET.fromstring(page.removeprefix("<!DOCTYPE html>"))
    body = root.find("body")
    return re.sub(r"\s+", " ", " ".join(body.itertext())).replace("\u00a0", " ")


def headed(experiment):
    return {d.heading.replace("\u00a0", " "): d.text.replace("\u00a0", " ") for d in departures(experiment)}


class Links(HTMLParser):
    """Collects everything a browser would fetch or run."""

    def __init__(self):
        super().__init__()
        self.found, self.tags = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.found += [v for k, v in attrs if k in {"src", "href", "srcset", "action", "data", "poster"}]


@pytest.mark.parametrize("name", ["paper", "drop"])
def test_page_is_well_formed_and_needs_nothing_else(name, write, request):
    page = write(request.getfixturevalue(name))
    assert page.startswith("<!DOCTYPE html>\n<html")
    ET.fromstring(page.removeprefix("<!DOCTYPE html>"))
    links = Links()
    links.feed(page)
    assert links.found == [f"data:image/png;base64,{base64.b64encode(DOT).decode()}"]
    assert not {"script", "link", "iframe", "object", "base"} & set(links.tags)
    assert not re.search(r"https?:|//[a-z]|url\(|@import", page)


def test_nothing_is_left_beside_the_page(write, paper, tmp_path):
    write(paper)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["dot.png", "report.html"]


def test_a_page_that_fails_leaves_the_old_one(write, paper, tmp_path):
    (tmp_path / "report.html").write_text("old")
    with pytest.raises(KeyError):
        write(paper, summary={"seed": 1})
    assert (tmp_path / "report.html").read_text() == "old"


def test_markup_in_names_is_text(write, workshop):
    evil = "<script>alert('x')</script> & \"quotes\""
    rail = "</pre><img src=x onerror=alert(1)>"
    shop = workshop(
        title=evil,
        conditions={rail: {"k_A": 1.0, "k_S": 0.4, "mu_0": 0.5, "A": 0.4, "B": 0.6}},
        rail=({"condition": rail},),
    )
    experiment = shop.experiment(shop.run("P1", (0.0, (0.4, 0.6, 0.7)), stopped="<b>bold</b>"))
    page = write(experiment, caption=f"{evil} of {rail}")
    links = Links()
    links.feed(page)
    assert len(links.found) == 1
    assert "script" not in links.tags
    assert "b" not in links.tags
    assert html.unescape(page).count(evil) >= 3
    assert evil in text_of(page)


def test_table_has_the_numbers_of_the_stretches(write, paper):
    text = text_of(write(paper))
    first, _, third = paper.stretches
    p = first.mean_probability_valid["dry-P1"]
    assert f"P1 dry 0–3 s dry-P1 1251 100 % {percent(p)}".replace("\u00a0", " ") in text
    assert f"P3 dry 0–3 s dry-P3 {third.valid_windows} " in text
    assert "with the windows beyond the range of the model 1251" in text


def test_page_tells_how_to_repeat_it(write, paper):
    text = text_of(write(paper))
    assert "wheelset run scenario.toml" in text
    assert "All random numbers follow from seed 1." in text
    assert "python 3.11.2, wheelset-cosim 0.1.0 and numpy 2.4.0" in text


def test_filters_are_listed_with_what_they_leave_out(write, paper):
    text = text_of(write(paper))
    assert re.search(r"dry-P2 dry 2\.48 0\.404 0 1\.29 .* track offset, displacement against the track", text)


def test_p1_is_identified_and_held_against_the_paper(paper):
    finding = find(paper)[0]
    assert finding.outcome is Outcome.IDENTIFIED
    assert finding.ranking[0] == "dry-P1"
    p = paper.stretches[0].mean_probability_valid["dry-P1"]
    assert percent(p) in finding.text
    mismatch = [h for h in headed(paper) if h.startswith("Run P1:")]
    assert bool(mismatch) == (abs(p - 0.9) >= 0.02)


def test_a_lower_probability_at_p1_is_said(workshop):
    shop = workshop()
    experiment = shop.experiment(shop.run("P1", (0.0, (0.555, 0.585, 0.59))))
    p = experiment.stretches[0].mean_probability_valid["dry-P1"]
    assert p < 0.85
    heading = f"Run P1: {percent(p)} instead of {percent(0.9)}".replace("\u00a0", " ")
    assert "The greatest output that these functions allow is 90 %." in headed(experiment)[heading]


def test_p2_is_undecided_for_want_of_signal(paper, write):
    finding = find(paper)[1]
    assert finding.outcome is Outcome.UNDECIDED
    assert set(finding.ranking[:2]) == {"dry-P1", "dry-P2"}
    assert finding.stretch.margin == pytest.approx(0.003 / 0.999 * 3**0.5, rel=0.1)
    (text,) = [t for h, t in headed(paper).items() if h.startswith("Run P2")]
    assert "signal-to-noise ratio (rms) is 0.004 at the gyro and 0.004 at the accelerometer" in text
    assert "the tangent g11 is zero" in text
    assert "invent a confidence" in text
    assert "invent a confidence" in text_of(write(paper))


def test_undecided_with_signal_blames_the_slopes_not_the_sensors(workshop):
    shop = workshop()
    experiment = shop.experiment(shop.run("P1", (0.0, (0.507, 0.51, 0.695)), amplitude=5.0))
    assert find(experiment)[0].outcome is Outcome.UNDECIDED
    (text,) = [t for h, t in headed(experiment).items() if ": no decision between" in h]
    assert "their own noise" not in text
    assert "invent a confidence" not in text
    assert "g11 is 4.76 and 0 MN" in text
    assert "little but steadily" in text


def test_undecided_without_order_says_so(workshop):
    shop = workshop()
    levels = [(0.1 * i, (0.5, 0.5 + 0.01 * (-1) ** (i // 8), 0.7)) for i in range(30)]
    told = headed(shop.experiment(shop.run("P1", *levels, amplitude=5.0)))
    (text,) = [t for h, t in told.items() if ": no decision between" in h]
    assert text.endswith("which comes first changes from window to window.")


def test_a_slope_that_varies_with_the_motion_is_said(workshop):
    shop = workshop()
    run = shop.run("P1", (0.0, (0.7, 0.3, 0.7)), amplitude=5.0)
    run.signals["plant.left.g11"][:] = 2e6 + 1e6 * (-1.0) ** np.arange(len(run.time))
    told = headed(shop.experiment(run))["Run P1, dry rail: taken for dry-P2"]
    assert "varies by 1 MN (rms) about 2 MN" in told


def test_p3_leaves_the_range_and_its_late_windows_do_not_count(paper, write):
    run, stretch = paper.runs[2], paper.stretches[2]
    counted = valid_windows(run, stretch, 0.5)
    assert counted.sum() == stretch.valid_windows < stretch.windows
    assert run.time[counted].max() <= 1.6
    text = headed(paper)["Run P3 leaves the range of the model"]
    assert text.startswith("At 1.6 s the wheelset is 8 mm off the track")
    assert "60 mm" in text
    assert f"{stretch.windows - stretch.valid_windows} of the {stretch.windows} windows" in text
    assert "Run P3 leaves the range of the model" in text_of(write(paper))
    assert "Run P1 leaves" not in text_of(write(paper))


def test_flanges_of_the_plant_are_said(paper, write):
    flanges = {"flange_stiffness": 1.5e7, "flange_clearance": 9e-3}
    wheelset = paper.scenario.wheelset.model_copy(update=flanges)
    guided = replace(paper, scenario=paper.scenario.model_copy(update={"wheelset": wheelset}))
    text = headed(guided)["Run P3 leaves the range of the model"]
    assert "The filters know no flange" in text
    assert "Its flanges touch the rails 9 mm off the track" in text_of(write(guided))
    for plain in (headed(paper)["Run P3 leaves the range of the model"], text_of(write(paper))):
        assert "The model has no flange" in plain


def test_misses_of_the_true_filter_are_said(paper):
    heading = "Run P3, dry rail: dry-P3 does not have the smallest residual throughout"
    share = 1.0 - paper.stretches[2].share_smallest_valid["dry-P3"]
    assert headed(paper)[heading].startswith(f"In {percent(share)} of the".replace("\u00a0", " "))
    assert not any(h.startswith("Run P1, ") for h in headed(paper))


def test_misses_at_the_start_are_put_down_to_the_growing_motion(workshop):
    shop = workshop()
    run = shop.run("P3", (0.0, (0.5, 0.51, 0.7)), (0.8, (0.7, 0.7, 0.12)), amplitude=300.0)
    for name in ("yaw_rate", "lateral_acceleration"):
        run.signals[f"plant.{name}"][run.time < 0.8] *= 1e-3
    text = headed(shop.experiment(run))[
        "Run P3, dry rail: dry-P3 does not have the smallest residual throughout"
    ]
    assert "All of these windows end by 0.798 s" in text


def test_every_outcome_is_told(drop):
    outcomes = [finding.outcome for finding in find(drop)]
    assert outcomes == [Outcome.IDENTIFIED, Outcome.MISTAKEN, Outcome.UNKNOWN, Outcome.EMPTY]
    told = headed(drop)
    assert told["Wet rail, 0.8 to 1.6 s: taken for dry@0.05"].startswith("True is wet@0.05.")
    texts = [finding.text.replace("\u00a0", " ") for finding in find(drop)]
    assert texts[2].startswith("No filter of the bank is true here")
    assert "2.7 to 3 s, is shorter than one window of 0.5 s" in texts[3]


def test_missing_numbers_are_dashes_with_a_reason(drop, write):
    text = text_of(write(drop))
    assert re.search(r"torque driven low 2\.7–3 s low@0\.05 0 (– ){8}", text)
    assert "–: low rail, 2.7 to 3 s: The record of this stretch" in text
    assert "– under true:" in text


def test_windows_all_beyond_the_range_are_said(workshop, write):
    shop = workshop()
    experiment = shop.experiment(shop.run("P3", (0.0, (0.6, 0.6, 0.5)), valid_until=0.3))
    assert find(experiment)[0].outcome is Outcome.EMPTY
    assert "windows end after the wheelset has left the range of the model at 0.3 s" in text_of(
        write(experiment)
    )


def test_a_stopped_run_is_said_at_the_top(workshop, write):
    shop = workshop()
    run = shop.run(
        "P3", (0.0, (0.7, 0.7, 0.1)), until=1.2, stopped="plant stopped at t = 1.2 s (step 600): diverged"
    )
    text = text_of(write(shop.experiment(run)))
    assert text.index("Run P3 stopped early.") < text.index("Findings")
    assert text.count("plant stopped at t = 1.2 s (step 600): diverged") == 2
    assert "record up to 1.2 s" in text


def test_wheels_that_slip_are_said(workshop):
    shop = workshop(
        drive={"mode": "torque_driven"},
        identifier={
            "window": 0.5,
            "training": 3.0,
            "filters": ({"condition": "dry", "adhesion": 0.05}, {"condition": "dry", "point": "P3"}),
        },
    )
    run = shop.run("torque_driven", (0.0, (0.3, 0.9)))
    assert headed(shop.experiment(run)) == {}
    run.signals["plant.right.g11"][:] = -1e5
    text = headed(shop.experiment(run))["Dry rail: the wheels slip"]
    assert "negative at the right wheel, past the maximum" in text


def test_a_hopeless_filter_hides_no_decision(workshop):
    shop = workshop()
    experiment = shop.experiment(shop.run("P1", (0.0, (0.2, 0.24, 0.95)), amplitude=5.0))
    assert find(experiment)[0].outcome is Outcome.IDENTIFIED


def test_when_all_is_well_the_page_says_so(workshop, write):
    shop = workshop()
    experiment = shop.experiment(shop.run("P3", (0.0, (0.7, 0.7, 0.1)), amplitude=10.0))
    assert headed(experiment) == {}
    assert "Nothing beyond what the findings say." in text_of(write(experiment))


def test_short_training_is_explained(paper, write):
    short = replace(paper, filters=(*paper.filters[:2], replace(paper.filters[2], training=1.2)))
    assert "The training of dry-P3 is shorter than the 3 s asked for" in text_of(write(short))
    assert "shorter than the 3 s asked for" not in text_of(write(paper))


@pytest.mark.parametrize("name", packaged_names())
def test_packaged_scenarios_survive_the_echo(name):
    scenario, _ = load_scenario(name)
    assert parse(scenario_toml(scenario), "echo") == scenario


@LAW
@given(
    title=st.text(st.characters(exclude_categories=("Cs",)), max_size=30),
    name=st.text(st.characters(exclude_categories=("Cs",)), min_size=1, max_size=10),
    mu=st.floats(1e-3, 1.0),
    seed=st.integers(0, 2**62),
)
def test_any_scenario_survives_the_echo(title, name, mu, seed):
    condition = {"k_A": 1.0, "k_S": 0.4, "mu_0": mu, "A": 0.4, "B": 0.6}
    scenario = Scenario(
        title=title, seed=seed, conditions={name: condition}, rail=({"left": name, "right": "dry"},)
    )
    assert parse(scenario_toml(scenario), "echo") == scenario


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"drive": {"mode": "free_rolling"}}, "Free rolling at 20 m/s (72 km/h)"),
        (
            {"drive": {"mode": "torque_driven", "times": (0.0, 2.0), "torque": (0.0, 3500.0)}},
            "0 N m at 0 s and 3500 N m at 2 s, linear in between",
        ),
        ({"drive": {"mode": "prescribed_creep", "points": ("P3",)}}, "one run at P3 (4.97 % creep)."),
        ({"rail": ({"left": "dry", "right": "wet"},)}, "dry on the left and wet on the right throughout."),
        (
            {"rail": ({"condition": "dry"}, {"since": 1.0, "condition": "low"})},
            "dry from 0 s; low from 1 s.",
        ),
        ({"track": {"file": "site.csv"}}, "Measured lateral alignment from site.csv"),
        (
            {"sensors": {"gyro": {"noise_rms": 2e-3, "bias": 1e-3, "bandwidth_hz": 50.0, "rate_hz": 250.0}}},
            "2 mrad/s rms in each sample, bias 1 mrad/s, bandwidth 50 Hz, 250 samples a second.",
        ),
        ({}, "Innovations of the lateral acceleration in a moving window of 0.5 s"),
    ],
)
def test_the_scenario_in_words(tables, words, workshop):
    shop = workshop(**tables)
    mode = shop.scenario.drive.mode
    name = "P3" if mode == "prescribed_creep" else mode
    experiment = shop.experiment(shop.run(name, (0.0, (0.5, 0.6, 0.7))))
    assert words in " ".join(text for _, text in described(experiment)).replace("\u00a0", " ")


def test_places_name_what_tells_stretches_apart(paper, drop):
    assert place(paper, paper.stretches[0]) == "run P1, dry rail"
    assert place(drop, drop.stretches[1]).replace("\u00a0", " ") == "wet rail, 0.8 to 1.6 s"


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 3, "0"),
        (0.00436, 2, "0.0044"),
        (450.83, 2, "450"),
        (9.996, 3, "10"),
        (-1.25, 3, "−1.25"),
        (2.119e-7, 3, "2.12·10⁻⁷"),
        (8.2e10, 2, "8.2·10¹⁰"),
        (float("inf"), 3, "inf"),
    ],
)
def test_numbers_are_written_with_significant_digits(value, digits, text):
    assert number(value, digits) == text


@LAW
@given(st.floats(1e-12, 1e12), st.integers(1, 6))
def test_a_written_number_reads_back_within_its_digits(value, digits):
    text = number(value, digits).translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")).replace("·10", "e")
    assert float(text) == pytest.approx(value, rel=0.5000001 * 10.0 ** (1 - digits))


@LAW
@given(st.floats(0.0, 1.0))
def test_only_all_is_100_percent(share):
    text = percent(share)
    assert (text == "100\u00a0%") == (round(share, 12) == 1.0)
    assert (text == "0\u00a0%") == (round(share, 12) == 0.0)


def test_words():
    assert listed([]) == ""
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"]) == "a, b and c"
    assert capital("") == ""
    assert quantity(3500.0, "N m") == "3500\u00a0N\u00a0m"
