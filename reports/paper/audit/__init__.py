"""Where the printed numbers contradict each other, physics or Table V: one function for each claim."""

from __future__ import annotations

from reports.paper.audit import conclusions, energy, printing, transducer
from reports.paper.audit.finding import Finding

CHECKS = (
    energy.electrical_mean_above_peak,
    energy.mechanical_mean_above_peak,
    energy.sums_over_a_record,
    energy.steps_against_time_constant,
    energy.steps_against_stroke,
    energy.mechanical_energy_is_gross,
    energy.step_peak_is_the_machines,
    transducer.stiffness_agrees,
    transducer.voltage_beyond_open_circuit,
    transducer.hysteresis_against_scaling,
    transducer.loss_beside_the_load,
    transducer.displacement_is_not_the_specimens,
    transducer.load_of_the_sines,
    transducer.force_at_middle_level,
    transducer.converter_range,
    conclusions.efficiency_of_the_tables,
    conclusions.power_for_small_electronics,
    conclusions.load_is_not_tuned_to_a_resonance,
    conclusions.loop_depends_on_rate,
    conclusions.cost_function_mixes_units,
    conclusions.damping_cannot_be_identified,
    printing.header_of_table_iii,
    printing.units_of_stiffness_and_coupling,
    printing.units_of_hysteresis,
    printing.labels_and_levels,
    printing.digits_of_table_ii,
    conclusions.sign_and_equation_numbers,
)


def audit() -> list[Finding]:
    """All findings, those that weigh most first."""
    return [check() for check in CHECKS]
