"""Simulated frames whose rows are exposed one after the other."""

import dataclasses

import numpy as np
import pytest
from refusals import refused

from jitterkit.detectors import Detector
from jitterkit.errors import ErrorCode
from jitterkit.frames import open_frames, write_fits, write_tiff
from jitterkit.instruments import Instrument
from jitterkit.loci import Linear, Mvn, Stable
from jitterkit.optics import flat_band, obstructed_circle
from jitterkit.scene import Binary
from jitterkit.shutter import Drifting, Following
from jitterkit.simulate import fits_header, simulate_frame, simulate_sequence, tiff_metadata

LINE = 2e-4
CAMERA = Detector(gain=0.5, read_noise=3.0, bias=50.0, line_time=LINE)
SCENE = Binary(separation=4.0, theta=90.0, x=0.1, y=-0.2, flux=1e6, contrast=1.5)
# A telescope of its own: a square frame of 32 rows, whose times the tests compute by hand.
ROLLING = Instrument(
    "rolling",
    0.375,
    (32, 32),
    CAMERA,
    flat_band(530.0, 640.0, 3),
    obstructed_circle(0.125, 0.04, noll=(), samples=64),
    exposure=0.1,
)
GLOBAL = dataclasses.replace(ROLLING, detector=dataclasses.replace(CAMERA, line_time=None))


def frame(instrument=ROLLING, locus=None, **options):
    return simulate_frame(instrument, SCENE, locus or Stable.of(), pad=16, detector=False, **options)


def apart(image):
    """Distance along y between the light of the upper and of the lower half, in arcsec."""
    rows, half = (np.arange(32) - 15.5) * 0.375, 15  # the pair's middle is half a pixel below the frame's
    profile = image.sum(axis=1)
    low, high = profile[:half], profile[half:]
    return high @ rows[half:] / high.sum() - low @ rows[:half] / low.sum()


def test_a_drift_rolls_the_rows_of_a_detector_that_rolls_and_of_no_other():
    still = frame().expected
    assert frame(GLOBAL, velocity=(0.0, 20.0)).truth.shutter is None
    assert np.array_equal(frame(GLOBAL, velocity=(0.0, 20.0)).expected, still)
    assert np.array_equal(frame(velocity=(0.0, 0.0)).expected, still)
    simulated = frame(velocity=(0.0, 20.0))
    # the upper star is exposed 4/0.375 rows after the lower and is found higher by what it drifted meanwhile
    stretch = 20.0 * LINE * 4.0 / 0.375
    assert apart(simulated.expected) - apart(still) == pytest.approx(stretch, rel=0.1)
    back = frame(velocity=(0.0, 20.0), row_order=-1)
    assert apart(back.expected) - apart(still) == pytest.approx(-stretch, rel=0.1)
    assert float(simulated.truth.shutter.line_time) == LINE == -float(back.truth.shutter.line_time)


def test_a_shutter_of_ones_own_gets_the_nodes_it_needs():
    t = np.linspace(0.0, 0.2, 500)
    x = 0.5 * np.sin(2 * np.pi * 55 * t)
    simulated = frame(GLOBAL, shutter=Following.of(LINE, t, x, 0 * t, 0.05, 0.1, 32))
    assert simulated.truth.shutter.nodes > 3
    fine = dataclasses.replace(simulated.truth.shutter, nodes=20)
    again = frame(GLOBAL, shutter=fine).truth.shutter
    assert again.nodes == simulated.truth.shutter.nodes
    with refused(ErrorCode.CONFLICT, "velocity", "shutter"):
        frame(shutter=fine, velocity=(1.0, 2.0))


def test_a_velocity_that_is_none_is_refused():
    with refused(ErrorCode.WRONG_SHAPE, "velocity", "[1.0]"):
        frame(velocity=[1.0])
    with refused(ErrorCode.OUT_OF_RANGE, "velocity", "[1.0, nan]"):
        frame(velocity=[1.0, float("nan")])
    with refused(ErrorCode.WRONG_SHAPE, "velocity", "(3, 2)", "(2,)", "(2, 2)", "arcsec/s"):
        next(simulate_sequence(ROLLING, SCENE, Stable.of(), 2, velocity=np.zeros((3, 2))))
    with refused(ErrorCode.WRONG_SHAPE, "shutter", 1, 2):
        next(simulate_sequence(ROLLING, SCENE, Stable.of(), 2, shutter=[Drifting(LINE, (1.0, 2.0))]))


