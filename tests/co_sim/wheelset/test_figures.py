"""Figures: which there are, that nothing in them is cut off or overlaps, and that their data are kept."""

import itertools
import re
import struct
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from co_sim.wheelset import figures
from co_sim.wheelset.drawing import filters as filter_figures
from co_sim.wheelset.drawing.creep import draw_creep_curve
from co_sim.wheelset.drawing.filters import draw_probabilities, draw_residuals
from co_sim.wheelset.drawing.fuzzy import draw_membership, draw_output, draw_system
from co_sim.wheelset.drawing.motion import draw_motion
from co_sim.wheelset.drawing.sheet import STYLE, Sheet, colour, envelope, shorten, spread, thin
from co_sim.wheelset.figures import draw
from co_sim.wheelset.scenario import Scenario

LAW = settings(deadline=None, derandomize=True, max_examples=60)

PAPER = [
    "fig2_creep_curve",
    "fig5_residuals_P1",
    "fig6_residuals_P2",
    "fig7_residuals_P3",
    "probabilities_P1",
    "probabilities_P2",
    "probabilities_P3",
    "motion_P1",
    "motion_P2",
    "motion_P3",
    "fig8_fuzzy_system",
    "membership_functions",
    "fig9_output_membership",
]
DROP = [
    "fig2_creep_curve",
    "residuals_torque_driven",
    "probabilities_torque_driven",
    "motion_torque_driven",
    "fig8_fuzzy_system",
    "membership_functions",
    "fig9_output_membership",
]


def extent(text):
    """Extent of the words alone, without an annotation's line."""
    return mpl.text.Text.get_window_extent(text)


def shown(figure):
    """Everything written on a figure; tick labels only where their tick lies on the axis."""
    ticks = set()
    for axis in (axis for ax in figure.axes for axis in (ax.xaxis, ax.yaxis)):
        low, high = sorted(axis.get_view_interval())
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
            if not low <= tick.get_loc() <= high:
                ticks |= {tick.label1, tick.label2}
    return [
        t
        for t in figure.findobj(mpl.text.Text)
        if t.get_visible() and t.get_text().strip() and t not in ticks
    ]


@pytest.mark.parametrize(("experiment", "expected"), [("paper", PAPER), ("drop", DROP)])
def test_draw_writes_the_figures_of_the_case(experiment, expected, request, tmp_path):
    drawings = draw(request.getfixturevalue(experiment), tmp_path)
    assert [d.key for d in drawings] == expected
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(f"{key}.png" for key in expected)
    for drawing in drawings:
        data = drawing.file.read_bytes()
        width, height = struct.unpack(">II", data[16:24])
        assert data[:8] == b"\x89PNG\r\n\x1a\n"
        assert width == 1230
        assert 400 < height < 1200
        assert drawing.title
        assert drawing.alt
        assert drawing.caption.endswith((".", ". "))


def test_drawing_leaves_the_settings_of_matplotlib_alone(drop, tmp_path):
    before = dict(mpl.rcParams)
    draw(drop, tmp_path)
    assert dict(mpl.rcParams) == before


def test_a_figure_that_fails_leaves_no_file(drop, tmp_path, monkeypatch):
    def fail(figure, path, **_):
        path.write_bytes(b"half a picture")
        raise OSError("disk full")

    monkeypatch.setattr(mpl.figure.Figure, "savefig", fail)
    with pytest.raises(OSError, match="disk full"):
        draw(drop, tmp_path)
    assert list(tmp_path.iterdir()) == []


def long_bank(workshop):
    """Twelve filters with long names, rails that are short, and dollar signs in a name."""
    names = [f"contaminated$rail${i}" for i in range(12)]
    shop = workshop(
        conditions={
            n: {"k_A": 1.0, "k_S": 0.4, "mu_0": 0.5 - 0.02 * i, "A": 0.4, "B": 0.6}
            for i, n in enumerate(names)
        },
        drive={"mode": "torque_driven", "speed": 20.0},
        rail=tuple({"since": 0.25 * i, "condition": n} for i, n in enumerate(names)),
        identifier={
            "window": 0.1,
            "training": 3.0,
            "filters": tuple({"condition": n, "point": "P1"} for n in names),
        },
    )
    level = (0.0, tuple(np.linspace(0.2, 0.3, 12)))
    return shop.experiment(shop.run("torque_driven", level, valid_until=2.8))


