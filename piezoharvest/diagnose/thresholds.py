"""Thresholds that decide a verdict: each with its value, what it decides, where it comes from, and how steady that is.

A threshold is a number with which a statistic is compared. Definitions of a statistic (the bands of a test) and limits
of effort (iterations, fits a stage) stay where they are used. Limits of identification are in `identify`.
"""

from __future__ import annotations

from typing import Self

from piezoharvest.identify import identifiability

Steady = tuple[float, float]


class Threshold(float):
    """A number with which a statistic is compared.

    Attributes
    ----------
    decides : str
    source : str
        Theory, a publication, or a choice with its reason.
    steady : (float, float) or None
        Factors on the value between which the share of right answers on held-out campaigns stays the same, as far as
        tried: 0.7 to 1.3 (`python -m reports.diagnosis --held-out`). None where it was not measured.
    """

    decides: str
    source: str
    steady: Steady | None

    def __new__(cls, value: float, *, decides: str, source: str, steady: Steady | None = None) -> Self:
        """Make a threshold."""
        made = super().__new__(cls, value)
        made.decides, made.source, made.steady = decides, source, steady
        return made


# Residual tests.
TEST_LEVEL = Threshold(
    1e-5,
    decides="which residual tests fail: their p-value times the number of tests is below it",
    source="theory: Bonferroni; the level of one false alarm in 10^5 models, as rounded noise is not quite normal",
    steady=(0.7, 1.3),
)
MIN_LINES = Threshold(
    20,
    decides="lines of a spectrum from which on it is tested for lines, bursts and correlation",
    source="choice: the normal approximation of these tests needs some twenty values",
    steady=(0.7, 1.3),
)
SLOW_LINES = Threshold(
    15,
    decides="number of a line in a block's spectrum from which on rounding at a constant load is noise, and lines are "
    "tested one by one; lower ones are tested by bands alone",
    source="theory: a constant error of half the noise is sqrt(N) / (2 pi m) of it in line m: one at 16, of 10^4",
    steady=(0.7, 1.3),
)
MAX_CONSTANT_STEP = Threshold(
    1e-5,
    decides="motion a sample, of its range, below which a drive is constant",
    source="choice: one range in ten times a usual record",
    steady=(0.7, 1.3),
)
MIN_CONSTANT_SHARE = Threshold(
    0.3,
    decides="share of the samples with a constant drive from which on slow bands of rounded channels are not tested",
    source="choice: less lets rounding errors average out over the rest",
    steady=(0.7, 1.3),
)
MIN_ROUNDING_ERROR = Threshold(
    0.01,
    decides="rounding error, of the noise, from which on a channel counts as rounded",
    source="theory: a hundredth of the noise, constant over 10^4 samples, is one standard error of their mean",
    steady=(0.7, 1.3),
)
MIN_SINE_SHARE = Threshold(
    0.9,
    decides="share of its power in one line from which on a drive is one sine, whose harmonics are tested",
    source="choice: a multisine of equal amplitudes has at most a half",
    steady=(0.7, 1.3),
)

