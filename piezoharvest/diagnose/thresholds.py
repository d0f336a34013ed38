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
    decides="largest p-value, times the number of tests, with which a residual test fails",
    source="theory: Bonferroni; one false alarm in 10^5 models, because rounded noise is not quite normal",
    steady=(0.7, 1.3),
)
MIN_LINES = Threshold(
    20,
    decides="smallest number of spectral lines that are tested for single lines, bursts and correlation",
    source="choice: the normal approximation of these tests needs some twenty values",
    steady=(0.7, 1.3),
)
SLOW_LINES = Threshold(
    15,
    decides="number of the spectral line from which rounding errors at a constant load count as noise and lines "
    "are tested one by one; lower ones are tested by bands alone",
    source="theory: a constant error of half the noise is sqrt(N) / (2 pi m) times the noise in line m; at N = "
    "10^4, that is one at m = 16",
    steady=(0.7, 1.3),
)
MAX_CONSTANT_STEP = Threshold(
    1e-5,
    decides="largest change from one sample to the next, relative to its range, of a drive that counts as constant",
    source="choice: one range in ten times the length of a usual record",
    steady=(0.7, 1.3),
)
MIN_CONSTANT_SHARE = Threshold(
    0.3,
    decides="share of samples with a constant drive above which the slow bands of rounded channels are not tested",
    source="choice: with fewer, rounding errors average out over the other samples",
    steady=(0.7, 1.3),
)
MIN_ROUNDING_ERROR = Threshold(
    0.01,
    decides="smallest rounding error, relative to the noise, of a channel that counts as rounded",
    source="theory: a hundredth of the noise, constant over 10^4 samples, is one standard error of their mean",
    steady=(0.7, 1.3),
)
MIN_SINE_SHARE = Threshold(
    0.9,
    decides="smallest share of a drive's power in one line for which it counts as a sine, whose harmonics are tested",
    source="choice: in a multisine of equal amplitudes, the largest share is a half",
    steady=(0.7, 1.3),
)

# The search: which effects are fitted, added, exchanged and removed.
SEARCH_LEVEL = Threshold(
    1e-4,
    decides="largest p-value, corrected for the number of start values, with which an effect is added or kept",
    source="theory: Bonferroni; one false alarm in 10^4 healthy campaigns",
    steady=(0.7, 1.3),
)
PRELIMINARY_LEVEL_FACTOR = Threshold(
    30.0,
    decides="multiple of this level up to which the p-value of a score leads to a fit of an effect with several "
    "parameters",
    source="theory: a time constant between two start values gains up to half more, which is a p-value 15 to 60 "
    "times smaller",
    steady=(0.7, 1.3),
)
MIN_RELATIVE_SCORE = Threshold(
    0.15,
    decides="smallest score, relative to the best one, of an effect that is fitted",
    source="choice: to be the best, a full fit would have to gain seven times its score",
    steady=(0.7, 1.3),
)
MAX_EFFECTS = Threshold(
    3,
    decides="number of effects at which the search ends",
    source="choice: a campaign of some ten records can hardly distinguish larger sets",
    steady=(0.7, 1.3),
)
MIN_SHARE_OF_INITIAL = Threshold(
    0.05,
    decides="smallest gain of an effect that counts, relative to the initial excess over the noise",
    source="choice: where no effect is the cause, any effect gains a few per cent",
    steady=(0.7, 1.3),
)
MIN_SHARE_OF_PRESENT = Threshold(
    0.5,
    decides="gain, relative to the present excess over the noise, with which an effect counts although the one "
    "above is not reached",
    source="choice: more than half of what is left",
    steady=(0.7, 1.3),
)
MIN_UNDOUBTED_GAIN = Threshold(
    100.0,
    decides="gain in -2 ln L, and Wald statistic, below which the fit without an effect is repeated: it may be in "
    "a false minimum",
    source="theory: ten standard errors",
    steady=(0.7, 1.3),
)
MIN_IMPROVEMENT = Threshold(
    1.0,
    decides="smallest decrease of -2 ln L with which another minimum, or another effect in the same place, is "
    "preferred",
    source="theory: one standard error, and twice the tolerance of a trial fit",
    steady=(0.7, 1.3),
)
MIN_EXCHANGE_SCORE = Threshold(
    0.8,
    decides="smallest score, relative to the gain of an effect, with which another effect is fitted in its place",
    source="choice: the more two effects are alike, the closer a score comes to the gain of its fit",
    steady=(0.7, 1.3),
)
CLOSE_COST = Threshold(
    6.0,
    decides="difference of -2 ln L below which two sets of effects cannot be distinguished (verdict `ambiguous`), "
    "and tolerance of a fit that is compared with others",
    source="theory: odds of exp(3), or twenty to one (Kass & Raftery, J. Am. Stat. Assoc. 90, 773-795, 1995)",
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
    decides="size of an effect, in its standard errors, below which it is removed at the end",
    source="theory: 95 % of a normal distribution",
    steady=(0.7, 1.3),
)
OUTSTANDING_SHARE = Threshold(
    0.3,
    decides="excess of a residual test, relative to the largest of all, above which it has to be explained",
    source="choice: smaller ones may be side effects of the largest",
    steady=(0.7, 1.3),
)
UNEXPLAINED_SHARE = Threshold(
    0.5,
    decides="share of its excess that a residual test may keep; if it keeps more, it is not explained and the "
    "search ends",
    source="choice: more than half is left",
    steady=(0.7, 1.3),
)

