"""Objects of other libraries against the equations, and there and back."""

import control
import numpy as np
import pytest
import scipy.signal

from piezoharvest import (
    Campaign,
    Digital,
    Mode,
    Network,
    ParameterError,
    Resistor,
    System,
    Transducer,
    TwoPort,
    admittance,
    frequency_response,
    linearize,
    linearize_shunt,
    response_record,
    shunt_from,
    to_frd,
    to_network,
    transducer_from,
    two_port_from,
    write_touchstone,
)
from piezoharvest.description.effects import Leakage
from piezoharvest.output import OutputError
from piezoharvest.readers.touchstone import Touchstone

MODE = Mode(mass=0.02, damping=0.4, stiffness=8e4, coupling=-7e-4)
PLAIN = Transducer(mass=0.010, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9)
TWO = Transducer(mass=0.010, damping=0.0628, stiffness=986.96, coupling=1e-3, capacitance=40e-9, modes=(MODE,))
SIX = Transducer(**{**vars(PLAIN), "modes": tuple(
    Mode(mass=0.01 / n, damping=0.02 * n, stiffness=986.96 * n**3, coupling=(-1) ** n * 1e-3) for n in range(2, 7)
)})  # fmt: skip
FREQUENCIES = np.linspace(10.0, 500.0, 40)
OMEGA = 2 * np.pi * FREQUENCIES


def assert_same(found, transducer, accuracy):
    """All values of the modes within 1e-6, the capacitance within an accuracy."""
    for wanted, mode in zip(transducer.all_modes, found.all_modes, strict=True):
        for name in ("mass", "damping", "stiffness", "coupling"):
            assert getattr(mode, name) == pytest.approx(getattr(wanted, name), rel=1e-6)
    assert found.capacitance == pytest.approx(transducer.capacitance, rel=accuracy)


class TestTransducer:
    @pytest.mark.parametrize("transducer", [PLAIN, TWO])
    def test_is_found_in_any_coordinates(self, transducer):
        plant = linearize(transducer)
        sizes = [1.0, *[300.0, 1.0] * len(transducer.modes), 300.0, 4e-5]  # of displacements, velocities and charge
        mixed = np.random.default_rng(1).normal(size=plant.A.shape)
        turned = control.similarity_transform(plant, mixed / sizes)
        unnamed = scipy.signal.StateSpace(turned.A, turned.B, turned.C[[0, 2]], turned.D[[0, 2]])
        for system in (plant, turned, unnamed):
            found = transducer_from(system)
            assert_same(found, transducer, 1e-9)

    @pytest.mark.parametrize("transducer", [PLAIN, TWO, SIX])
    def test_transfer_functions_are_realised(self, transducer):
        """Those of a state-space model, with a pole at zero in all and its zero in most; and by hand, without names."""
        plant = linearize(transducer)
        whole = control.tf(plant)
        bare = [
            [control.tf(*(part[row][column] for part in (whole.num, whole.den))) for column in (0, 1)] for row in (0, 2)
        ]
        for system in (whole, control.combine_tf(bare)):
            assert_same(transducer_from(system), transducer, 1e-6)

    def test_transfer_functions_written_by_hand_share_poles(self):
        """The open-circuit resonance is in all four, the capacitor's pole at zero in two; one has it twice."""
        short, coupling, capacitance = [PLAIN.mass, PLAIN.damping, PLAIN.stiffness], PLAIN.coupling, PLAIN.capacitance
        opened = [*short[:2], PLAIN.stiffness + coupling**2 / capacitance]
        repeated = np.polymul(opened, opened)
        system = control.tf(
            [[[1.0], [-coupling / capacitance]], [-coupling / capacitance * np.array(opened), -np.array(short)]],
            [[opened, [*opened, 0.0]], [repeated, [capacitance * x for x in (*opened, 0.0)]]],
        )
        assert_same(transducer_from(system), PLAIN, 1e-6)

    def test_the_velocity_may_be_among_the_outputs(self):
        plant = linearize(TWO)
        for order in ([0, 1, 2], [2, 0, 1], [1, 2, 0]):
            assert_same(
                transducer_from(scipy.signal.StateSpace(plant.A, plant.B, plant.C[order], plant.D[order])), TWO, 1e-6
            )

    @pytest.mark.parametrize(
        ("system", "words"),
        [
            (control.ss(-1, 1, -1, 0), r"found 1 input \(u\[0\]\), must be force and current by name"),
            (
                scipy.signal.StateSpace(-np.eye(3), np.eye(3)[:, :2], 2 * np.eye(3), np.zeros((3, 2))),
                "found 3 outputs, must be displacement and voltage by name, or .*, with or without the velocity",
            ),
            (control.ss(np.diag([-1.0, -2]), np.eye(2), np.eye(2), np.zeros((2, 2))), "no voltage that falls"),
            (control.ss(-np.eye(2), np.eye(2), np.eye(2), np.eye(2)), "feedthrough"),
            (control.ss(-np.eye(2), np.eye(2), np.eye(2), np.zeros((2, 2)), 0.1), "continuous time"),
            (np.eye(2), "must be a StateSpace of .* or a control.TransferFunction"),
            (control.tf([1], [1, 1]), "found 1 input"),
            (control.tf([[[1, 0, 0], [1]], [[1], [1]]], [[[1, 1]] * 2] * 2), "found more zeros than poles"),
            (control.tf([[[1], [1]], [[1], [1]]], [[[1, 2, 1]] * 2] * 2), "found a multiple pole"),
            (linearize(Transducer(**{**vars(PLAIN), "effects": (Leakage(resistance=1e6),)})), "no transducer"),
            (linearize(Transducer(**{**vars(PLAIN), "damping": 100.0})), "no resonance"),
        ],
    )
    def test_another_system_is_refused(self, system, words):
        with pytest.raises(ParameterError, match=words):
            transducer_from(system)