@pytest.fixture(scope="module", params=["paper", "drop", "long_bank"])
def laid_out(request, workshop):
    """All figures of an experiment by key, laid out but not written."""
    made = long_bank(workshop) if request.param == "long_bank" else request.getfixturevalue(request.param)
    with mpl.rc_context(STYLE):
        drawn = {key: picture.sheet.figure for key, picture in figures._pictures(made)}
        for figure in drawn.values():
            figure.canvas.draw()
    return drawn


def test_no_word_is_cut_off(laid_out):
    for key, figure in laid_out.items():
        for text in shown(figure):
            box = extent(text)
            inside = box.x0 >= 0 and box.y0 >= 0 and box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1
            assert inside, f"{key}: {text} at {box} leaves {figure.bbox}"


def test_titles_keys_and_names_of_lines_do_not_overlap(laid_out):
    for key, figure in laid_out.items():
        beside = [
            t for ax in figure.axes for t in ax.texts if getattr(t, "arrowprops", None) and t.get_text()
        ]
        boxes = [extent(t) for t in (*figure.texts, *beside)]
        boxes += [legend.get_window_extent() for legend in figure.legends]
        boxes += [ax.xaxis.label.get_window_extent() for ax in figure.axes if ax.get_xlabel()]
        for one, other in itertools.combinations(boxes, 2):
            assert not (one.padded(-1).overlaps(other.padded(-1))), f"{key}: {one} and {other}"


def test_a_filter_has_one_colour_everywhere(paper):
    run = paper.runs[0]
    for picture in (draw_residuals(paper, run), draw_probabilities(paper, run)):
        lines = picture.sheet.figure.axes[-1].lines
        assert [line.get_color() for line in lines[:3]] == [colour(i) for i in range(3)]
    points = draw_creep_curve(paper).sheet.figure.axes[0].lines
    assert [p.get_color() for p in points if p.get_label().startswith("dry-")] == [
        colour(i) for i in range(3)
    ]


def test_creep_curve_marks_the_filters_where_they_are(paper):
    ax = draw_creep_curve(paper).sheet.figure.axes[0]
    marks = [line for line in ax.lines if line.get_label().startswith("dry-")]
    for mark, design in zip(marks, paper.filters, strict=True):
        (creep,), (adhesion,) = mark.get_data()
        assert creep == pytest.approx(100 * design.point.creep)
        assert adhesion == pytest.approx(design.point.force / 79.7e3)
    assert "0.404 at 2.48" in draw_creep_curve(paper).caption


def test_a_rail_whose_force_only_grows_has_no_maximum(workshop):
    shop = workshop(
        conditions={"rubber": {"k_A": 1.0, "k_S": 1.0, "mu_0": 0.3, "A": 1.0, "B": 0.0}},
        drive={"mode": "torque_driven"},
        rail=({"condition": "dry"}, {"since": 1.0, "condition": "rubber"}),
    )
    experiment = shop.experiment(shop.run("torque_driven", (0.0, (0.5, 0.6, 0.7))))
    assert "rubber none below full slip" in draw_creep_curve(experiment).caption


def test_the_level_of_equally_good_filters_is_drawn(paper, drop):
    for experiment in (paper, drop):
        lines = draw_residuals(experiment, experiment.runs[0]).sheet.figure.axes[-1].lines
        levels = [
            line.get_ydata()[0]
            for line in lines
            if line.get_linestyle() == "--" and line.get_color() == "black"
        ]
        assert levels == [pytest.approx(1 / np.sqrt(3))]


def hatched(picture):
    return [p for ax in picture.sheet.figure.axes for p in ax.patches if p.get_hatch()]