# Parameters far from their nominal values.
MIN_DEVIATION = Threshold(
    0.4,
    decides="logarithm of the ratio to the nominal value above which a parameter may compensate for a missing effect",
    source="choice: a factor of 1.5; nominal values of data sheets are right within a third",
    steady=(0.7, 1.3),
)
MIN_DEVIATION_GAIN = Threshold(
    10.0,
    decides="decrease of -2 ln L achieved by such parameters above which they are reported as deviating",
    source="theory: three standard errors",
    steady=(0.7, 1.3),
)
MAX_DEVIATION = Threshold(
    5.0,
    decides="ratio to the nominal value, or its inverse, above which a parameter certainly compensates for a "
    "missing effect",
    source="choice: no data sheet is wrong by that much",
    steady=(0.7, 1.3),
)
MIN_CERTAIN_DEVIATION = Threshold(
    4.0,
    decides="standard errors by which a parameter beside a law without a name is off its nominal value for certain",
    source="theory: 6e-5 of a normal distribution, for each of some five parameters",
)
MAX_RELATIVE_ERROR = Threshold(
    identifiability.MAX_RELATIVE_ERROR,
    decides="relative standard error above which a parameter of the extended model counts as not determined",
    source="theory: the value is two standard errors from zero",
    steady=(0.7, 1.3),
)

# Laws without a name.
MIN_LAW_GAIN = Threshold(
    0.9,
    decides="share of the validation error above the noise that a law without a name has to remove",
    source="choice: what the right named effect removes, with a margin",
)
MIN_DOMINANT_SHARE = Threshold(
    0.995,
    decides="share of a large misfit above which a law is first sought beside the effects that explain it, not in "
    "their place",
    source="theory: an effect at a wrong place leaves half a per cent",
)
MIN_LOG_ODDS = Threshold(
    4.6,
    decides="logarithm of the odds of the best place for a law against another place above which the other is excluded",
    source="theory: a hundred to one (Kass & Raftery, J. Am. Stat. Assoc. 90, 773-795, 1995)",
)
MIN_LEFT = Threshold(
    0.1,
    decides="mean square of unseen residuals above that of the noise, relative to the latter, above which a "
    "second law is sought",
    source="choice: the estimate of the noise variance may be wrong by a tenth",
)
PRIOR_LOG_ODDS = Threshold(
    4.6,
    decides="logarithm of the prior odds of a known effect against a law without a name at one place",
    source="choice: thirty places share the remaining probability, and the library contains the usual effects",
)
MAX_DOUBTED_GAIN = Threshold(
    1e5,
    decides="gain of all effects in -2 ln L up to which laws at other places are compared with them",
    source="theory: with a larger gain, the half per cent that a wrong place leaves is seen by a residual test",
)
MUCH_LEFT = Threshold(
    1.0,
    decides="excess of the squared whitened residuals per sample above which a fit is also started at the nominal "
    "values",
    source="theory: the excess is as large as the noise, which does not occur in minima near the right one",
)
LARGE_MISFIT = Threshold(
    100.0,
    decides="mean square of the whitened residuals above which scores of places are not reliable and every place "
    "is fitted",
    source="choice: ten standard deviations in every sample",
)

