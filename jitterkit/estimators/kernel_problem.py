"""The kernel as shares of light on a fine grid: the linear problem that the non-parametric estimators solve.

A frame is a sum of shifted templates, one a node, and the kernel is how much of each: no model of the
motion at all.  The shifts are exact (the template is evaluated at each, not interpolated) and the nodes
are points, so the moments of a kernel are those of its shares: nothing is owed to the width of a
pixel.  Frequencies beyond the optics' cutoff are not in the data: the moments are measured, but the
kernel drawn is one of many that would do.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple

import numpy as np
import scipy.linalg
import scipy.optimize

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.forward import Parameters, background_of, expected_image
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.likelihood import Data
from jitterkit.loci import Stable
from jitterkit.optics.otf import OTF

_GRIDS = ((5, 1), (3, 2), (2, 4))
"""Nodes per pixel along each axis, and pixels on either side of the middle one: tried in turn until the
kernel fits.  With 3 nodes a pixel, the moments of a drift of 0.225 arcsec are 9 % too large."""

_BORDER = 0.02
"""Share of the light on the outermost nodes above which the kernel does not fit."""

_RIDGE = 1e-11
"""Added to the curvature, as a share of its trace: what the data leave open stays small and the search for
the maximum ends.  It moves the moments by less than a hundredth of an error."""

_ITERATIONS_PER_NODE = 30
"""Steps of the search a node: ten times what SciPy allows, for frames without noise."""

_FLOOR = 1e-3
"""Least expected count, as a share of the frame's mean: ringing must not make it negative."""


class KernelProblem(NamedTuple):
    """Likelihood of the nodes' shares ``k`` near its maximum: ``-k'Gk/2 + b'k``, for ``k >= 0``.

    Attributes
    ----------
    curvature : (n, n) array
        ``G``.
    pull : (n,) array
        ``b``.
    dark : (n,) array
        What read noise adds to ``b`` and ``Gk`` alike in the shifted Poisson law; zero without.
    """

    curvature: np.ndarray
    pull: np.ndarray
    dark: np.ndarray

    def deviance(self, shares: np.ndarray) -> float:
        """Minus twice the log-likelihood, up to a constant."""
        return float(shares @ (self.curvature @ shares) - 2 * self.pull @ shares)


def best_shares(problem: KernelProblem) -> np.ndarray:
    """The maximum itself: Lawson and Hanson's algorithm, from SciPy, on a root of the normal equations."""
    root = np.linalg.cholesky(problem.curvature)
    target = scipy.linalg.solve_triangular(root, problem.pull, lower=True)
    try:
        shares, _ = scipy.optimize.nnls(root.T, target, maxiter=_ITERATIONS_PER_NODE * len(target))
    except RuntimeError as error:
        message = "The search for a kernel does not end: too little of the frame is left; mask less of it."
        raise UndeterminedError(ErrorCode.NOT_CONVERGED, message) from error
    return shares


class _Nodes(NamedTuple):
    """Templates (n, m) on the pixels left after trimming, offsets (n, 2) [arcsec] and how they lie."""

    templates: np.ndarray
    offsets: np.ndarray
    per_pixel: int
    reach: int

    def trim(self, image) -> np.ndarray:
        """Return the pixels to which every shift brings light from within the frame."""
        return _trimmed(np.asarray(image), self.reach)


def solve_kernel(
    data: Data, template: Parameters, otf: OTF, solver: Callable[[KernelProblem], np.ndarray], method: str
) -> KernelEstimate:
    """Estimate a kernel with some solver of the non-negative problem, and its moments.

    Parameters
    ----------
    data : Data
    template : Parameters
        Scene and aberrations; its locus is ignored.
    otf : OTF
    solver : callable
        From a :class:`KernelProblem` to shares (n,), none negative.
    method : str
        The estimator's name.

    Returns
    -------
    estimate : KernelEstimate
        Moments about the kernel's own centroid, so that a misplaced template does not count as blur;
        ``kernel`` on the frame's pixels, its sum one.

    Raises
    ------
    UndeterminedError
        If the kernel does not fit on the largest grid: a blur of several pixels, or none to be seen.
    """
    for per_pixel, reach in _GRIDS:
        if min(otf.grid.shape) <= 4 * reach:
            break
        nodes = _shifted_templates(template, otf, per_pixel, reach)
        problem, best = _problem(data, nodes, np.asarray(background_of(template, otf.grid)))
        if best.sum() > 0 and _border(best) < _BORDER:
            return _summary(solver(problem), _response(problem, best), nodes, method)
    raise UndeterminedError(
        ErrorCode.MODEL_MISMATCH,
        f"No kernel within {_GRIDS[-1][1]} pixels of its middle makes this image of the template; "
        "use the score estimator where the frame is faint, and check the template where it is not.",
    )


