"""What cannot be calibration frames is refused in one sentence: file, value, remedy."""

import re

import numpy as np
import pytest

from jitterkit.calibration import Settings, Stack, calibrate, open_stacks
from jitterkit.errors import ConfigurationError, FrameError
from jitterkit.frames import write_fits


def frames(rng, level, count=3, shape=(32, 32)):
    return np.rint(rng.normal(level, 2.0, (count, *shape))).astype(np.uint16)


def refused(match):
    return pytest.raises(ConfigurationError, match=match)


def test_nothing_at_all():
    with refused("neither bias nor dark nor flat frames"):
        calibrate()


def test_shapes_that_differ(rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 100))
    write_fits(tmp_path / "b.fits", frames(rng, 100, shape=(30, 32)))
    with pytest.raises(FrameError, match=r"b\.fits: has 32 x 30 pixels, the bias frames before it 32 x 32"):
        open_stacks("bias", [tmp_path])
    bias, dark = (
        Stack.of(kind, frames(rng, 100, shape=(ny, 32)), t)
        for kind, ny, t in (("bias", 32, None), ("dark", 30, 1.0))
    )
    with refused(r"dark\[0\]: has 32 x 30 pixels, the bias frames 32 x 32"):
        calibrate(bias, [dark], gain=1.0)


def test_one_frame(rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 100, 1)[0])
    with refused(r"a\.fits: there is one bias frame; give at least two"):
        open_stacks("bias", [tmp_path])
    with refused("there is one dark, 2 s frame; give at least two"):
        calibrate(None, [Stack.of("dark", frames(rng, 100, 1), 2.0)], gain=1.0)


def test_a_missing_exposure(rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 100))
    with refused(r"a\.fits: the dark frame does not say its exposure; give --exposure in s"):
        open_stacks("dark", [tmp_path])


def test_electrons(rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 100), header={"BUNIT": "electron"})
    with pytest.raises(FrameError, match=r"a\.fits: is in electrons; give the flat frames as they were read"):
        open_stacks("flat", [tmp_path])


def test_a_flat_among_the_biases(rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 100, 5))
    write_fits(tmp_path / "b.fits", frames(rng, 900, 1)[0])
    (stack,) = open_stacks("bias", [tmp_path])
    with refused(r"b\.fits: its level is 900[.\d]* ADU, that of the bias frames 100[.\d]* ± "):
        calibrate(stack, gain=1.0)
    with pytest.raises(ConfigurationError, match=re.escape(str(tmp_path / "b.fits"))):
        calibrate(stack, gain=1.0)


def test_a_bias_among_the_flats(rng):
    bias = Stack.of("bias", frames(rng, 100, 4))
    with refused(r"flat\[2\]: holds no light \((99|100)[.\d]* ADU, the bias is 100"):
        calibrate(
            bias, (), [Stack.of("flat", np.concatenate([frames(rng, 900, 2), frames(rng, 100, 1)]), 1.0)]
        )
    with refused(r"flat\[2\]: is the only flat, 1 s frame of (499|500)"):
        calibrate(
            bias, (), [Stack.of("flat", np.concatenate([frames(rng, 900, 2), frames(rng, 500, 1)]), 1.0)]
        )


def test_darks_below_the_bias(rng):
    with refused(r"dark\[0\]: the dark, 1 s frames lie at (49|50).* ADU, below the bias of (99|100)"):
        calibrate(Stack.of("bias", frames(rng, 100)), [Stack.of("dark", frames(rng, 50), 1.0)], gain=1.0)


def test_gains_that_differ(rng, tmp_path):
    for i, gain in enumerate((1.5, 1.5, 3.0)):
        write_fits(tmp_path / f"{i}.fits", frames(rng, 100, 1)[0], header={"EGAIN": gain})
    with refused(r"2\.fits: says a gain of 3 e-/ADU, .*0\.fits one of 1\.5; calibrate each setting"):
        calibrate(open_stacks("bias", [tmp_path])[0])


def test_flats_without_a_bias_and_darks_of_one_exposure(rng):
    with refused("flats say nothing without the bias they stand on; give --bias"):
        calibrate(None, (), [Stack.of("flat", frames(rng, 900), 1.0)])
    with refused("the dark frames have one exposure time only and there is no bias"):
        calibrate(None, [Stack.of("dark", frames(rng, 100), 1.0)], gain=1.0)


def test_electrons_without_a_gain(rng):
    with refused("the gain is unknown, .* give --gain, or flats"):
        calibrate(Stack.of("bias", frames(rng, 100)))


@pytest.mark.parametrize(("name", "value"), [("clip", 2.0), ("hot", 1.0), ("dead", 1.5)])
def test_settings_out_of_range(name, value):
    with refused(f"{name} = {value:g} is out of range; give"):
        Settings(**{name: value})


def test_arrays_that_are_no_stacks():
    with refused(r"the bias frames have shape \(8, 8\); give one array \(n, ny, nx\)"):
        Stack.of("bias", np.zeros((8, 8)))