def test_only_what_lies_beyond_the_range_is_hatched(paper):
    for run in paper.runs:
        for picture in (draw_residuals(paper, run), draw_probabilities(paper, run), draw_motion(paper, run)):
            spans = hatched(picture)
            texts = [t.get_text() for ax in picture.sheet.figure.axes for t in ax.texts]
            label = "beyond 8\u00a0mm: no flange in the model"
            assert texts.count(label) == (run.name == "P3")
            assert bool(spans) == (run.name == "P3")
            assert all(span.get_x() == 1.6 for span in spans)
            assert all(span.get_x() + span.get_width() == run.time[-1] for span in spans)


def test_hatching_says_who_has_no_flange(paper):
    guided = replace(paper, scenario=Scenario.model_validate({"wheelset": {"flange_stiffness": 1e7}}))
    texts = [t.get_text() for ax in draw_motion(guided, guided.runs[2]).sheet.figure.axes for t in ax.texts]
    assert "beyond 8\u00a0mm: no flange in the filters" in texts


def test_windows_that_fill_are_shaded_on_every_stretch(drop):
    ax = draw_residuals(drop, drop.runs[0]).sheet.figure.axes[-1]
    shaded = [(p.get_x(), p.get_width()) for p in ax.patches if not p.get_hatch()]
    assert shaded == [(s.since, pytest.approx(0.5)) for s in drop.stretches]


def test_ribbon_shows_the_true_filter(drop):
    true = filter_figures._expected(drop, drop.runs[0])
    time = drop.runs[0].time
    assert set(true[time < 0.8]) == {0}
    assert set(true[(time >= 0.8) & (time < 1.6)]) == {1}
    assert set(true[(time >= 1.6) & (time < 2.7)]) == {-1}
    assert set(true[time >= 2.7]) == {2}


def test_several_true_filters_take_turns(workshop):
    filters = ({"condition": "dry", "adhesion": 0.05}, {"condition": "dry", "adhesion": 0.06})
    shop = workshop(
        drive={"mode": "torque_driven"}, identifier={"window": 0.5, "training": 3.0, "filters": filters}
    )
    level = (0.0, (0.5, 0.8))
    experiment = shop.experiment(shop.run("torque_driven", level))
    true = filter_figures._expected(experiment, experiment.runs[0])
    assert np.mean(true) == pytest.approx(0.5, abs=0.02)
    assert set(true) == {0, 1}


def test_output_figure_shows_the_median_window(paper):
    picture = draw_output(paper)
    run = paper.runs[0]
    counted = run.time >= 0.5 - 1e-9
    shown = [100 * float(ax.lines[-1].get_xdata()[0]) / 100 for ax in picture.sheet.figure.axes]
    assert shown[0] == pytest.approx(100 * np.median(run.probabilities[counted, 0]), rel=1e-3)
    k = int(re.search(r"ends at ([\d.]+)", picture.caption)[1].replace(".", "").ljust(4, "0")) // 2
    assert shown == pytest.approx(100 * run.probabilities[k], abs=1e-9)


def test_no_output_figure_without_a_valid_window(workshop, tmp_path):
    shop = workshop()
    level = (0.0, (0.5, 0.6, 0.7))
    experiment = shop.experiment(shop.run("P3", level, valid_until=0.3))
    assert draw_output(experiment) is None
    assert [d.key for d in draw(experiment, tmp_path)] == [
        "fig2_creep_curve",
        "fig7_residuals_P3",
        "probabilities_P3",
        "motion_P3",
        "fig8_fuzzy_system",
        "membership_functions",
    ]


def test_system_shows_rules_in_words(paper, drop):
    for experiment in (paper, drop):
        picture = draw_system(experiment)
        texts = " ".join(t.get_text() for t in picture.sheet.figure.axes[0].texts).replace("\n", " ")
        assert f"{len(experiment.fuzzy.rules)} rules" in texts
        assert "if D1 is small then p1 is high" in texts


