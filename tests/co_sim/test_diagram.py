"""Layouts of block diagrams: nothing overlaps, every wire ends where it should, whatever the diagram."""

from itertools import combinations, pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from co_sim.diagram import Block, Diagram, Wire, layered
from co_sim.diagram.drawing import draw
from co_sim.diagram.placed import Extent, Geometry, placed

NAMES = "abcdefg"


@st.composite
def diagrams(draw):
    """Return blocks with at most one wire into each input, some of them connectors of the system."""
    n = draw(st.integers(1, 7))
    kinds = draw(st.lists(st.sampled_from(["component"] * 3 + ["input", "output"]), min_size=n, max_size=n))
    blocks, sources, targets = [], [], []
    for name, kind in zip(NAMES, kinds, strict=False):
        n_in, n_out = {"input": (0, 1), "output": (1, 0)}.get(
            kind, (draw(st.integers(0, 3)), draw(st.integers(0, 3)))
        )
        ins, outs = tuple(f"u{i}" for i in range(n_in)), tuple(f"a long output {i}" for i in range(n_out))
        blocks.append(Block(name, name, ins, outs, kind=kind))
        targets += [(name, port) for port in ins]
        sources += [(name, port) for port in outs]
    wires = [
        Wire(draw(st.sampled_from(sources)), target, draw(st.sampled_from(["", "m → mm"])))
        for target in targets
        if sources and draw(st.booleans())
    ]
    return Diagram("random", blocks, wires)


def inside(box, point):
    return (
        box.x + 0.1 < point[0] < box.x + box.width - 0.1 and box.y + 0.1 < point[1] < box.y + box.height - 0.1
    )


def passes(box, one, other):
    """Tell whether a horizontal or vertical line goes through a box."""
    steps = 200
    return any(
        inside(box, (one.x + (other.x - one.x) * i / steps, one.y + (other.y - one.y) * i / steps))
        for i in range(steps + 1)
    )


@settings(max_examples=80, deadline=None)
@given(diagrams())
def test_layers_leave_room_for_everything(diagram):
    picture = layered(diagram)
    boxes = {box.block.name: box for box in picture.boxes}
    assert set(boxes) == {block.name for block in diagram.blocks}
    for one, other in combinations(picture.boxes, 2):
        apart = (
            one.x + one.width <= other.x
            or other.x + other.width <= one.x
            or one.y + one.height <= other.y
            or other.y + other.height <= one.y
        )
        assert apart
    assert [line.wire for line in picture.lines] == list(diagram.wires)
    for line in picture.lines:
        assert line.points[0] == boxes[line.wire.source[0]].outputs[line.wire.source[1]]
        assert line.points[-1] == boxes[line.wire.target[0]].inputs[line.wire.target[1]]
        for one, other in pairwise(line.points):
            assert one.x == other.x or one.y == other.y
            assert not any(passes(box, one, other) for box in picture.boxes)
    places = [point for line in picture.lines for point in line.points]
    places += [(box.x, box.y) for box in picture.boxes]
    places += [(box.x + box.width, box.y + box.height) for box in picture.boxes]
    assert all(0 <= x <= picture.width and 0 <= y <= picture.height for x, y in places)


@settings(max_examples=80, deadline=None)
@given(diagrams())
def test_wires_from_different_outputs_never_run_upon_each_other(diagram):
    pieces = [
        (line.wire.source, one, other)
        for line in layered(diagram).lines
        for one, other in pairwise(line.points)
    ]
    # An input that several wires enter cannot be: what they share is their last piece.
    for (source, a, b), (rival, c, d) in combinations(pieces, 2):
        if source == rival:
            continue
        for along, across in ((0, 1), (1, 0)):
            if a[across] == b[across] == c[across] == d[across]:
                low = max(min(a[along], b[along]), min(c[along], d[along]))
                high = min(max(a[along], b[along]), max(c[along], d[along]))
                assert high - low < 1.0, (source, rival)


def test_a_chain_reads_from_left_to_right_in_one_line():
    blocks = [Block(name, name, ("u",), ("y",)) for name in NAMES]
    wires = [Wire((a, "y"), (b, "u")) for a, b in pairwise(NAMES)]
    picture = layered(Diagram("chain", blocks[::-1], wires))
    boxes = {box.block.name: box for box in picture.boxes}
    assert sorted(NAMES, key=lambda name: boxes[name].x) == list(NAMES)
    assert len({box.y for box in picture.boxes}) == 1
    assert all(len(line.points) == 2 for line in picture.lines)


def test_a_loop_has_one_wire_back():
    blocks = [Block(name, name, ("u",), ("y",)) for name in "ab"]
    picture = layered(Diagram("loop", blocks, [Wire(("a", "y"), ("b", "u")), Wire(("b", "y"), ("a", "u"))]))
    backwards = [line for line in picture.lines if line.points[0].x > line.points[-1].x]
    assert [line.wire.source[0] for line in backwards] == ["b"]


def test_coordinates_are_kept_with_flips_and_rotation():
    blocks = [Block(name, name, ("u",), ("y",)) for name in "abc"]
    wires = [Wire(("a", "y"), ("b", "u")), Wire(("b", "y"), ("c", "u"))]
    extents = {
        "a": Extent(0, 0, 20, 10),
        "b": Extent(60, 0, 40, 10),
        "c": Extent(80, 0, 100, 10, rotation=90.0),
    }
    geometry = Geometry(extents, ports={("a", "y"): (1.0, 0.5)}, corners={1: [(70.0, 30.0)]})
    picture = placed(Diagram("placed", blocks, wires), geometry)
    a, b, c = picture.boxes
    scale = a.width / 20.0
    assert b.x - a.x == pytest.approx(40.0 * scale)
    # The coordinates go up, the picture goes down.
    assert a.outputs["y"] == pytest.approx((a.x + a.width, a.y + a.height / 2.0))
    # Exchanged left and right: inputs on the right.
    assert b.inputs["u"].x == pytest.approx(b.x + b.width)
    assert b.outputs["y"].x == pytest.approx(b.x)
    # Turned left: inputs from below, and the box upright.
    assert (c.width, c.height) == pytest.approx((10.0 * scale, 20.0 * scale))
    assert c.inputs["u"].y == pytest.approx(c.y + c.height)
    corner = picture.lines[1].points[1]
    assert corner == pytest.approx((a.x + 70.0 * scale, a.y + (10.0 - 30.0) * scale))


@pytest.mark.parametrize(("ending", "magic"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_pictures_are_drawn_whatever_the_names(tmp_path, ending, magic):
    names = ("Rädsatz", "轮对", "$x^2$ \\frac", "a\x00b\nc", "n" * 300)
    blocks = [Block(name, name, ("u",), (name,), name, "missing") for name in names]
    wires = [Wire((a, a), (b, "u"), "$1") for a, b in pairwise(names)]
    path = tmp_path / f"d{ending}"
    draw([layered(Diagram("$", blocks, wires)), layered(Diagram("empty", [], []))], path)
    assert path.read_bytes().startswith(magic)
