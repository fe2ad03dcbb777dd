"""Rolling shutters against their definition: every row by itself, instant by instant."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.forward import Parameters, expected_image, image_and_jacobian, parameter_names, to_vector
from jitterkit.loci import Linear, Mvn, Stable, Trace
from jitterkit.optics import Grid, expand, lines, obstructed_circle
from jitterkit.scene import Binary
from jitterkit.shutter import Drifting, Following, interpolation_error, with_enough_nodes

SCALE, ROWS, COLUMNS, PAD = 0.375, 128, 97, 64
LINE = 15e-6
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


@pytest.fixture(scope="module")
def pupil():
    # a telescope of its own: a frame of many rows without any symmetry
    return obstructed_circle(0.125, 0.04, strut_width=0.004, struts=3, noll=(), samples=128)


@pytest.fixture(scope="module")
def otf(pupil):
    return expand(pupil, lines(550.0, 600.0), Grid((ROWS, COLUMNS), SCALE, PAD), derivatives=False)


def scene(flux=3.811e7, **changes):
    values = {"separation": 10.0, "theta": 77.0, "x": 0.4, "y": -0.6, "flux": flux, "contrast": 3.37}
    return Binary(**(values | changes))


def image_of(otf, shutter=None, locus=None, **changes):
    parameters = Parameters(scene(**changes), locus or Stable.of(), shutter=shutter)
    return np.asarray(expected_image(parameters, otf))


@pytest.fixture(scope="module")
def row_by_row(pupil):
    """``row_by_row(places, shares)``: the frame whose row ``r`` is the mean over ``places[r]`` (t, 2).

    The whole padded plane is periodic and band-limited, so its discrete Fourier series is the image between
    the pixels too.
    """
    grid = Grid((ROWS + 2 * PAD, COLUMNS + 2 * PAD), SCALE, 0)
    assert grid.fine_shape == grid.shape
    sharp = image_of(expand(pupil, lines(550.0, 600.0), grid, derivatives=False))
    series = np.fft.rfft2(sharp)
    fy, fx = np.fft.fftfreq(grid.shape[0], SCALE), np.fft.rfftfreq(grid.shape[1], SCALE)

    def image(positions, shares):
        rows = []
        for r, path in enumerate(positions):
            along_x = np.exp(-2j * np.pi * np.outer(path[:, 0], fx))
            along_y = np.exp(2j * np.pi * np.outer((PAD + r) * SCALE - path[:, 1], fy))
            seen = ((shares[:, None] * along_y).T @ along_x) * series
            rows.append(np.fft.irfft(seen.sum(axis=0) / grid.shape[0], grid.shape[1])[PAD : PAD + COLUMNS])
        return np.array(rows)

    return image


def drifted(row_by_row, velocity, line_time, exposure):
    """A uniform drift: eight instants of each row's exposure (a streak of 0.2 arcsec: 1e-15)."""
    begins = line_time * (np.arange(ROWS) - (ROWS - 1) / 2)
    t = begins[:, None] + exposure * NODES / 2  # about the middle of the central row's exposure
    return row_by_row(t[..., None] * np.asarray(velocity), WEIGHTS / 2)


def chi_squared(image, truth):
    return np.sum((image - truth) ** 2 / truth)


@pytest.mark.parametrize("line_time", [LINE, -LINE], ids=["upwards", "downwards"])
@pytest.mark.parametrize("direction", [0.0, 35.0, 90.0, 200.0, 300.0])
def test_a_bright_frame_of_a_drifting_telescope_cannot_distinguish_two_images_from_its_rows(
    otf, row_by_row, direction, line_time
):
    speed, exposure = 1.0, 0.2
    velocity = speed * np.array([np.cos(np.radians(direction)), np.sin(np.radians(direction))])
    truth = drifted(row_by_row, velocity, line_time, exposure)
    streak = Linear.of(speed * exposure, direction % 180)
    # without the rolling shutter the frame is wrong; with it, the wrong way round, twice as wrong
    still = chi_squared(image_of(otf, None, streak), truth)
    back = chi_squared(image_of(otf, Drifting(-line_time, velocity), streak), truth)
    assert still > 4
    assert back == pytest.approx(4 * still, rel=0.1)
    assert chi_squared(image_of(otf, Drifting(line_time, velocity), streak), truth) < 0.001
    assert chi_squared(image_of(otf, Drifting(line_time, velocity, 4), streak), truth) < 1e-9
    chosen = with_enough_nodes(Drifting(line_time, velocity), ROWS, otf.grid.nyquist)
    assert chosen.nodes == 2


