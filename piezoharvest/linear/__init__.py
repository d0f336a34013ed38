"""The linear view: two-ports, state-space systems, frequency responses, resonances and poles."""

from piezoharvest.linear.assembly import LinearModel, assemble, hysteresis_slope
from piezoharvest.linear.circuits import admittance
from piezoharvest.linear.material import (
    from_material,
    material_coupling,
    maximum_transmission_coefficient,
    static_matrix,
    transmission_coefficient,
)
from piezoharvest.linear.modal import CouplingFactors, Resonance, Resonances, coupling_factor, resonances
from piezoharvest.linear.noise import MeanSquares, white_noise_response
from piezoharvest.linear.response import FrequencyResponse, frequency_response
from piezoharvest.linear.sampled import SampledLoop, anticipating, sampled_loop, stability_limit
from piezoharvest.linear.stability import check_stability, poles
from piezoharvest.linear.statespace import closed_loop, linearize, linearize_shunt
from piezoharvest.linear.twoport import TwoPort, conversion_efficiency, parallel_element, series_element

__all__ = [
    "CouplingFactors",
    "FrequencyResponse",
    "LinearModel",
    "MeanSquares",
    "Resonance",
    "Resonances",
    "SampledLoop",
    "TwoPort",
    "admittance",
    "anticipating",
    "assemble",
    "check_stability",
    "closed_loop",
    "conversion_efficiency",
    "coupling_factor",
    "frequency_response",
    "from_material",
    "hysteresis_slope",
    "linearize",
    "linearize_shunt",
    "material_coupling",
    "maximum_transmission_coefficient",
    "parallel_element",
    "poles",
    "resonances",
    "sampled_loop",
    "series_element",
    "stability_limit",
    "static_matrix",
    "transmission_coefficient",
    "white_noise_response",
]
