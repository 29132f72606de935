"""Fewer points, the same picture; and the way onto the page and back."""

from __future__ import annotations

import base64
import gzip

import numpy as np

from cspr_control.analysis.page.decimation import envelope
from cspr_control.analysis.page.packing import Packer


def test_short_series_stay_as_they_are() -> None:
    time, values = np.arange(10.0), np.arange(20.0).reshape(10, 2)
    short, same = envelope(time, values, 10)
    assert short is time
    assert same is values


def test_every_peak_stays_at_its_time() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(150_001) * 0.004
    values = 0.01 * rng.normal(size=(time.size, 3))
    peaks = {7: 5.0, 33_333: -7.0, 99_999: 3.0, 150_000: -4.0}
    for place, height in peaks.items():
        values[place, 1] = height
    short_time, short = envelope(time, values, 4000)
    assert short_time.size <= 4000
    assert np.all(np.diff(short_time) > 0.0)
    stretch = 2 * time[-1] / 4000 * 1.05
    for place, height in peaks.items():
        found = np.flatnonzero(short[:, 1] == height)
        assert found.size == 1
        assert abs(short_time[found[0]] - time[place]) < stretch
    np.testing.assert_array_equal(short.min(axis=0), values.min(axis=0))
    np.testing.assert_array_equal(short.max(axis=0), values.max(axis=0))


def test_the_order_of_the_extremes_stays_and_gaps_stay() -> None:
    rising = np.arange(100.0)[:, None]
    _, short = envelope(np.arange(100.0), rising, 10)
    assert np.all(np.diff(short[:, 0]) > 0.0)
    _, falling = envelope(np.arange(100.0), -rising, 10)
    assert np.all(np.diff(falling[:, 0]) < 0.0)
    gap = rising.copy()
    gap[40:60] = np.nan
    _, short = envelope(np.arange(100.0), gap, 10)
    assert np.isnan(short[4:6]).all()
    assert np.isfinite(short[:4]).all()


def test_packed_samples_can_be_read_back() -> None:
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(0.003, 0.005, 501)) - 1.0
    values = np.column_stack((rng.normal(0.0, 300.0, 501), np.full(501, 2.5), np.full(501, np.nan)))
    values[17, 0] = np.nan
    values[18, 0] = np.inf
    packer = Packer()
    packer.add(time[:7], values[:7])  # so that the next one does not begin at zero
    block = packer.add(time, values)
    assert block["offset"] % 4 == 0
    data = gzip.decompress(base64.b64decode(packer.text()))
    ticks = np.frombuffer(data, "<i4", 501, block["offset"])
    np.testing.assert_allclose(np.cumsum(ticks) * block["tick"], time, atol=0.51e-5)
    for k, (scale, offset) in enumerate(block["columns"]):
        levels = np.frombuffer(data, "<i2", 501, block["offset"] + 4 * 501 + 2 * 501 * k)
        levels = np.cumsum(levels, dtype=np.int64).astype(np.int16)  # wraps around, as on the page
        read = np.where(levels == -32768, np.nan, offset + scale * levels)
        expected = np.where(np.isfinite(values[:, k]), values[:, k], np.nan)
        np.testing.assert_allclose(read, expected, atol=0.51 * scale)
    assert block["columns"][0][0] < 2000.0 / 65534
