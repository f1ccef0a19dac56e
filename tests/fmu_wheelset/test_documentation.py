"""What people and tools see of the FMU: its page, its icon and its terminals."""

from __future__ import annotations

import io
import zipfile
from html.parser import HTMLParser
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import matplotlib.image
import numpy as np
import pytest
from lxml import etree

from fmu_wheelset import build, documentation, icon, terminals
from fmu_wheelset.variables import REFERENCES, VARIABLES

if TYPE_CHECKING:
    from pathlib import Path

MODEL = (build.PACKAGE.parent / "docs" / "model.md").read_text(encoding="utf-8")
PAGE = documentation.index_html("The title", MODEL)


class Page(HTMLParser):
    """Text by tag; fails where tags do not close in order."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: dict[str, list[str]] = {}
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        if tag != "meta":
            self.open.append(tag)
            self.text.setdefault(tag, []).append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        for tag in set(self.open):
            self.text[tag][-1] += data


@pytest.mark.parametrize("fmi", [2, 3])
def test_archives_hold_page_and_picture(archives: dict[int, Path], fmi: int) -> None:
    with zipfile.ZipFile(archives[fmi]) as archive:
        assert archive.read("documentation/index.html").decode() == documentation.index_html(
            "Solid-axle wheelset with nonlinear creep forces", MODEL
        )
        assert archive.read({2: "model.png", 3: "terminalsAndIcons/icon.png"}[fmi]) == icon.png()
        assert ("terminalsAndIcons/icon.svg" in archive.namelist()) == (fmi == 3)


def test_page_lists_every_variable_and_the_equations() -> None:
    page = Page(PAGE)
    cells = page.text["td"]
    assert cells[1::8] == [v.name for v in VARIABLES]
    assert cells[7::8] == [v.description for v in VARIABLES]
    assert cells[cells.index("m_w") + 4] == "> 0"
    equations = "\n".join(page.text["pre"])
    assert "m_w y_ddot   = -f_yR - f_yL + F_c + F_susp" in equations
    assert "atan(k_S eps)" in equations


def test_nothing_of_the_markup_is_left_in_the_page() -> None:
    text = "".join(Page(PAGE).text["p"])
    assert not set("\\$`{}") & set(text)
    assert "**" not in text
    assert "λ" in text
    assert "ψ" in text


@pytest.mark.parametrize(
    ("markdown", "expected"),
    [
        (r"$\omega_L - v$", '<span class="math">ω<sub>L</sub> - v</span>'),
        (r"$L_g\dot\psi$", '<span class="math">L<sub>g</sub>ψ\u0307</span>'),
        (r"$\ddot y_{ab}^2$", '<span class="math">y\u0308<sub>ab</sub><sup>2</sup></span>'),
        (r"$\omega - v \pm (k\,x)$", '<span class="math">ω - v ± (k\u2009x)</span>'),
        ("**a** *b* `c*d*`", "<strong>a</strong> <em>b</em> <code>c*d*</code>"),
        ("1 < $e < f$", '1 &lt; <span class="math">e &lt; f</span>'),
    ],
)
def test_markup(markdown: str, expected: str) -> None:
    page = documentation.index_html("", f"## Plant\n\n{markdown}\n\n## Linear models\n")
    assert f"<p>{expected}</p>" in page


def test_unknown_formulas_and_headings_stop_the_build() -> None:
    with pytest.raises(ValueError, match=r"formula: got \\frac, expected one of .*add it to SYMBOLS"):
        documentation.index_html("", "## Plant\n$\\frac{a}{b}$\n## Linear models\n")
    with pytest.raises(ValueError, match="got no part from '## Plant' to '## Linear models'"):
        documentation.index_html("", "## Plants\n")


def test_terminals_follow_the_schema_and_name_variables(archives: dict[int, Path]) -> None:
    schemas = build.fmi_headers().parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"
    with zipfile.ZipFile(archives[3]) as archive:
        data = archive.read("terminalsAndIcons/terminalsAndIcons.xml")
    assert data.decode() == terminals.terminals_xml()
    etree.XMLSchema(file=str(schemas)).assertValid(etree.fromstring(data))
    for terminal in terminals.TERMINALS:
        assert {VARIABLES[REFERENCES[name]].causality for name in terminal.efforts.values()} == {"input"}
        assert {VARIABLES[REFERENCES[name]].causality for name in terminal.motions.values()} == {"output"}


def test_force_and_motion_of_a_terminal_multiply_to_power() -> None:
    """A force goes with a velocity and a moment with a rate: newtons times metres per second are watts."""
    unit = {v.name: v.unit for v in VARIABLES}
    suspension, drive = terminals.TERMINALS
    assert [unit[name] for name in suspension.efforts.values()] == ["N", "N.m"]
    assert [unit[name] for name in suspension.motions.values()] == ["m", "rad", "m/s", "rad/s"]
    assert [unit[name] for name in (*drive.efforts.values(), *drive.motions.values())] == ["N.m", "rad/s"]


def test_icon_is_a_symmetric_wheelset_on_nothing() -> None:
    image = matplotlib.image.imread(io.BytesIO(icon.png(64)), format="png")
    assert image.shape == (64, 64, 4)
    assert np.abs(image - image[:, ::-1]).max() <= 1.01 / 255
    alpha = image[..., 3]
    assert not alpha[0].any()
    assert alpha[32, 3:61].min() > 0.5  # the axle goes through from side to side
    assert alpha[10, 32] == 0.0
    area = 0.0
    for _, points in icon._shapes():
        x, y = np.array(points).T / 100 * 64
        area += abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2
    # The shapes lie side by side; where smooth edges meet, a little shines through.
    assert alpha.sum() == pytest.approx(area, rel=0.02)


def test_both_icons_show_the_same_shapes() -> None:
    polygons = ET.fromstring(icon.svg())
    assert len(polygons) == 2 * len(icon.HALF)
    assert polygons.get("viewBox") == "0 0 100 100"