def test_every_frame_of_a_sequence_may_have_its_own_pair_and_drift():
    separations, fluxes = np.array([4.0, 4.5]), np.array([1e6, 2e6])
    velocities = np.array([[0.0, 20.0], [5.0, -20.0]])
    options = {"pad": 16, "detector": False}
    both = simulate_sequence(
        ROLLING, SCENE, Stable.of(), 2, separation=separations, flux=fluxes, velocity=velocities, **options
    )
    for simulated, separation, flux, velocity in zip(both, separations, fluxes, velocities, strict=True):
        scene = Binary(separation, 90.0, 0.1, -0.2, flux, 1.5)
        alone = simulate_frame(ROLLING, scene, Stable.of(), velocity=velocity, **options)
        assert np.array_equal(simulated.expected, alone.expected)
        assert float(simulated.truth.scene.separation) == separation
    common = list(simulate_sequence(ROLLING, SCENE, Stable.of(), 2, velocity=(0.0, 20.0), **options))
    assert np.array_equal(common[0].expected, common[1].expected)


@pytest.mark.parametrize("ending", ["fits", "tif"])
def test_the_sense_of_the_rows_survives_a_file(tmp_path, ending):
    # What a camera with this line time writes as FITS or TIFF, read back by somebody who knows the camera:
    # the model with the frame's own line time is the frame, and with the other sign it is not.
    order = -1 if ending == "tif" else 1
    streak = Linear.of(2.0, 90.0)
    simulated = frame(locus=streak, velocity=(0.0, 20.0), row_order=order)
    path = tmp_path / f"one.{ending}"
    if ending == "tif":
        write_tiff(path, simulated.raw.data, metadata=tiff_metadata(simulated))
    else:
        write_fits(path, simulated.raw.data, header=fits_header(simulated, ROLLING))
    with open_frames(path) as file:
        raw = file[0]
    line_time = CAMERA.inform(raw.metadata).value("line_time")
    assert line_time == order * LINE
    if ending == "tif":  # which says so itself, in the table beside it
        assert raw.metadata.value("line_time") == line_time
    models = [
        frame(GLOBAL, streak, shutter=Drifting(sign * line_time, (0.0, 20.0))).expected for sign in (1, -1)
    ]
    assert raw.data == pytest.approx(models[0], abs=1e-9 * raw.data.max())
    assert np.abs(raw.data - models[1]).max() > 0.01 * raw.data.max()


def test_the_cards_of_a_rolling_frame_say_its_drift_or_its_trace():
    cards = fits_header(frame(locus=Linear.of(2.0, 90.0), velocity=(3.0, 20.0)), ROLLING)
    assert [cards[key][0] for key in ("TRULINE", "TRUVX", "TRUVY")] == pytest.approx([LINE, 3.0, 20.0])
    assert cards["TRULEN"][0] == pytest.approx(2.0)
    t = np.linspace(0.0, 0.2, 50)
    followed = fits_header(frame(shutter=Following.of(-LINE, t, 5.0 * t, 0 * t, 0.05, 0.1, 32)), ROLLING)
    assert followed["TRULINE"][0] == -LINE
    assert followed["TRULOCUS"][0] == "trace"
    assert followed["TRUSXX"][0] == pytest.approx(0.5**2 / 12, rel=1e-6)  # a streak of 5 arcsec/s * 0.1 s
    assert "TRUVX" not in followed
    assert "TRULINE" not in fits_header(frame(), ROLLING)


def test_charge_diffuses_by_the_detectors_pixels_where_a_pupil_makes_the_image():
    # 0.4 pixels are 0.15 arcsec: the image grows by the second moments of a round normal
    soft = dataclasses.replace(GLOBAL, detector=dataclasses.replace(GLOBAL.detector, diffusion=0.4))
    assert frame(soft).expected == pytest.approx(frame(GLOBAL, Mvn.of(0.15)).expected, rel=1e-9)
    assert soft.system(plate_scale=0.75, pad=4).diffusion == pytest.approx(0.3)
    star = np.exp(-(np.hypot(*np.indices((21, 21)) - 10.0) ** 2) / 8)
    with refused(ErrorCode.CONFLICT, "diffusion = 0.4"):  # a measured star holds it
        dataclasses.replace(soft, pupil_from=None, psf_from=star)
