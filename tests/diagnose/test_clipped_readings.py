"""A range that ends before the noise: no two readings at it are alike."""

import numpy as np
import pytest
from diagnose_runs import RECORDS, campaign

from piezoharvest.description.effects import Clipping, Leakage, Stiffening
from piezoharvest.diagnose import diagnose
from piezoharvest.identify import identify
from piezoharvest.identify.fitting.model import unexplained_blocks
from piezoharvest.identify.preparation import prepared


def test_a_range_that_ends_before_the_noise_is_found(tmp_path):
    channel = "current"
    measured = campaign(tmp_path, records=RECORDS[:3])
    before = identify(measured, offsets=("displacement",))
    data = prepared(measured, "fit")
    limit = 0.95 * max(np.abs(each.record[channel]).max() for each in data)
    for each, nuisance in zip(data, before.found.nuisance, strict=True):
        for _, begin, residual in unexplained_blocks(before.found.model, each, nuisance):
            values = each.record[channel][begin : begin + len(residual)]
            noise = residual[:, each.channels.index(channel)]
            values[:] = np.clip(values - noise, -limit, limit) + noise
    assert sum(np.count_nonzero(np.abs(each.record[channel]) > limit) for each in data) > 10
    found = diagnose(measured, library=[Clipping, Leakage, Stiffening])
    assert found.verdict == "effect"
    (named,) = found.effects
    assert (named.effect.name, named.effect.channel) == ("clipping", channel)
    value, std, _ = named.values["limit"]
    assert value == pytest.approx(limit, abs=4.0 * std)
