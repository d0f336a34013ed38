"""Arguments of the compiled propagation: what belongs together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Variables of `StepMemory.slopes`: an element's previous output; value and rate of its first input, at both ends of the
# step, and what outputs of elements add to its coefficients; of its second one; its limit.
BEFORE, FIRST, FIRST_END, FIRST_ADDED, SECOND, SECOND_END, SECOND_ADDED, BY_LIMIT, SLOPES = 0, 1, 3, 5, 7, 9, 11, 13, 14


class StepDrive(NamedTuple):
    """The drive in a block of steps.

    Attributes
    ----------
    coefficients : (steps, 4) array
        Polynomial coefficients in powers of the share of a step.
    begin : float
        Time at which the first step begins, as fraction of the record.
    every : int
        Steps between two samples that are written.
    lane : int
        The first of two parameters that the drive depends on.
    rise : (steps, 2) array, or (0, 2)
        Derivatives of the drive with respect to these.
    """

    coefficients: np.ndarray
    begin: float
    every: int
    lane: int
    rise: np.ndarray


class StepMatrices(NamedTuple):
    """Matrices of a step, arranged by the order of their use.

    Attributes
    ----------
    h : float
        s between samples.
    share : float
        Step as fraction of the record.
    held : bool
        Stops keep their outputs.
    M, H : arrays
        As in `SampleStep`.
    inputs, outputs : arrays
        Rows of O for the elements' inputs (and their rates), without the influence of the elements' outputs, and for
        the outputs. Rows of what outputs over the step add to the coefficients of s and s^2 of those inputs that they
        reach directly come behind the rates, for all s and then for all s^2.
    feed : (inputs, 3 elements) array
        Influence of `StepMemory.outputs` on the elements' inputs at the end of the step.
    implicit, explicit : arrays of int
        Inputs that outputs over the step reach, rows of `feed`, and the others, which are known beforehand.
    feeds : (elements,) array of bool
        The output over the step reaches inputs: it has to be found together with them.
    """

    h: float
    share: float
    held: bool
    M: np.ndarray
    H: np.ndarray
    inputs: np.ndarray
    outputs: np.ndarray
    feed: np.ndarray
    implicit: np.ndarray
    explicit: np.ndarray
    feeds: np.ndarray


class Sparse(NamedTuple):
    """Nonzero entries of a matrix.

    Attributes
    ----------
    values, columns : (rows, columns) array
        Those of each row one after the other, the rest being unused, and their columns.
    counts : (rows,) array
        Their number.
    """

    values: np.ndarray
    columns: np.ndarray
    counts: np.ndarray


class Tangent(NamedTuple):
    """Derivatives of a matrix.

    Attributes
    ----------
    values : (columns, entries) array
        Column by column, only for those pairs of a row and a parameter with nonzero ones: with many effects these are
        few.
    places : (entries, 2) array
        Row and parameter of each entry.
    sums : (entries,) array
        Memory for the derivatives of the product with a vector.
    """

    values: np.ndarray
    places: np.ndarray
    sums: np.ndarray


class ElementSlopes(NamedTuple):
    """What derivatives are propagated by.

    Attributes
    ----------
    M, H, O : Tangent
        Derivatives of the matrices.
    input_entries : int
        Entries of O that are those of inputs.
    limits : (elements, lanes) array
        Derivatives of the elements' limits.
    from_states : Sparse
        M for states and outputs of the elements.
    from_elements : Sparse
        H.
    to_inputs, to_outputs : Sparse
        O for states and outputs of the elements; for the inputs with `StepMatrices.feed`, of outputs over the step.
    added : Tangent
        Rows of O for inputs that outputs reach directly, and columns of these outputs.
    before_added : Sparse
        Influence of the outputs at the beginning of the step on what they add to the coefficients.
    """

    M: Tangent
    H: Tangent
    O: Tangent  # noqa: E741
    input_entries: int
    limits: np.ndarray
    from_states: Sparse
    from_elements: Sparse
    to_inputs: Sparse
    to_outputs: Sparse
    added: Tangent
    before_added: Sparse


class Elements(NamedTuple):
    """Elements of a specimen.

    Attributes
    ----------
    kinds, places
        As in `Matrices`.
    limits : (elements,) array
        Thresholds of stops, exponents of powers, knots of hinges.
    acts : (elements,) array of bool
        The output acts on states or on inputs of elements: its course within a step matters.
    rated : (distinct inputs,) array of bool
        As in `Matrices`.
    added : (distinct inputs,) array
        Row of what the outputs over a step add to the input's coefficient of s, as in `StepMatrices`; -1 if they do
        not reach it directly.
    reached : int
        Inputs that outputs reach directly: what they add to the coefficient of s^2 is so many rows behind.
    """

    kinds: np.ndarray
    places: np.ndarray
    limits: np.ndarray
    acts: np.ndarray
    rated: np.ndarray
    added: np.ndarray
    reached: int


class PropagatedState(NamedTuple):
    """Moving state of a propagation.

    Attributes
    ----------
    y : (n + elements + 4,) array
        States, outputs of the elements, drive, its rate, 1 and time.
    inputs : (inputs,) array
        Inputs of the elements, then their rates, and what is added to coefficients of some.
    d, dinputs : (n + 3 elements, lanes), (inputs, lanes) array
        Derivatives of states and of `StepMemory.outputs`, and of the elements' inputs.
    local : (elements, 2) array
        Sum over the steps of the elements' slopes with respect to their inputs.
    sizes : (inputs,) array
        Largest inputs and rates so far, the scale of rounding.
    """

    y: np.ndarray
    inputs: np.ndarray
    d: np.ndarray
    dinputs: np.ndarray
    local: np.ndarray
    sizes: np.ndarray


class StepMemory(NamedTuple):
    """Memory for what is used within a step.

    Attributes
    ----------
    g : (n + elements + 6,) array
        Vector multiplied by M.
    z, dz : (n,), (n, lanes) array
        States at the end of the step, and their derivatives.
    base, old, before : arrays
        Inputs without the contribution of the elements' outputs; inputs and outputs at the previous sample.
    trial, residual, move : arrays
        Inputs in Newton's method, their residuals and their last change.
    outputs : (3 elements,) array
        Outputs over the step: at its end, then the coefficients of s (1 - s) and of s^2 (1 - s), s being the share of
        the step, by which they differ from straight lines.
    slopes : (3, elements, SLOPES) array
        Derivatives of these.
    off : (elements,) array of bool
        Hinges below their knots throughout the step: outputs and slopes are zero.
    rises : (2, elements) array
        By what the outputs over the step are multiplied with for the coefficients of s, and s^2, beside the rates.
    first, second : (4,) array
        Coefficients of the inputs of an element in powers of s.
    inside, by_base, moments, corners : arrays
        For one element, as in `element_output` and `within_step`.
    J : (inputs, inputs + 1) array
        Matrix of the equations to be solved, a row for each implicit input, then the largest magnitude in each row.
    right : (inputs, lanes) array
        Their right-hand side.
    """

    g: np.ndarray
    z: np.ndarray
    dz: np.ndarray
    base: np.ndarray
    old: np.ndarray
    before: np.ndarray
    trial: np.ndarray
    residual: np.ndarray
    move: np.ndarray
    outputs: np.ndarray
    slopes: np.ndarray
    off: np.ndarray
    rises: np.ndarray
    first: np.ndarray
    second: np.ndarray
    inside: np.ndarray
    by_base: np.ndarray
    moments: np.ndarray
    corners: np.ndarray
    J: np.ndarray
    right: np.ndarray
