import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from co_sim import InputError, Recorder, Signal
from co_sim.observers import Selection

SIGNALS = [
    Signal(name, "1")
    for name in ("plant.x[1,1]", "plant.x[1,2]", "plant.x[2,1]", "plant.x11", "plant.v", "sensor.v", "plan.v")
]
SIZES = st.lists(st.integers(1, 7), min_size=1, max_size=6)


def chosen(patterns):
    return [signal.name for signal in Selection(patterns).window(SIGNALS).signals]


@pytest.mark.parametrize(
    ("patterns", "names"),
    [
        ("plant.v", ["plant.v"]),
        ("plan?.v", ["plant.v"]),
        ("*.v", ["plant.v", "sensor.v", "plan.v"]),
        ("????.v", ["plan.v"]),
        (["plant.x[1,*]"], ["plant.x[1,1]", "plant.x[1,2]"]),
        (["plant.x[1,2]"], ["plant.x[1,2]"]),
        (["plant.*", "!plant.x[*"], ["plant.x11", "plant.v"]),
        (["!plant.*"], ["sensor.v", "plan.v"]),
        (["!*.v", "plant.v", "plant.x11"], ["plant.x11"]),
        (["sensor.v", "plant.v"], ["plant.v", "sensor.v"]),
        ([], []),
    ],
)
def test_patterns(patterns, names):
    assert chosen(patterns) == names


def test_all_patterns_without_a_match_are_told_with_what_was_meant():
    with pytest.raises(InputError) as caught:
        chosen(["plnt.*", "plant.v", "!sensr.v"])
    first, second = caught.value.faults
    assert first.what == 'pattern "plnt.*"'
    assert first.remedy == 'did you mean "plant.*"?'
    assert second.remedy == 'did you mean "sensor.v"?'


@pytest.mark.parametrize("every", [0, -1, 1.5, "2"])
def test_every_is_a_whole_number(every):
    with pytest.raises(InputError, match="every: got"):
        Recorder(every=every)


@given(
    sizes=SIZES,
    every=st.integers(1, 12),
    n=st.integers(1, 40),
    patterns=st.sampled_from(["*", "plant.*", "*.v", "!plant.x11", ()]),
)
@settings(deadline=None)
def test_the_cut_into_blocks_never_changes_what_is_taken(drive, sizes, every, n, patterns):
    values = np.random.default_rng(n).standard_normal((n, len(SIGNALS)))
    cut, whole = Recorder(patterns, every), Recorder()
    drive([cut, whole], SIGNALS, values, t0=-3.0, sizes=sizes)
    np.testing.assert_array_equal(whole.table, values)
    np.testing.assert_array_equal(cut.time, (-3.0 + 0.5 * np.arange(n))[::every])
    columns = [whole.names.index(name) for name in cut.names]
    np.testing.assert_array_equal(cut.table, values[::every, columns])