# The search: which effects are fitted, added, exchanged and removed.
SEARCH_LEVEL = Threshold(
    1e-4,
    decides="p-value, corrected for the number of starts, below which an effect is added or stays",
    source="theory: Bonferroni; one false alarm in 10^4 healthy campaigns",
    steady=(0.7, 1.3),
)
PRELIMINARY_LEVEL_FACTOR = Threshold(
    30.0,
    decides="times the level: p-value of a score below which an effect with more parameters is fitted",
    source="theory: a time constant between two starts gains up to half more: fifteen to sixty times the p-value",
    steady=(0.7, 1.3),
)
MIN_RELATIVE_SCORE = Threshold(
    0.15,
    decides="score, of the best, from which on an effect is fitted",
    source="choice: to be the best, a full fit would have to gain seven times its score",
    steady=(0.7, 1.3),
)
MAX_EFFECTS = Threshold(
    3,
    decides="effects after which the search ends",
    source="choice: a campaign of some ten records hardly tells larger sets apart",
    steady=(0.7, 1.3),
)
MIN_SHARE_OF_INITIAL = Threshold(
    0.05,
    decides="gain, of the initial excess over noise, from which on an effect counts",
    source="choice: of what no effect explains, any effect takes a few per cent",
    steady=(0.7, 1.3),
)
MIN_SHARE_OF_PRESENT = Threshold(
    0.5,
    decides="gain, of the present excess over noise, from which on an effect counts although it is less than the above",
    source="choice: the larger part of what there is",
    steady=(0.7, 1.3),
)
MIN_UNDOUBTED_GAIN = Threshold(
    100.0,
    decides="gain in -2 ln L, and Wald statistic, up to which the fit without an effect may be in a false minimum",
    source="theory: ten standard errors",
    steady=(0.7, 1.3),
)
MIN_IMPROVEMENT = Threshold(
    1.0,
    decides="decrease of -2 ln L by which another minimum, or another effect in a place, has to be better",
    source="theory: one standard error, and twice the tolerance of a trial fit",
    steady=(0.7, 1.3),
)
MIN_EXCHANGE_SCORE = Threshold(
    0.8,
    decides="score, of the gain of an effect, from which on another is fitted in its place",
    source="choice: a score falls short of its fit's gain by less where the two are alike",
    steady=(0.7, 1.3),
)
CLOSE_COST = Threshold(
    6.0,
    decides="difference of -2 ln L below which sets of effects are alike (`ambiguous`), and aim of a fit beside others",
    source="theory: odds of exp(3), twenty to one (Kass & Raftery, J. Am. Stat. Assoc. 90, 773-795, 1995)",
    steady=(0.7, 1.3),
)
INDISPENSABLE_GAIN = Threshold(
    1e4,
    decides="rise of -2 ln L above which an effect is indispensable, however an unfinished fit without it would end",
    source="choice: a hundred standard errors",
    steady=(0.7, 1.3),
)
MIN_STANDARD_ERRORS = Threshold(
    2.0,
    decides="strength, in its standard errors, below which an effect is removed at the end",
    source="theory: 95 % of a normal distribution",
    steady=(0.7, 1.3),
)
OUTSTANDING_SHARE = Threshold(
    0.3,
    decides="excess, of the largest of all residual tests, from which on a test has to be explained",
    source="choice: smaller ones may be the trace of the largest",
    steady=(0.7, 1.3),
)
UNEXPLAINED_SHARE = Threshold(
    0.5,
    decides="share of its excess that a residual test keeps from which on it is not explained, and the search ends",
    source="choice: the larger part",
    steady=(0.7, 1.3),
)

# Parameters far from their nominal values.
MIN_DEVIATION = Threshold(
    0.4,
    decides="logarithm of the ratio to the nominal value from which on a parameter may compensate for a missing effect",
    source="choice: a factor of 1.5; nominal values of a data sheet are within a third",
    steady=(0.7, 1.3),
)
MIN_DEVIATION_GAIN = Threshold(
    10.0,
    decides="decrease of -2 ln L by such parameters from which on they are said to deviate",
    source="theory: three standard errors",
    steady=(0.7, 1.3),
)
MAX_DEVIATION = Threshold(
    5.0,
    decides="ratio to the nominal value, or its inverse, beyond which a parameter compensates for something missing",
    source="choice: no data sheet is off by so much",
    steady=(0.7, 1.3),
)
MAX_RELATIVE_ERROR = Threshold(
    identifiability.MAX_RELATIVE_ERROR,
    decides="relative standard error from which on a parameter of the extended model is not determined",
    source="theory: two standard errors reach from the value to zero",
    steady=(0.7, 1.3),
)

# Laws without a name.
MIN_LAW_GAIN = Threshold(
    0.9,
    decides="share of the validation error above the noise from which on a law without a name explains it",
    source="choice: what a named effect that is right removes of it, with a margin",
)
MIN_LOG_ODDS = Threshold(
    4.6,
    decides="logarithm of the odds of the best place for a law over another, from which on the other is ruled out",
    source="theory: a hundred to one (Kass & Raftery, J. Am. Stat. Assoc. 90, 773-795, 1995)",
)
MIN_LEFT = Threshold(
    0.1,
    decides="squares of unseen records above those of noise, relative to these, from which on a second law is sought",
    source="choice: a tenth of the variance of noise is no more than its estimate may be off",
)
PRIOR_LOG_ODDS = Threshold(
    4.6,
    decides="logarithm of the odds of a known effect over a law without a name at one place, before there is any data",
    source="choice: thirty places share what is left to laws without a name, and the library holds the usual effects",
)
MAX_DOUBTED_GAIN = Threshold(
    1e5,
    decides="gain of all effects in -2 ln L up to which laws at other places are held against them",
    source="theory: of more, the half per cent that a wrong place leaves at least fails a residual test",
)
MUCH_LEFT = Threshold(
    1.0,
    decides="excess of the squared residuals per sample from which on a fit is begun at the nominal values, too",
    source="theory: as much is left as there is noise, which no minimum near the right one leaves",
)
LARGE_MISFIT = Threshold(
    100.0,
    decides="mean square of the whitened residual from which on scores of places mean little, and each is fitted",
    source="choice: ten standard deviations in every sample",
)

