"""The part of a measured drive that stands out of its noise.

Operators rectify: where a load is held they rest, while the noise of its measurement would let those of a model slip to and fro.
So a model is driven by the drive without what may be noise; the rest is small and passes by the model's linear response.
"""

from __future__ import annotations

import numpy as np

WIDTH = 2.5  # half width of a confidence interval in standard deviations
LEVELS = 13  # windows of 3, 7, 15, ... samples


def denoised(values: np.ndarray, sigma: float) -> np.ndarray:
    """Average over as many samples as agree within the noise.

    Around every sample the window grows as long as the confidence intervals of all averages have a point in common
    (intersection of confidence intervals: Goldenshluger & Nemirovski, Mathematical Methods of Statistics 6(2), 135-170,
    1997; Katkovnik, IEEE Transactions on Signal Processing 47(9), 2567-2571, 1999).

    Parameters
    ----------
    values : (n,) array
    sigma : float
        Standard deviation of the noise, in the same unit.

    Returns
    -------
    (n,) array
    """
    found = values.copy()
    if sigma <= 0:
        return found
    lower, upper = values - WIDTH * sigma, values + WIDTH * sigma
    sums = np.concatenate([[0.0], np.cumsum(values - values[0])])
    grows = np.arange(len(values))
    for half in (2**level - 1 for level in range(1, LEVELS + 1)):
        grows = grows[(grows >= half) & (grows < len(values) - half)]
        mean = (sums[grows + half + 1] - sums[grows - half]) / (2 * half + 1) + values[0]
        around = WIDTH * sigma / np.sqrt(2 * half + 1)
        low, high = np.maximum(lower[grows], mean - around), np.minimum(upper[grows], mean + around)
        agree = low <= high
        grows = grows[agree]
        if not len(grows):
            break
        found[grows], lower[grows], upper[grows] = mean[agree], low[agree], high[agree]
    return found