def _shifted_templates(template: Parameters, otf: OTF, per_pixel: int, reach: int) -> _Nodes:
    """The template at every node: evaluated at each position within a pixel, and moved by whole pixels."""
    side, scale = per_pixel * (2 * reach + 1), otf.grid.plate_scale
    steps = np.arange(side) - (side - 1) / 2  # in nodes
    whole = np.rint(steps / per_pixel).astype(int)
    fractions = np.round(steps / per_pixel - whole, 9).tolist()  # within a pixel
    images = {
        (j, i): _displaced(template, otf, i * scale, j * scale)
        for j in set(fractions)
        for i in set(fractions)
    }
    rows = [
        _trimmed(np.roll(images[j, i], (q, p), (0, 1)), reach).ravel()
        for j, q in zip(fractions, whole, strict=True)
        for i, p in zip(fractions, whole, strict=True)
    ]
    y, x = np.meshgrid(steps, steps, indexing="ij")
    offsets = np.stack([x.ravel(), y.ravel()], axis=1) * scale / per_pixel
    return _Nodes(np.array(rows), offsets, per_pixel, reach)


def _displaced(template: Parameters, otf: OTF, x: float, y: float) -> np.ndarray:
    """Return the sharp template (ny, nx), without background, moved by ``x, y`` arcsec."""
    scene = template.scene.shifted(x, y)
    still = Parameters(
        scene, Stable.of(), template.aberrations, diffusion=template.diffusion, shutter=template.shutter
    )
    return np.asarray(expected_image(still, otf))


def _trimmed(image: np.ndarray, margin: int) -> np.ndarray:
    return image[margin : image.shape[0] - margin, margin : image.shape[1] - margin]