STEP, WINDOW = 2 * LINE, 800 * LINE


def record(kind, duration, rng):
    """A pointing of the given kind, sampled every 0.1 ms."""
    t = np.arange(0.0, duration, 1e-4)
    if kind == "vibration":  # 0.4 arcsec peak to peak at 60 Hz along 20 degrees, less and out of step across
        along, across = 0.2 * np.sin(377.0 * t + 1.0), 0.1 * np.cos(377.0 * t)
        return t, 0.94 * along - 0.34 * across, 0.34 * along + 0.94 * across
    walk = np.cumsum(rng.normal(0.0, 0.001, (2, t.size)), axis=1)  # 0.01 arcsec in 10 ms
    return t, *walk


def followed(row_by_row, t, x, y, start, line_time):
    """Every row through its exposure, at the middles of 400 steps."""
    wait = np.arange(400) * STEP + STEP / 2
    begins = start + line_time * (np.arange(ROWS) - (ROWS - 1) / 2)
    at = begins[:, None] + wait
    central = start + wait
    path = np.stack([np.interp(at, t, v) - np.interp(central, t, v).mean() for v in (x, y)], axis=-1)
    return row_by_row(path, np.full(wait.size, 1 / wait.size))


@pytest.mark.parametrize(
    ("kind", "line_time"),
    [
        ("vibration", LINE),
        pytest.param("walk", -LINE, marks=pytest.mark.slow),
        pytest.param("vibration", 55e-3 / ROWS, marks=pytest.mark.slow),
    ],
    ids=["vibration", "walk downwards", "55 ms of read-out"],
)
def test_a_measured_motion_is_followed_row_by_row(otf, row_by_row, rng, kind, line_time):
    t, x, y = record(kind, 0.08, rng)
    truth = followed(row_by_row, t, x, y, 0.031, line_time)
    assert chi_squared(image_of(otf, None, Trace.of(t, x, y, 0.031, WINDOW)), truth) > 10
    shutter = Following.of(line_time, t, x, y, 0.031, WINDOW, ROWS)
    enough = with_enough_nodes(shutter, ROWS, otf.grid.nyquist)
    assert chi_squared(image_of(otf, enough), truth) < 0.05
    # no choice of nodes is worse than its error says; 1e-5 is what 400 instants leave of the truth itself
    for nodes in (2, 5):
        some = dataclasses.replace(shutter, nodes=nodes)
        error = interpolation_error(some, ROWS, otf.grid.nyquist)
        assert chi_squared(image_of(otf, some), truth) < 3.811e7 * error**2 + 1e-5


def test_each_window_has_the_transfer_function_of_its_own_part_of_the_record(rng):
    t, x, y = record("walk", 0.05, rng)
    x = 20 * x
    shutter = Following.of(LINE, t, x, y, 0.011, WINDOW, ROWS)
    fx, fy = rng.uniform(-1, 1, (2, 5))

    def path(start):
        at = start + (np.arange(40000) + 0.5) * WINDOW / 40000
        return np.array([np.interp(at, t, x), np.interp(at, t, y)])

    middle = path(0.011).mean(axis=1)
    for delay in (0.0, 8.73e-4, -6.14e-4):
        px, py = path(0.011 + delay) - middle[:, None]
        expected = np.exp(-2j * np.pi * (np.outer(px, fx) + np.outer(py, fy))).mean(axis=0)
        # 120 kinks between 40,000 instants: each costs less than the square of a step's share of a piece
        assert np.asarray(shutter.window(fx, fy, delay)) == pytest.approx(expected, abs=1e-7)


def test_one_node_is_a_global_shutter(otf, rng):
    streak = Linear.of(0.2, 35.0)
    one = image_of(otf, Drifting(LINE, (30.0, -70.0), nodes=1), streak)
    whole = image_of(otf, None, streak)
    assert one == pytest.approx(whole, rel=1e-12, abs=1e-14 * whole.max())  # a transform rounds by its peak
    t, x, y = record("walk", 0.05, rng)
    one = image_of(otf, Following.of(LINE, t, x, y, 0.011, WINDOW, ROWS, nodes=1))
    assert one == pytest.approx(image_of(otf, None, Trace.of(t, x, y, 0.011, WINDOW)), rel=1e-9)
    # nor does a frame of one row know when the others would have been exposed
    assert Drifting(LINE, (30.0, -70.0)).blend(1) == pytest.approx(np.array([[0.5], [0.5]]))


