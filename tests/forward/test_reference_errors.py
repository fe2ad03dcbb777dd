"""The separation errors that the project stands on (SCIENCE, section 1), with exact numerics."""

import pytest

from jitterkit.loci import Linear, Shm, Stable


@pytest.mark.parametrize(
    ("locus", "flux", "read_noise", "expected"),
    [
        (Stable.of(), 3.811e7, 0.0, 242.6),
        (Stable.of(), 9.53e6, 0.0, 485.2),
        (Stable.of(), 9.53e6, 2.4, 487.0),
        (Stable.of(), 9.53e6, 3.0, 487.9),
        (Stable.of(), 9.53e6, 10.0, 509.0),
        (Linear.of(0.75), 9.53e6, 0.0, 677.0),
        (Shm.of(0.75), 9.53e6, 0.0, 788.0),
    ],
    ids=["paper flux", "true flux", "2.4 e-", "3 e-", "10 e-", "linear", "shm"],
)
def test_one_frame_determines_the_separation_to_the_published_error(
    reference_otf, sigma_separation, locus, flux, read_noise, expected
):
    assert sigma_separation(reference_otf, locus, flux, read_noise) == pytest.approx(expected, rel=0.005)
