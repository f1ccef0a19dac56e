"""What is written is valid, gives the same run, and opens elsewhere."""

import pickle
import zipfile

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssd
from pyssp_standard.ssp import SSP

from co_sim import (
    Connection,
    Constant,
    Coupling,
    ExchangeFmu,
    FmuComponent,
    InputError,
    Master,
    Port,
    Recorder,
    System,
)
from co_sim.ssp import read_ssp, schema_faults, write_ssp
from co_sim.units import Unit
from fmu_wheelset import path as wheelset

VERSIONS = ["1.0", "2.0"]


def rows(system, duration):
    recorder = Recorder()
    with Master(system, observers=[recorder]) as master:
        master.run(duration)
    return {signal.name: recorder[signal.name] for signal in system.signals}


def two_wheelsets(**others):
    """Two wheelsets, of which the second is pushed by what the first does."""
    creep = {"drive_mode": "prescribed_creep", "initial_creepage": 1e-3, "prescribed_creepage": 1e-3}
    parts = {
        "front.one": FmuComponent(wheelset(fmi=2), parameters=creep | {"lateral_displacement": 3e-3}),
        "bogie/rear": FmuComponent(
            wheelset(fmi=3),
            inputs=["suspension_lateral_force", "prescribed_creepage", "track_lateral_offset"],
            outputs=["yaw_rate", "lateral_displacement", "m_w"],
            parameters=creep,
        ),
        "slow": ExchangeFmu(
            wheelset(fmi=3),
            inputs=["suspension_yaw_moment", "prescribed_creepage", "normal_load_left"],
            outputs=["yaw_angle"],
            parameters=creep,
            substep=2.5e-4,
            method="midpoint",
        ),
    }
    parts = {name.replace(".", "%2E"): part for name, part in parts.items()}
    front = "front%2Eone"
    wires = [
        Connection(f"{front}.lateral_displacement", "bogie/rear.track_lateral_offset", -0.1, 1e-4 / 3),
        Connection(
            f"{front}.lateral_velocity", "bogie/rear.suspension_lateral_force", 1e4 / 3, convert_units=False
        ),
        Connection(f"{front}.yaw_angle", "slow.suspension_yaw_moment", 1e5, 3.0, convert_units=False),
    ]
    settings = {
        "parameters": {"bogie/rear.m_w": 1300.1, "slow.normal_load_left": 75000.0},
        "step": 1e-3,
        "rates": {"slow": 2},
        "coupling": Coupling("gauss-seidel", order=1),
    }
    return System(parts, wires, **(settings | others))


@pytest.mark.parametrize("version", VERSIONS)
def test_what_is_read_again_gives_the_same_run(tmp_path, version):
    system, path = two_wheelsets(), tmp_path / "two wheelsets.ssp"
    write_ssp(system, path, version=version, start_time=0.0, stop_time=0.3)
    assert schema_faults(path) == []
    again = read_ssp(path)
    assert list(again.components) == list(system.components)
    assert again.connections == system.connections
    assert (again.step, again.rates, again.coupling) == (system.step, system.rates, system.coupling)
    assert again.signals == system.signals
    first, second = rows(system, 0.3), rows(again, 0.3)
    assert first.keys() == second.keys()
    for name, values in first.items():
        assert np.array_equal(values, second[name]), name
    assert np.ptp(first["slow.yaw_angle"]) > 1e-5


@pytest.mark.parametrize("version", VERSIONS)
def test_the_same_system_makes_the_same_bytes(tmp_path, version):
    files = [tmp_path / "a" / "x.ssp", tmp_path / "b" / "x.ssp"]
    systems = [two_wheelsets(), None]
    for i, file in enumerate(files):
        file.parent.mkdir()
        write_ssp(systems[i] or read_ssp(files[0]), file, version=version)
    documents = [zipfile.ZipFile(file).read("SystemStructure.ssd") for file in files]
    assert documents[0] == documents[1]
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.parametrize("version", VERSIONS)
def test_every_type_of_parameter(tmp_path, parrot, lag_fmu, version):
    values = {
        "float64_in": 0.1,
        "int32_in": -7,
        "boolean_in": False,
        "enumeration_in": 1,
        "string_in": 'a\n<&" b',
    }
    lag = {"T": 1 / 3, "trouble": 0, "negative": True, "label": "", "trouble_step": -1}
    system = System(
        {"p": FmuComponent(parrot, parameters=values), "l": FmuComponent(lag_fmu, parameters=lag)},
        [Connection("p.float64_out", "l.u", convert_units=False), Connection("p.int32_out", "p.int32_in")],
        coupling=Coupling(loops="solve"),
        step=0.5,
    )
    path = tmp_path / "types.ssp"
    write_ssp(system, path, version=version)
    assert schema_faults(path) == []
    again = read_ssp(path)
    assert again.connections == system.connections
    assert again.components["l"].parameters == lag | {"trouble": "ok"}
    assert again.components["p"].parameters == values | {"enumeration_in": "red"}
    assert again.components["p"].inputs == system.components["p"].inputs


