import numpy as np
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.instruments import load_instrument
from jitterkit.loci import Linear, Trace
from jitterkit.scene import Binary
from jitterkit.simulate import simulate_frame, simulate_sequence


def test_every_frame_may_have_a_locus_of_its_own():
    telescope, scene = load_instrument("smallsat"), Binary(10.0, 180.0, 0.0, 0.0, 1e5, 3.37)
    t = np.linspace(0, 0.1, 5)
    loci = [Trace.of(t, speed * t, 0 * t) for speed in (1.0, 6.0)]
    frames = list(simulate_sequence(telescope, scene, loci, 2, detector=False))
    assert [frame.raw.index for frame in frames] == [0, 1]
    for frame, speed in zip(frames, (1.0, 6.0), strict=True):
        alone = simulate_frame(telescope, scene, Linear.of(0.1 * speed), detector=False)
        # three nodes a piece of a 64th of a second, 5e-7 d^6 with d = 2 pi 1.33 * 0.15
        np.testing.assert_allclose(frame.raw.data, alone.raw.data, atol=1e-5 * alone.raw.data.max())


def test_loci_that_are_not_one_a_frame_are_refused():
    sequence = simulate_sequence(load_instrument("smallsat"), Binary(10.0, 0.0, 0.0, 0.0, 1e5, 3.0), [], 2)
    with refused(ErrorCode.WRONG_SHAPE, "locus", 0, 2):
        next(sequence)
