import numpy as np
import pytest

from co_sim import InputError, Recorder, Signal
from co_sim.texts import number_of

SIGNALS = [
    Signal("a.x", "m"),
    Signal("a.f", "1", kind="float32"),
    Signal("a.n", "1", kind="int32"),
    Signal("a.u", "1", kind="uint64"),
    Signal("a.on", "1", kind="boolean"),
    Signal("a.mode", "1", kind="enumeration"),
    Signal("a.text", "1", kind="string"),
]


def rows():
    return [
        [np.nan, 0.5, -3, 2**53, 1, 2, number_of("off")],
        [np.inf, 0.1, 7, 0, 0, 1, number_of("go, now")],
        [-0.0, -2.0, 0, 1, 1, 2, number_of("off")],
    ]


def test_values_come_back_as_what_they_are(drive):
    recorder = Recorder()
    drive([recorder], SIGNALS, rows())
    expected = {
        "a.x": np.array([np.nan, np.inf, -0.0]),
        "a.f": np.array([0.5, 0.1, -2.0], dtype=np.float32),
        "a.n": np.array([-3, 7, 0], dtype=np.int32),
        "a.u": np.array([2**53, 0, 1], dtype=np.uint64),
        "a.on": np.array([True, False, True]),
        "a.mode": np.array([2, 1, 2], dtype=np.int64),
        "a.text": np.array(["off", "go, now", "off"], dtype=object),
    }
    for name, values in expected.items():
        assert recorder.typed(name).dtype == values.dtype
        np.testing.assert_array_equal(recorder.typed(name), values)
    assert recorder["a.n"].dtype == np.float64
    assert recorder["a.text"].tolist() == ["off", "go, now", "off"]
    assert recorder.kinds == tuple(signal.kind for signal in SIGNALS)


@pytest.mark.parametrize("value", [0.5, np.nan, np.inf, 2.0**40])
def test_a_whole_number_that_is_none_is_not_rounded(drive, value):
    recorder = Recorder("a.n")
    drive([recorder], SIGNALS[2:3], [[1.0], [value]])
    with pytest.raises(ValueError, match="is no value of kind int32"):
        recorder.typed("a.n")
    np.testing.assert_array_equal(recorder["a.n"], [1.0, value])


def test_a_run_that_stops_early_keeps_its_rows(drive):
    recorder = Recorder(every=2)
    drive([recorder], SIGNALS[:1], np.arange(5.0)[:, None], n_steps=1000, sizes=(3,), error=RuntimeError())
    assert recorder["a.x"].tolist() == [0.0, 2.0, 4.0]


def test_a_record_beyond_memory_is_refused_and_leaves_the_last_one(drive):
    recorder = Recorder()
    drive([recorder], SIGNALS[:1], [[1.0], [2.0]])
    with pytest.raises(InputError, match="got 1000000000000001 values, 8e"):
        recorder.begin(tuple(SIGNALS[:1]), 0.0, 1e-3, 10**15)
    assert recorder["a.x"].tolist() == [1.0, 2.0]
