"""Transducer from the material constants of equation 10 of the paper, and the best conversion of a material.

S = s T + d E, D = d T + eps E (strain, stress, electrical displacement, field; s at constant field, eps at constant
stress): IEEE Std 176-1987.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from piezoharvest.description.figures.material import conversion, stack_values
from piezoharvest.description.transducer import Transducer
from piezoharvest.linear.assembly import require_positive


def material_coupling(d: float, s: float, epsilon: float) -> float:
    """Coupling k^2 = d^2/(s eps) of a material (IEEE Std 176-1987).

    Parameters
    ----------
    d : float
        Piezoelectric charge constant, C/N = m/V.
    s : float
        Elastic compliance at constant field, m^2/N.
    epsilon : float
        Permittivity at constant stress, F/m (absolute, not relative).

    Raises
    ------
    ParameterError
        s or epsilon is not positive, or k^2 is not below 1, which no stable material can have.
    """
    require_positive("s", s, "m^2/N")
    require_positive("epsilon", epsilon, "F/m")
    return conversion(d, s, epsilon)


def static_matrix(d: float, s: float, epsilon: float) -> np.ndarray:
    """Matrix [[s, d], [d, eps]] of equation 10, from (stress, field) to (strain, electrical displacement).

    Parameters and errors as in `material_coupling`.

    Returns
    -------
    (2, 2) array
    """
    material_coupling(d, s, epsilon)
    return np.array([[s, d], [d, epsilon]])


def from_material(
    d: float,
    s: float,
    epsilon: float,
    *,
    area: float,
    thickness: float,
    layers: int = 1,
    mass: float,
    damping: float = 0.0,
    **others: Any,
) -> Transducer:
    """Transducer of a stack in its 33 mode from equation 10: layers mechanically in series, electrically in parallel.

    With n layers of area A and thickness t, k = A/(s n t), T = d A/(s t) and the clamped C = n A eps (1 - k33^2)/t,
    where k33^2 = d^2/(s eps): q = n A D, x = n t S, force and field uniform (frequencies far below the stack's own
    waves).

    Parameters
    ----------
    d, s, epsilon : float
        Charge constant (C/N), compliance at constant field (m^2/N), absolute permittivity at constant stress (F/m).
    area : float
        Electrode area of a layer, m^2.
    thickness : float
        Of one layer, m; the stack is layers * thickness long.
    layers : int
    mass, damping : float
        Lumped mass (kg) and viscous damping (N s/m), which do not follow from the material.
    **others
        Further fields of `Transducer`: hysteresis, modes, effects, name, ...

    Raises
    ------
    ParameterError
        A value is not positive or k33^2 is not below 1.
    """
    material_coupling(d, s, epsilon)  # the constants are allowed
    require_positive("area", area, "m^2")
    require_positive("thickness", thickness, "m")
    require_positive("layers", layers, "layers")
    stiffness, coupling, capacitance = stack_values(d, s, epsilon, area=area, thickness=thickness, layers=layers)
    return Transducer(
        mass=mass, damping=damping, stiffness=stiffness, coupling=coupling, capacitance=capacitance, **others
    )


def transmission_coefficient(coupling_squared: float) -> float:
    """Energy transmission k^2/(4 - 2 k^2) of a material with the load that extracts the most energy.

    Under a static stress T the field -e of the load extracts e D/2 and the stress supplies T S/2. The output is
    greatest at e = d T/(2 eps); the result is output/input there. Called the transmission coefficient of a harvester by
    Roundy (J. Intell. Mater. Syst. Struct. 16(10), 809-823, 2005; from memory of the paper, the formula derived here).

    Parameters
    ----------
    coupling_squared : float
        Material k^2 = d^2/(s eps), from 0 to 1.

    See Also
    --------
    maximum_transmission_coefficient : Load for the best ratio instead of the most output; slightly higher.
    """
    return coupling_squared / (4 - 2 * coupling_squared)


def maximum_transmission_coefficient(coupling_squared: float) -> float:
    """Greatest energy transmission with any load, (1/k - sqrt(1/k^2 - 1))^2 = (2 - k^2 - 2 sqrt(1 - k^2))/k^2.

    The maximum over the load field e of e D/(T S), at e = (T d/(eps k^2)) (1 - sqrt(1 - k^2)); between k^2/4 and k^2/2
    for usual materials (Wang, Du, Xu, Zhang & Cross, IEEE Trans. UFFC 46(3), 638-646, 1999). It is a ratio of energies
    in one quasi-static stroke; the rest stays stored and is not lost, so that it is no bound on the efficiency
    P_out/P_in of equation 13.

    Parameters
    ----------
    coupling_squared : float
        Material k^2 = d^2/(s eps), from 0 to 1.
    """
    # (1 - sqrt(1 - k^2))^2/k^2, free of the cancellation at small k.
    return coupling_squared / (1 + np.sqrt(1 - coupling_squared)) ** 2