# Records that were not fitted.
MIN_EXPLAINED_SHARE = Threshold(
    1e-3,
    decides="gain of the last effect, relative to the initial excess, below which it is attributed to chance if "
    "no test fails without it",
    source="theory: noise of the drive and its motion between samples may amount to 3 % of an amplitude, 1e-3 of "
    "its square",
    steady=(0.7, 1.3),
)
NOISE_DEVIATIONS = Threshold(
    3.0,
    decides="number of standard deviations above which a sum of squares is more than noise",
    source="theory: 99.9 % of a normal distribution",
    steady=(0.7, 1.3),
)
MAX_RISE = Threshold(
    20.0,
    decides="rise of the sum of squares of unfitted records above which an effect is only a substitute for another one",
    source="theory: errors of ten fitted parameters increase the sum of squares of unfitted records by 10 with a "
    "standard deviation of 4.5",
    steady=(0.7, 1.3),
)
MAX_RISE_OF_GAIN = Threshold(
    0.1,
    decides="the same rise, relative to the gain on the fitted records",
    source="choice: the errors of an effect's parameters are a fraction of the effect",
    steady=(0.7, 1.3),
)
MIN_EXCESS_RATIO = Threshold(
    10.0,
    decides="excess over the noise of one unfitted record, relative to that of all fitted ones, above which it is "
    "fitted at once",
    source="choice: an order of magnitude",
    steady=(0.7, 1.3),
)
MIN_UNSEEN_EXCESS = Threshold(
    100.0,
    decides="excess of a failed residual test on unfitted records above which one of these records is also fitted",
    source="choice: errors of fitted parameters cause far less",
    steady=(0.7, 1.3),
)

# Drives that saturate, and a voltage whose zero is off.
MIN_SAMPLES = Threshold(
    64,
    decides="smallest number of samples before a saturation for which this part of a record is kept",
    source="choice: an estimate of the noise needs 32 spectral lines",
    steady=(0.7, 1.3),
)
MAX_HARMLESS_P_VALUE = Threshold(
    1e-5,
    decides="p-value of the residual after a saturation below which the saturation is taken into account",
    source="theory: the level of a residual test",
    steady=(0.7, 1.3),
)
MIN_OFFSET_ERRORS = Threshold(
    5.0,
    decides="number of standard errors by which mean voltages have to differ for a zero error of the sensor",
    source="theory: one in 10^6 by chance",
    steady=(0.7, 1.3),
)
MIN_OFFSET_NOISE_RATIO = Threshold(
    1.0,
    decides="smallest mean voltage, relative to the noise of a sample, that may be a zero error",
    source="choice: a smaller mean may be a slow effect in the specimen, and does no harm",
    steady=(0.7, 1.3),
)
MIN_TIME_CONSTANTS = Threshold(
    10.0,
    decides="shortest record with a steady mean, in time constants of load and capacitance",
    source="theory: exp(-10) of an initial charge is left",
    steady=(0.7, 1.3),
)

# Start values without which an effect cannot be found, and ranges beyond which the records cannot show it.
MIN_TENSION = Threshold(
    0.01,
    decides="smallest tension, relative to the range of the force, at which a contact may open",
    source="choice: less is noise or a zero error",
    steady=(0.7, 1.3),
)
MIN_LIMIT_GAIN = Threshold(
    50.0,
    decides="smallest decrease of the sum of squares for which a saturation limit is tried",
    source="theory: seven standard errors; the limit is one of many samples",
    steady=(0.7, 1.3),
)
MAX_PINNED_OFFSET = Threshold(
    2.0,
    decides="distance from the largest reading, in standard deviations, within which a limit is tried where many "
    "readings end at the same value",
    source="choice: noise ahead of a converter is clipped together with the signal",
    steady=(0.7, 1.3),
)
MAX_TIME_CONSTANT = Threshold(
    3.0,
    decides="longest time constant of a relaxation that can be detected, in lengths of the longest record",
    source="theory: a slower relaxation is a straight line within a sixth of its amplitude",
    steady=(0.7, 1.3),
)
MAX_SPIKE_SHARE = Threshold(
    2e-3,
    decides="share of samples that may be spikes beyond a saturation limit",
    source="choice: twice the share that the check of raw data accepts as spikes",
    steady=(0.7, 1.3),
)
NOISE_MARGIN = Threshold(
    6.0,
    decides="number of standard deviations by which noise may exceed a saturation limit",
    source="theory: one in 10^9 samples",
    steady=(0.7, 1.3),
)