def _problem(data: Data, nodes: _Nodes, background: np.ndarray) -> tuple[KernelProblem, np.ndarray]:
    """The problem with the weights of its own solution, from a first one without blur; and that solution."""
    weights = np.broadcast_to(data.weight, data.used.shape)
    parts = data.electrons - background, data.offset, data.used, weights, background
    counts, offset, used, weight, background = (nodes.trim(part).ravel() for part in parts)
    if not used.any():
        problem = "No usable pixel is left for a kernel; mask less of the frame."
        raise UndeterminedError(ErrorCode.NO_DATA, problem)

    def weighed(mean) -> KernelProblem:
        least = _FLOOR * np.abs(mean).mean()
        weights = np.where(used, weight / (np.maximum(mean + background, least) + offset), 0.0)
        weighted = nodes.templates * weights
        curvature = weighted @ nodes.templates.T
        curvature += _RIDGE * np.trace(curvature) * np.eye(len(curvature))
        return KernelProblem(curvature, weighted @ counts, weighted @ (background + offset))

    middle = nodes.templates[len(nodes.templates) // 2]
    first = best_shares(weighed(middle * max(counts[used].sum(), 1.0) / middle[used].sum()))
    return weighed(first @ nodes.templates), first


def _border(shares: np.ndarray) -> float:
    """Return the share of the light on the outermost nodes."""
    side = int(np.sqrt(len(shares)))
    square = shares.reshape(side, side)
    return 1 - float(square[1:-1, 1:-1].sum() / square.sum())


def _summary(shares: np.ndarray, response: np.ndarray, nodes: _Nodes, method: str) -> KernelEstimate:
    """Central moments, their covariance, and the kernel on the frame's pixels."""
    total = shares.sum()
    x, y = (nodes.offsets - shares @ nodes.offsets / total).T
    products = np.stack([x * x, x * y, y * y])
    moments = products @ shares / total
    slopes = (products - moments[:, None]) / total
    n = 2 * nodes.reach + 1
    kernel = shares.reshape(n, nodes.per_pixel, n, nodes.per_pixel).sum((1, 3)) / total
    return KernelEstimate(moments, slopes @ response @ slopes.T, method, kernel=kernel)


def _response(problem: KernelProblem, best: np.ndarray) -> np.ndarray:
    """Return the covariance (n, n) of the best shares, by linear response: those at zero stay there."""
    alive = np.flatnonzero(best)
    response = np.zeros_like(problem.curvature)
    response[np.ix_(alive, alive)] = np.linalg.inv(problem.curvature[np.ix_(alive, alive)])
    return response


def estimate_nnls(
    data: Data, template: Parameters, otf: OTF, *, hold: Collection[str] = ()
) -> KernelEstimate:
    """Estimate the kernel by non-negative least squares with the weights of photon and read noise.

    Parameters
    ----------
    data : Data
    template : Parameters
        Scene and aberrations; its locus is ignored.  Its position and flux need not be exact.
    otf : OTF
    hold : collection of str
        For the sake of a common signature: everything but the kernel is held at the template's values.

    Returns
    -------
    estimate : KernelEstimate
        The moments of any motion, drift or vibration, without a model of it.

    Raises
    ------
    UndeterminedError
        If the kernel does not fit: a blur of several pixels, or a frame too faint.

    Notes
    -----
    A kernel that cannot be negative has no negative moments: with no blur in the frame, the mean of the
    estimates lies above zero by about their error.  The kernel itself is a few spikes: it draws a smooth
    motion as dots that the frame does not distinguish from it (:func:`estimate_richardson_lucy` draws it
    smooth).
    """
    return solve_kernel(data, template, otf, best_shares, "nnls")


_FIRST, _MOST = 64, 2**15
"""Updates before the first look at the deviance, and at most."""

_NOISE = 0.1
"""Deviance that another doubling of the updates must gain; one is a standard error in one direction."""

_LEAST_STEP = 0.1
"""Of a share that an extrapolation may leave: what is at zero never returns."""

_TINY = np.finfo(float).tiny


def estimate_richardson_lucy(
    data: Data, template: Parameters, otf: OTF, *, hold: Collection[str] = ()
) -> KernelEstimate:
    """Estimate the kernel by accelerated Richardson-Lucy updates from a flat one.

    Parameters
    ----------
    data : Data
    template : Parameters
        Scene and aberrations; its locus is ignored.  Its position and flux need not be exact.
    otf : OTF
    hold : collection of str
        For the sake of a common signature: everything but the kernel is held at the template's values.

    Returns
    -------
    estimate : KernelEstimate
        The moments of any motion, without a model of it.

    Raises
    ------
    UndeterminedError
        If the kernel does not fit: a blur of several pixels, or a frame too faint.

    Notes
    -----
    ``k <- k (A'Wd)/(A'WAk)`` with ``W`` the inverse variance of the blurred image, renewed once: where
    ``W`` is that of ``Ak`` itself this is Richardson's and Lucy's update, and it runs on the normal
    equations, in microseconds.  The extrapolation is that of Biggs and Andrews (Appl. Opt. 36, 1766,
    1997).  It ends when twice as many updates gain less deviance than noise does.  An update at the
    usual few dozen is far from the data of a bright star: the kernel is then the flat start, sharpened a
    little.  Moments are biased as those of :func:`estimate_nnls` are.
    """
    return solve_kernel(data, template, otf, _solve, "richardson-lucy")


def _solve(problem: KernelProblem) -> np.ndarray:
    curvature, dark = problem.curvature, problem.dark
    wanted = np.maximum(problem.pull + dark, 0.0)
    shares = np.full(len(wanted), max(problem.pull.sum(), 0.0) / curvature.sum())
    ahead, step, deviance, look = shares, np.zeros_like(shares), np.inf, _FIRST
    for n in range(1, _MOST + 1):
        before, last = shares, step
        shares = ahead * wanted / (curvature @ ahead + dark)
        step = shares - ahead
        pace = min(max(step @ last / (last @ last + _TINY), 0.0), 1.0)
        ahead = np.maximum(shares + pace * (shares - before), _LEAST_STEP * shares)
        if n == look:
            found = problem.deviance(shares)
            if deviance - found < _NOISE:
                break
            deviance, look = found, 2 * look
    return shares