# Records that were not fitted.
MIN_EXPLAINED_SHARE = Threshold(
    1e-3,
    decides="gain of the last effect, of the initial excess, below which it is chance if no test fails without it",
    source="theory: a drive's noise and its motion between samples may explain 3 % of an amplitude, 1e-3 of its square",
    steady=(0.7, 1.3),
)
NOISE_DEVIATIONS = Threshold(
    3.0,
    decides="standard deviations above which a sum of squares is not noise alone",
    source="theory: 99.9 % of a normal distribution",
    steady=(0.7, 1.3),
)
MAX_RISE = Threshold(
    20.0,
    decides="rise of the sum of squares of unfitted records above which an effect stands in for something else",
    source="theory: errors of ten fitted parameters make as many unfitted samples worse by 10, give or take 4.5",
    steady=(0.7, 1.3),
)
MAX_RISE_OF_GAIN = Threshold(
    0.1,
    decides="the same, of the gain on the fitted records",
    source="choice: errors of an effect's parameters are a share of the effect",
    steady=(0.7, 1.3),
)
MIN_EXCESS_RATIO = Threshold(
    10.0,
    decides="excess over noise of one unfitted record, of that of all fitted ones, above which it is fitted at once",
    source="choice: an order of magnitude",
    steady=(0.7, 1.3),
)
MIN_UNSEEN_EXCESS = Threshold(
    100.0,
    decides="excess of a failed residual test of unfitted records above which one of these is fitted as well",
    source="choice: errors of fitted parameters explain far less",
    steady=(0.7, 1.3),
)

# Drives that saturate, and a voltage whose zero is off.
MIN_SAMPLES = Threshold(
    64,
    decides="samples before a saturation from which on a record is kept up to it",
    source="choice: 32 lines of a spectrum, which an estimate of the noise needs",
    steady=(0.7, 1.3),
)
MAX_HARMLESS_P_VALUE = Threshold(
    1e-5,
    decides="p-value of the residual after a saturation below which it did harm",
    source="theory: the level of a residual test",
    steady=(0.7, 1.3),
)
MIN_OFFSET_ERRORS = Threshold(
    5.0,
    decides="standard errors by which mean voltages have to differ for a zero that is off",
    source="theory: one in 10^6 by chance",
    steady=(0.7, 1.3),
)
MIN_OFFSET_NOISE_RATIO = Threshold(
    1.0,
    decides="mean voltage, in noise of a sample, from which on it may be a zero that is off",
    source="choice: a smaller mean may be a slow effect of the specimen, and does no harm",
    steady=(0.7, 1.3),
)
MIN_TIME_CONSTANTS = Threshold(
    10.0,
    decides="time constants of load and capacitance from which on a record has a steady mean",
    source="theory: of an initial charge exp(-10) is left",
    steady=(0.7, 1.3),
)

# Start values without which an effect cannot be found, and ranges beyond which the records cannot show it.
MIN_TENSION = Threshold(
    0.01,
    decides="tension, of the range of a force, from which on a contact may open",
    source="choice: less is noise, or a zero that is off",
    steady=(0.7, 1.3),
)
MIN_LIMIT_GAIN = Threshold(
    50.0,
    decides="decrease of the sum of squares from which on a saturation limit is tried",
    source="theory: seven standard errors; the limit is one of many samples",
    steady=(0.7, 1.3),
)
MAX_PINNED_OFFSET = Threshold(
    2.0,
    decides="standard deviations below the largest reading up to which a limit is tried where readings end alike",
    source="choice: noise before a converter is cut off with the signal",
    steady=(0.7, 1.3),
)
MAX_TIME_CONSTANT = Threshold(
    3.0,
    decides="time constant, in lengths of the longest record, below which a relaxation can be shown",
    source="theory: a slower one is straight within a sixth of its amplitude",
    steady=(0.7, 1.3),
)
MAX_SPIKE_SHARE = Threshold(
    2e-3,
    decides="share of the samples that may be spikes beyond a saturation limit",
    source="choice: twice what the check of raw data calls spikes",
    steady=(0.7, 1.3),
)
NOISE_MARGIN = Threshold(
    6.0,
    decides="standard deviations by which noise may exceed a saturation limit",
    source="theory: one in 10^9 samples",
    steady=(0.7, 1.3),
)