def test_system_of_many_filters_shows_the_first_two_and_the_last(workshop):
    picture = draw_system(long_bank(workshop))
    texts = [t.get_text() for t in picture.sheet.figure.axes[0].texts]
    assert [t for t in texts if re.fullmatch(r"D\d+", t)] == ["D1", "D2", "D12"]
    assert "⋮" in texts


def test_membership_functions_are_those_of_the_system(paper):
    axes = draw_membership(paper).sheet.figure.axes
    grid = np.linspace(0, 1, 301)
    for ax, variable in zip(axes, (paper.fuzzy.inputs[0], paper.fuzzy.outputs[0]), strict=True):
        for line, term in zip(ax.lines, variable.terms, strict=False):
            assert np.interp(grid, *line.get_data()) == pytest.approx(term.membership(grid), abs=1e-9)


@pytest.mark.parametrize("samples", [1, 2])
def test_a_run_that_stopped_at_once_is_drawn(samples, workshop, tmp_path):
    shop = workshop()
    level = (0.0, (0.5, 0.6, 0.7))
    run = shop.run("P1", level, until=(samples - 1) * 2e-3, stopped="plant stopped at t = 0 s")
    drawings = draw(shop.experiment(run), tmp_path)
    assert "stopped at 0" in next(d.title for d in drawings if d.key == "fig5_residuals_P1")


@LAW
@given(
    st.lists(st.floats(-0.5, 1.5), min_size=1, max_size=15),
    st.floats(0.001, 0.3),
)
def test_spread_keeps_order_and_distance(positions, gap):
    placed = spread(positions, gap, 0.0, 1.0)
    order = np.argsort(positions, kind="stable")
    room = 1.0 / max(len(positions) - 1, 1)
    assert np.all(np.diff(placed[order]) >= min(gap, room) - 1e-12)
    assert placed.min() >= -1e-12
    assert placed.max() <= 1.0 + 1e-12
    assert spread(placed, gap, 0.0, 1.0) == pytest.approx(placed, abs=1e-9)


@LAW
@given(st.lists(st.integers(0, 20), min_size=1, max_size=20, unique=True))
def test_spread_leaves_alone_what_has_room(places):
    positions = [place / 20 for place in places]
    assert spread(positions, 0.04, 0.0, 1.0) == pytest.approx(positions, abs=1e-12)


@LAW
@given(arrays(np.float64, st.integers(1, 400), elements=st.floats(-1e3, 1e3)), st.integers(1, 60))
def test_thinning_keeps_the_extremes_and_invents_nothing(x, bins):
    t = np.arange(len(x), dtype=float)
    kept_t, kept_x = thin(t, x, bins)
    assert np.all(np.diff(kept_t) > 0)
    assert np.array_equal(kept_x, x[kept_t.astype(int)])
    assert (kept_x.min(), kept_x.max()) == (x.min(), x.max())
    assert len(kept_t) <= max(2 * bins, len(t) if len(t) <= 2 * bins else 0)


@LAW
@given(arrays(np.float64, st.integers(1, 400), elements=st.floats(-1e3, 1e3)), st.integers(1, 60))
def test_envelope_holds_the_series(x, bins):
    t = np.arange(len(x), dtype=float)
    starts, least, greatest = envelope(t, x, bins)
    assert len(starts) <= bins
    which = np.searchsorted(starts, t, side="right") - 1
    assert np.all((least[which] <= x) & (x <= greatest[which]))
    assert (least.min(), greatest.max()) == (x.min(), x.max())


@LAW
@given(st.text(min_size=1, max_size=60), st.integers(3, 30))
def test_shorten_keeps_to_the_length(name, length):
    short = shorten(name, length)
    assert len(short) <= max(length, 3)
    assert (short == name) == (len(name) <= length)


def test_sheet_places_axes_in_inches():
    sheet = Sheet(8.0, 4.0, "title")
    box = sheet.axes(1.0, 0.5, 4.0, 2.0).get_position()
    assert box.bounds == pytest.approx((1 / 8, 0.5 / 4, 0.5, 0.5))