LADDERS = [
    "R1 1 2 5k\nL1 2 0 240",
    "L1 1 0 240\nR1 1 0 30k\nC1 1 0 20n",
    "L1 1 2 240\nC1 2 3 30n\nR1 3 0 4k\nR2 1 0 1meg",
    "R1 1 2 1k\nC1 2 0 1u\nL1 2 3 1\nR2 3 0 50\nC2 3 0 3u",
    "L1 1 2 100\nR1 2 0 8k\nC1 1 3 10n\nR2 3 0 200k\nL2 1 4 300\nR3 4 0 5k",  # a real pole of negative residue
    "R1 1 2 3k\nL1 2 0 50\nC1 2 0 40n\nR2 2 3 20k\nL2 3 0 20\nC2 3 0 10n",
    "L1 1 0 240\nL2 1 2 100\nC1 2 0 20n",  # without losses
]


class TestShunt:
    @pytest.mark.parametrize("netlist", LADDERS)
    def test_network_has_the_admittance(self, netlist):
        """Of a netlist with a capacitor at the leads by its transfer function, as it has no state-space model."""
        wanted = Network(netlist=netlist)
        if "C1 1 0" in netlist:
            system = control.tf([20e-9, 1 / 30e3, 1 / 240], [1.0, 0.0])
        else:
            system = linearize_shunt(wanted)
        transfer = control.tf(system)
        for form in (system, transfer, scipy.signal.TransferFunction(transfer.num[0][0], transfer.den[0][0])):
            found = shunt_from(form)
            assert isinstance(found, Network)
            np.testing.assert_allclose(admittance(found, FREQUENCIES), admittance(wanted, FREQUENCIES), rtol=1e-5)

    def test_where_parts_have_to_be_built_twice(self):
        """Biquadratic admittances whose conductance is least between the ends, and a sum of two of them."""
        first = control.tf([1.0, 1.0, 1.0], [1.0, 1.0, 4.0])
        for wanted in (first, 1 / first, first + control.tf([1.0, 2.0, 9.0], [1.0, 1.0, 2.0])):
            network = shunt_from(wanted)
            frequencies = np.geomspace(0.01, 10.0, 30)
            s = 2j * np.pi * frequencies
            np.testing.assert_allclose(admittance(network, frequencies), wanted(s), rtol=1e-6)
            assert all(element.value > 0 for element in network.netlist)

    def test_digital_has_the_filter(self):
        shunt = shunt_from(control.tf([1.0], [240.0, -5e3]), sample_time=1e-4, delay=2e-5)  # no passive one
        assert isinstance(shunt, Digital) and shunt.delay == 2e-5
        for numerator, denominator in (([1e-5, 2e-6], [1.0, -0.5]), ([1e-5], [1.0, -0.5, 0.2])):
            above, below = shunt_from(control.tf(numerator, denominator, 1e-3)).filter()
            frequencies = np.exp(1j * np.linspace(0.1, 3.0, 20))
            wanted = np.polyval(numerator, frequencies) / np.polyval(denominator, frequencies)
            np.testing.assert_allclose(
                np.polyval(above, frequencies) / np.polyval(below, frequencies), wanted, rtol=1e-9
            )

    @pytest.mark.parametrize(
        ("system", "words"),
        [
            (control.tf([-1.0], [1, 2]), "negative at 0 Hz; a digital shunt can have it"),
            (control.tf([1.0], [1, -2]), "not stable"),
            (control.tf([1.0], [1, 1, 100]), "negative at"),
            (control.tf([1.0, 0, 0], [1]), "grows faster than .*; a digital shunt cannot have it either"),
            (control.tf([1.0, 0, 0], [1e3, 1]), "negative towards high frequencies; a digital shunt cannot"),
            (control.tf([np.nan], [1, 1]), "found nan among its coefficients"),
            (control.tf([1.0], [1, 0, 1]), "without losses"),
            (control.tf([0.0], [1]), "open electrodes"),
            (control.tf([1.0], [1, 0.5], True), "without a sample time"),
            (linearize(PLAIN), "one of each"),
            (3.0, "found 3.0"),
        ],
    )
    def test_another_admittance_is_refused(self, system, words):
        with pytest.raises(ParameterError, match=words):
            shunt_from(system)
        with pytest.raises(ParameterError, match="needs a sample_time"):
            shunt_from(control.tf([1.0], [1, 2]), delay=1e-3)