def test_arrays_need_ssp_2(tmp_path, parrots):
    def part():
        values = {"texts_in": ["a", "b c"], "gains": [[1.0, 2.0], [3.0, 4.5]], "int64_in": 2**40, "n": 3}
        return FmuComponent(parrots[3], parameters=values | {"v_in": [7, 8, 9]})

    wires = [
        Connection("a.a_out", "b.a_in", convert_units=False),
        Connection("a.v_out[2]", "b.int32_in"),
        Connection("a.int32_out", "b.v_in[1]"),
    ]
    system, path = System({"a": part(), "b": part()}, wires, step=0.5), tmp_path / "arrays.ssp"
    write_ssp(system, path, version="2.0")
    assert schema_faults(path) == []
    again = read_ssp(path)
    assert again.connections == system.connections
    assert again.components["a"].parameters == part().parameters
    assert again.components["a"].outputs == part().outputs
    first, second = rows(system, 2.0), rows(again, 2.0)
    assert all(np.array_equal(first[name], second[name]) for name in first)
    with pytest.raises(InputError) as caught:
        write_ssp(system, tmp_path / "none.ssp")
    told = str(caught.value)
    for expected in (
        "a.a_out: got an array",
        "a.gains: got an array",
        "a.int64_in: got the whole number 10995",
    ):
        assert expected in told
    assert not (tmp_path / "none.ssp").exists()


def test_what_cannot_be_written(tmp_path, lag_fmus):
    parts = {
        "source": Constant([1.0], [Port("y", "V")]),
        "lag": FmuComponent(lag_fmus[2], outputs=["T"]),
        "other": FmuComponent(lag_fmus[3]),
    }
    wires = [Connection("source.y", "lag.u"), Connection("lag.T", "other.u", convert_units=False)]
    with pytest.raises(InputError) as caught:
        write_ssp(System(parts, wires), tmp_path / "none.ssp")
    told = str(caught.value).splitlines()
    assert told[0].startswith('component "source": got a Constant, expected an FMU')
    assert "a connection from a variable with causality parameter" in told[1]
    with pytest.raises(InputError, match="unknown input"):
        write_ssp(System(parts, [Connection("source.y", "lag.v")]), tmp_path / "none.ssp")
    with pytest.raises(InputError, match="version"):
        write_ssp(System(parts, wires), tmp_path / "none.ssp", version="3.0")


@pytest.mark.parametrize("version", VERSIONS)
def test_units_of_its_own(tmp_path, parrots, version):
    ell = Unit(m=1, factor=0.1 + 0.2, offset=1 / 3)
    parts = {
        name: FmuComponent(parrots[2], inputs=["float64_in"], outputs=["float64_out"], units=units)
        for name, units in {
            "a": {"float64_out": ("ell", ell)},
            "b": {"float64_in": ("m", None), "float64_out": ("notch", None)},
        }.items()
    }
    system = System(parts, [Connection("a.float64_out", "b.float64_in", 2.0, 1.0)], step=0.5)
    path = tmp_path / "units.ssp"
    write_ssp(system, path, version=version)
    assert schema_faults(path) == []
    again = read_ssp(path)
    assert again.connections == system.connections
    assert again.links() == system.links()
    assert again.components["a"].outputs == parts["a"].outputs


def test_fmpy_reads_and_runs_it(tmp_path, lag_fmus):
    """Of the tools that install with pip, fmpy runs SSP 1.0; it exchanges values after each step as we do."""
    outputs = ["x"]
    parts = {
        "a": FmuComponent(lag_fmus[2], inputs=[], outputs=outputs),
        "b": FmuComponent(lag_fmus[2], outputs=outputs),
        "c": FmuComponent(lag_fmus[2], outputs=outputs),
    }
    wires = [Connection("a.x", "b.u"), Connection("b.x", "c.u")]
    path = tmp_path / "chain.ssp"
    write_ssp(System(parts, wires, step=0.25), path)
    assert [element.name for element in read_ssd(path, validate=True).system.elements] == ["a", "b", "c"]
    theirs = simulate_ssp(str(path), stop_time=2.0, step_size=0.25)
    ours = rows(read_ssp(path), 2.0)
    for name in ("a", "b", "c"):
        np.testing.assert_allclose(theirs[f"{name}.x"], ours[f"{name}.x"][1:], rtol=1e-14)