def test_to_first_order_the_rows_add_what_the_exposure_ends_with_less_what_it_begins_with(otf):
    # I_RS = I_GS + (r - r0)(tau/T)[S(end) - S(start)]; the next order is smaller by the phase that the drift
    # turns in half the read-out, 2 pi 1.1 cycles/arcsec * 1 arcsec/s * 0.95 ms = 7e-3
    exposure, velocity = 0.2, np.array([0.6, 0.8])
    streak = Linear.of(0.2, np.degrees(np.arctan2(0.8, 0.6)))
    ends = [
        image_of(otf, x=0.4 + side * velocity[0], y=-0.6 + side * velocity[1])
        for side in (-exposure / 2, exposure / 2)
    ]
    rows = (np.arange(ROWS) - (ROWS - 1) / 2)[:, None]
    still = image_of(otf, None, streak)

    def left(line_time):
        """What first order leaves, as a share of what it explains."""
        change = rows * line_time / exposure * (ends[1] - ends[0])
        found = image_of(otf, Drifting(line_time, velocity), streak) - still
        return np.abs(found - change).max() / np.abs(change).max()

    assert left(LINE) < 7e-3
    assert left(LINE / 4) == pytest.approx(left(LINE) / 4, rel=0.02)


def test_a_steady_trace_is_a_drift_and_its_streak(otf):
    t, velocity = np.linspace(0.0, 0.3, 40), np.array([0.6, 0.8])
    trace = Following.of(LINE, t, *np.outer(velocity, t), 0.05, 0.2, ROWS, nodes=3)
    drift = Drifting(LINE, velocity, nodes=3)
    streak = Linear.of(0.2, np.degrees(np.arctan2(0.8, 0.6)))
    assert image_of(otf, trace) == pytest.approx(image_of(otf, drift, streak), rel=1e-8)
    both = image_of(otf, trace, Mvn.of(0.1))
    assert both == pytest.approx(image_of(otf, None, trace.completed(Mvn.of(0.1))), rel=0.01)
    moments = np.asarray(trace.completed(Stable.of()).moments())
    assert moments == pytest.approx(np.asarray(streak.moments()), rel=1e-9)
    assert np.asarray(drift.completed(streak).moments()) == pytest.approx(moments, rel=1e-9)


def centres(image):
    """Centroid along x of the lower and the upper half of an image, and the distance between them along y."""
    half = ROWS // 2
    x, y = np.arange(COLUMNS) * SCALE, np.arange(ROWS) * SCALE
    parts = [(image[:half], y[:half]), (image[half:], y[half:])]
    (xl, yl), (xu, yu) = (
        ((part * x).sum() / part.sum(), (part.sum(axis=1) @ rows) / part.sum()) for part, rows in parts
    )
    return np.array([xl, xu, yu - yl])


def test_rows_exposed_upwards_shear_a_rightward_drift_and_stretch_an_upward_one(otf):
    # A pair 20 arcsec apart along y: the upper star is exposed 53 rows, 0.8 ms, after the lower.
    pair = {"theta": 90.0, "separation": 20.0, "x": 0.0, "y": 0.0}
    still = centres(image_of(otf, **pair))
    later = 20.0 / SCALE * LINE
    lower, upper, _ = centres(image_of(otf, Drifting(LINE, (50.0, 0.0)), **pair)) - still
    assert upper - lower == pytest.approx(50.0 * later, rel=0.1)
    assert upper == pytest.approx(-lower, rel=0.3)
    _, _, apart = centres(image_of(otf, Drifting(LINE, (0.0, 50.0)), **pair)) - still
    assert apart == pytest.approx(50.0 * later, rel=0.1)
    _, _, apart = centres(image_of(otf, Drifting(-LINE, (0.0, 50.0)), **pair)) - still
    assert apart == pytest.approx(-50.0 * later, rel=0.1)


