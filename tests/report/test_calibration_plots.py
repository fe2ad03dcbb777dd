"""The picture of a calibration: what is drawn is what was measured."""

from dataclasses import replace

import numpy as np
import pytest

from jitterkit.calibration import Stack, calibrate
from jitterkit.report.calibration_plots import plot_calibration, plot_response, plot_transfer
from jitterkit.report.calibration_table import calibration_rows, calibration_sentences, levels_table


@pytest.fixture(scope="module")
def found():
    rng = np.random.default_rng(5)
    response = 1 + 0.01 * rng.normal(size=(64, 64))

    def stack(kind, light, seconds, count=6):
        charge = np.minimum(rng.poisson(np.broadcast_to(light * response, (count, 64, 64))), 20000)
        return Stack.of(kind, np.rint(300 + (charge + rng.normal(0, 5, charge.shape)) / 2), seconds)

    flats = [stack("flat", 16000 * t, t) for t in (0.1, 0.4, 0.8, 1.6)]
    return calibrate(stack("bias", 0, None), [stack("dark", 30.0, 10.0)], flats)


def test_the_page_has_a_panel_for_everything_measured(found):
    axes = plot_calibration(found)
    assert [ax.get_title() for ax in axes] == ["photon transfer", "linearity", "dark current", "response"]
    assert all(ax.get_xlabel().endswith("]") for ax in axes[:3])
    axes[0].figure.canvas.draw()


def test_biases_alone_have_one_panel(rng):
    alone = calibrate(Stack.of("bias", rng.normal(100, 3, (4, 64, 64))), gain=1.0)
    (ax,) = plot_calibration(alone)
    assert ax.get_title() == "read noise"
    assert levels_table(alone).colnames[0] == "exposure"
    assert len(levels_table(alone)) == 0


def test_the_line_drawn_is_photons_and_read_noise(found):
    line = plot_transfer(found).lines[0]
    signal, variance = line.get_xdata(), line.get_ydata()
    transfer = found.transfer
    expected = signal / transfer.gain + (transfer.read_noise / transfer.gain) ** 2
    np.testing.assert_allclose(variance, expected, rtol=1e-9)
    assert transfer.gain == pytest.approx(2, abs=4 * transfer.gain_error)


def test_the_bars_of_the_response_count_every_good_pixel(found):
    ax = plot_response(found)
    assert [patch.get_data().values.sum() for patch in ax.patches] == [4096, 4096]


def test_rows_and_sentences_say_what_was_measured(found):
    names = [row[0] for row in calibration_rows(found)]
    assert names[:5] == ["gain", "bias", "read noise", "dark current", "PRNU"]
    assert "full well" in names
    said = " ".join(calibration_sentences(found))
    assert all(value in said for value in ("4 levels", "1 saturated", "0 of 4096 pixels"))
    table = levels_table(found)
    assert table["signal"].unit == "adu"
    assert table["saturated"].tolist() == [False] * 4 + [True]


def test_of_the_response_only_what_is_local_is_reported(found):
    uneven = replace(found, local=replace(found.local, error=0.5))
    maps = [uneven.local if one.name == "flat" else one for one in uneven.maps if one is not None]
    said = calibration_sentences(uneven)
    assert len(maps) > 1
    assert said[: len(maps)] == [one.sentence() for one in maps]