class TestResponses:
    def test_two_port_there_and_back(self):
        two_port = TwoPort.of(TWO, FREQUENCIES)
        of_plant = control.frequency_response(linearize(TWO), OMEGA)
        np.testing.assert_allclose(two_port_from(of_plant).z, two_port.z, rtol=1e-9)
        still = of_plant[["displacement", "voltage"], ["force", "current"]]
        np.testing.assert_allclose(two_port_from(still).z, two_port.z, rtol=1e-9)
        own = to_frd(two_port)
        assert (own.input_labels, own.output_labels) == (["force", "current"], ["velocity", "voltage"])
        np.testing.assert_allclose(own.frdata, of_plant.frdata[1:], rtol=1e-9)
        with pytest.raises(ParameterError, match="force is needed"):
            two_port_from(control.FRD(np.ones((2, 2, 1)), [1.0]))

    def test_records(self):
        response = to_frd(frequency_response(System(PLAIN, Resistor(resistance=1e5)), FREQUENCIES))
        leads = control.FRD(TwoPort.of(PLAIN, FREQUENCIES).impedance(), OMEGA)
        records = [response_record(response["voltage", "force"], load_resistance=1e5),
                   response_record(leads, kind="impedance", mechanical="free")]  # fmt: skip
        campaign = Campaign.from_arrays(PLAIN, records)
        for record, wanted in zip(campaign.records, (response.frdata[2, 0], leads.frdata[0, 0]), strict=True):
            np.testing.assert_allclose(record.frequency, FREQUENCIES, rtol=1e-12)
            np.testing.assert_array_equal(record.response, wanted)
            np.testing.assert_array_equal(to_frd(record).frdata[0, 0], wanted)
        assert campaign.records[0].output == "voltage"
        with pytest.raises(ParameterError, match="one of each"):
            response_record(response)


class TestTouchstone:
    def test_is_what_others_read(self, tmp_path):
        skrf = pytest.importorskip("skrf", reason="scikit-rf is not installed")
        two_port = TwoPort.of(TWO, FREQUENCIES)
        write_touchstone(tmp_path / "two.s2p", FREQUENCIES, two_port.z, reference=1e3)
        found = skrf.Network(str(tmp_path / "two.s2p"))
        np.testing.assert_allclose(found.z, two_port.z, rtol=1e-7)  # of S, whose digits cancel
        np.testing.assert_allclose(two_port_from(to_network(two_port, reference=(1.0, 1e5))).z, two_port.z, rtol=1e-9)
        record = response_record(skrf.Network(f=FREQUENCIES, f_unit="hz", z=two_port.impedance(), z0=50))
        np.testing.assert_allclose(Campaign.from_arrays(TWO, [record]).records[0].response, two_port.impedance())

    def test_is_what_the_reader_reads(self, tmp_path):
        impedance = TwoPort.of(TWO, FREQUENCIES).impedance()
        write_touchstone(tmp_path / "leads.s1p", FREQUENCIES, impedance)
        found = Touchstone(tmp_path / "leads.s1p").read(("frequency_Hz", "impedance"))
        np.testing.assert_array_equal(found["frequency_Hz"], FREQUENCIES)
        np.testing.assert_allclose(found["impedance"], impedance, rtol=1e-9)

    def test_bad_input_leaves_no_file(self, tmp_path):
        for name, frequencies, impedance, error in (
            ("a.s1p", [1.0, 2.0], [1.0], ParameterError), ("a.s1p", [2.0, 1.0], [1.0, 1.0], ParameterError),
            ("a.s1p", [1.0], [np.nan], ParameterError), ("a.s2p", [1.0], [1.0], OutputError),
        ):  # fmt: skip
            with pytest.raises(error):
                write_touchstone(tmp_path / name, frequencies, impedance)
        assert not list(tmp_path.iterdir())