def test_a_drift_along_the_rows_moves_every_row_and_mixes_none(otf):
    drift = Drifting(LINE, (80.0, 0.0), nodes=6)
    assert image_of(otf, drift).sum(axis=1) == pytest.approx(image_of(otf).sum(axis=1), rel=2e-3)
    mixed = image_of(otf, Drifting(LINE, (0.0, 80.0), nodes=6)).sum(axis=1)
    assert np.abs(mixed / image_of(otf).sum(axis=1) - 1).max() > 0.02


STEPS = {"separation": 1e-3, "theta": 1e-2, "x": 1e-3, "y": 1e-3, "flux": 1e3, "contrast": 1e-3}
STEPS |= {"linear_c": 1e-4, "linear_s": 1e-4, "diffusion": 1e-4}
STEPS |= dict.fromkeys(("background", "background_x", "background_y"), 1e-3)


@pytest.mark.parametrize(
    ("following", "diffusion"),
    [pytest.param(False, 0.0, marks=pytest.mark.slow), (False, -0.003), (True, 0.01)],
)
def test_every_derivative_of_a_rolling_frame_agrees_with_finite_differences(otf, rng, following, diffusion):
    drift = Drifting(LINE, (30.0, -70.0), nodes=3)
    shutter = Following.of(LINE, *record("walk", 0.05, rng), 0.011, WINDOW, ROWS) if following else drift
    parameters = Parameters(scene(1e6), Linear.of(0.2, 30.0), (), 2.0, diffusion=diffusion, shutter=shutter)
    vector, unravel = to_vector(parameters)
    names = parameter_names(parameters, ())
    assert names[-2:] == ("background_y", "diffusion")
    assert vector[-1] == diffusion
    image, jacobian = image_and_jacobian(parameters, otf, tuple(range(vector.size)))
    assert np.asarray(image) == pytest.approx(np.asarray(expected_image(parameters, otf)), rel=1e-11)
    for k, name in enumerate(names):
        step = np.zeros(vector.size)
        step[k] = STEPS[name]
        high, low = (expected_image(unravel(vector + side * step), otf) for side in (1, -1))
        measured = np.asarray(high - low) / (2 * step[k])
        assert np.asarray(jacobian[k]) == pytest.approx(measured, abs=1e-5 * np.abs(measured).max()), name
    _, some = image_and_jacobian(parameters, otf, (0, 7, 9))
    assert np.asarray(some) == pytest.approx(np.asarray(jacobian)[[0, 7, 9]], rel=1e-9, abs=1e-6)


def test_what_changes_one_parameter_keeps_shutter_and_diffusion(otf):
    drift = Drifting(LINE, (30.0, -70.0))
    parameters = Parameters(scene(), Stable.of(), diffusion=0.01, shutter=drift)
    for other in (parameters.with_locus(Mvn.of(0.1)), to_vector(parameters)[1](to_vector(parameters)[0])):
        assert other.shutter is drift
        assert float(other.diffusion) == 0.01


def test_frames_of_other_drifts_are_one_compiled_program(otf):
    traced = []

    @eqx.filter_jit
    def image(parameters):
        traced.append(1)
        return expected_image(parameters, otf)

    for k in range(3):
        image(Parameters(scene(), Stable.of(), shutter=Drifting(LINE * (1 + k), (30.0 + k, -70.0))))
    assert len(traced) == 1


def test_what_cannot_be_a_shutter_is_refused_in_a_sentence(rng):
    t, x, y = record("walk", 0.05, rng)
    with refused(ErrorCode.WRONG_SHAPE, "()"):
        Drifting(LINE, 3.0)
    with refused(ErrorCode.OUT_OF_RANGE, 63, "nodes = 0"):
        Drifting(LINE, (1.0, 2.0), nodes=0)
    with refused(ErrorCode.OUT_OF_RANGE, -0.0009525, 0.0129525, f"{t[0]:g}", f"{t[-1]:g}"):
        Following.of(LINE, t, x, y, 0.0, WINDOW, ROWS)
    with refused(ErrorCode.MALFORMED, f"{t[-2]:g}", f"{t[-1]:g}"):
        Following.of(LINE, t[::-1], x, y, 0.01, WINDOW, ROWS)
    with refused(ErrorCode.SAMPLING, 63, "0.0127 s", ROWS):
        with_enough_nodes(Drifting(1e-4, (1e4, 0.0)), ROWS, 1.33)