def test_the_schema_finds_what_is_wrong(tmp_path, lag_fmus):
    path = tmp_path / "x.ssp"
    write_ssp(System({"a": FmuComponent(lag_fmus[2], parameters={"T": 2.0})}), path)
    with zipfile.ZipFile(path) as archive:
        document = archive.read("SystemStructure.ssd")
    for old, new in ((b'kind="output"', b'kind="sideways"'), (b'value="2.0"', b'value="two"')):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("SystemStructure.ssd", document.replace(old, new))
        (first, *_) = schema_faults(path)
        assert first.what.startswith("x.ssp/SystemStructure.ssd, line ")
        assert new.split(b'"')[1].decode() in first.got


@pytest.mark.parametrize("version", VERSIONS)
def test_units_lose_no_digits(tmp_path, parrots, version):
    """A revolution has 400 gon, but of the factors to rad none can be written exactly."""
    parts = {
        "a": FmuComponent(
            parrots[2], inputs=[], outputs=["float64_out"], units={"float64_out": ("rev", None)}
        ),
        "b": FmuComponent(parrots[2], inputs=["float64_in"], outputs=[], units={"float64_in": ("gon", None)}),
    }
    system = System(parts, [Connection("a.float64_out", "b.float64_in", 3.0)])
    write_ssp(system, tmp_path / "x.ssp", version=version)
    assert read_ssp(tmp_path / "x.ssp").links() == system.links()


def test_a_system_that_was_read_goes_to_another_process(tmp_path, lag_fmus):
    write_ssp(System({"a": FmuComponent(lag_fmus[2])}, step=0.5), tmp_path / "x.ssp")
    found = read_ssp(tmp_path / "x.ssp")
    copied = pickle.loads(pickle.dumps(dict(found.components)))
    recorder = Recorder()
    with Master(System(copied, step=0.5), observers=[recorder]) as master:
        master.run(1.0)
    del copied
    assert found.components["a"].path.exists()


@pytest.mark.parametrize("version", VERSIONS)
def test_tolerances_are_kept_unless_the_reader_asks_for_others(tmp_path, version):
    parts = {
        "own": FmuComponent(wheelset(fmi=2), tolerance=1e-7),
        "integrated": ExchangeFmu(wheelset(fmi=3), tolerance=1e-5),
        "none": FmuComponent(wheelset(fmi=3)),
    }
    path = tmp_path / "t.ssp"
    write_ssp(System(parts, step=1e-3), path, version=version)
    assert schema_faults(path) == []
    found = read_ssp(path).components
    assert [part.tolerance for part in found.values()] == [1e-7, 1e-5, None]
    assert {part.tolerance for part in read_ssp(path, tolerance=1e-4).components.values()} == {1e-4}


@pytest.mark.parametrize("version", VERSIONS)
def test_pyssp_standard_opens_it_and_finds_it_valid(tmp_path, version):
    """An independent reader of SSP 1.0 and 2.0, with the schemas in XML Schema 1.1, whose rules say more."""
    parts = {
        name: FmuComponent(wheelset(fmi=3), outputs=["yaw_rate"], parameters={"m_w": mass})
        for name, mass in (("front", 1300.0), ("rear", 1400.0))
    }
    wire = Connection("front.yaw_rate", "rear.suspension_yaw_moment", convert_units=False)
    path = tmp_path / "two.ssp"
    write_ssp(System(parts, [wire], step=1e-3), path, version=version, start_time=0.5, stop_time=2.0)
    with SSP(path, mode="r") as package, package.system_structure as found:
        found.__check_compliance__()
        assert (found.version, found.name) == (version, "two")
        assert (found.default_experiment.start_time, found.default_experiment.stop_time) == (0.5, 2.0)
        assert [(part.name, part.source) for part in found.system.elements] == [
            (name, "resources/wheelset_fmi3.fmu") for name in parts
        ]
        (connection,) = found.connections()
        assert (connection.start_element, connection.start_connector) == ("front", "yaw_rate")
        assert (connection.end_element, connection.end_connector) == ("rear", "suspension_yaw_moment")
        bound = [part.parameter_bindings[0].ssv.parameters[0] for part in found.system.elements]
        assert [one["name"] for one in bound] == ["m_w", "m_w"]
        assert [float(one["type_value"].parameter["value"]) for one in bound] == [1300.0, 1400.0]
