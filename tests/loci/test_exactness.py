"""How far in frequency a locus is exact, and what fewer nodes of its integral make of that."""

import numpy as np
import pytest

from jitterkit.loci import Ellipse, Linear, Mvn, PartialShm, Path, Product, Shaped, Shm, Smear, Tones, Trace

TIMES = np.array([0.0, 0.07, 0.2, 0.26, 0.4, 0.55, 0.6, 0.83, 0.9, 1.0])
LONG = {
    "partial": PartialShm.of(3.2, 40.0, 0.7, 25.0),
    "shaped": Shaped.of(0.8, 0.4, 65.0, -1.2),
    "path": Path.of([[0.0, 0.0], [1.6, 0.4], [2.0, 1.6], [1.2, 2.4]]),
    "trace": Trace.of(TIMES, 1.2 * np.sin(9 * TIMES), 2.0 * TIMES**2),
}
FORMULAE = [
    Linear.of(30.0, 20.0),
    Shm.of(24.0, 110.0),
    Mvn.of(8.0, 4.0, 65.0),
    Ellipse.of(16.0, 6.0, 140.0),
    Tones.of(24.0, 15.0, 16.0, 105.0),
    Smear.of(20.0, 30.0, 4.0, 2.0, 70.0),
    Shaped.of(8.0, 4.0, 65.0, 1.0),
]


def off_the_points(locus, f):
    """Most by which the transfer function along x is off the mean phasor over many points of the path."""
    along = locus.points(65536)[:, 0]
    mean = np.array([np.exp(-2j * np.pi * frequency * along).mean() for frequency in f])
    return np.abs(np.asarray(locus.transfer(f, 0 * f)) - mean).max()


@pytest.mark.parametrize("kind", LONG)
def test_a_locus_says_how_far_it_is_exact(kind):
    locus = LONG[kind]
    f = locus.exact_to() * np.linspace(0.5, 1.0, 21)
    assert np.all(np.isfinite(f))
    # points on rings are a lattice, good to 1e-3
    assert off_the_points(locus, f) < (2e-3 if kind == "shaped" else 1e-4)
    assert off_the_points(locus, 3 * f) > 1e-2


@pytest.mark.parametrize(("kind", "nodes"), [("partial", 12), ("partial", 24), ("path", 4), ("path", 8)])
def test_with_fewer_nodes_it_is_exact_less_far_and_says_so(kind, nodes):
    own = LONG[kind]
    locus = own.sampled(nodes)
    f = locus.exact_to() * np.linspace(0.5, 1.0, 21)
    assert f[-1] < 0.7 * own.exact_to()
    assert off_the_points(locus, f) < 1e-4
    assert off_the_points(locus, 3 * f) > 1e-2
    assert locus.at(locus.coords).nodes == nodes
    assert own.sampled(own.nodes).exact_to() == own.exact_to()


@pytest.mark.parametrize("locus", FORMULAE, ids=lambda locus: type(locus).__name__)
def test_a_formula_is_exact_everywhere(locus):
    assert locus.exact_to() == np.inf
    assert locus.sampled(3) is locus


def test_a_product_is_as_exact_as_its_worst_part():
    path = LONG["path"]
    product = Product(Mvn.of(0.1), path, Linear.of(1.0))
    assert product.exact_to() == path.exact_to()
    assert product.sampled(5).exact_to() == path.sampled(5).exact_to() < path.exact_to()
