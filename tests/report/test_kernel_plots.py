import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from jitterkit.kernels import TransferRatio, kernel_image
from jitterkit.loci import Mvn
from jitterkit.report.kernel_plots import plot_kernel_image, plot_transfer


def ratio(angle=20.0, fitted=True):
    f = np.linspace(0.1, 1.0, 10)
    return TransferRatio(angle, f, np.sinc(0.5 * f), np.full(10, 0.02), np.sinc(0.5 * f) if fitted else None)


def test_functions_draw_on_the_axes_they_are_given():
    for draw in (
        lambda ax: plot_kernel_image(np.eye(3), ax),
        lambda ax: plot_transfer([ratio()], ax),
    ):
        ax = Figure().subplots()
        assert draw(ax) is ax


def test_a_kernel_of_pixels_stands_upright_with_its_ellipse():
    kernel = kernel_image(Mvn.of(0.8, 0.4, 30.0), 0.375)
    ax = plot_kernel_image(kernel, plate_scale=0.375)
    (ellipse,) = (patch for patch in ax.patches if isinstance(patch, Ellipse))
    assert (ellipse.width, ellipse.height, ellipse.angle) == pytest.approx((1.6, 0.8, 30.0))
    assert ax.get_images()[0].origin == "lower"
    assert ax.get_xlim()[1] == pytest.approx(kernel.shape[1] * 0.375 / 2)


def test_points_and_lines_of_a_transfer_function_are_distinguished_without_colours():
    ax = plot_transfer([ratio(20), ratio(110)])
    first, second = (container.lines[0] for container in ax.containers)
    assert first.get_marker() != second.get_marker()
    assert {line.get_linestyle() for line in ax.lines if len(line.get_xdata()) == 10} >= {"-", "--"}
    assert [text.get_text() for text in ax.get_legend().texts] == ["along 20.0°", "along 110°"]
    np.testing.assert_allclose(first.get_ydata(), np.sinc(0.5 * first.get_xdata()))
    assert len(plot_transfer([ratio(fitted=False)]).lines) == len(ax.lines) - 3
