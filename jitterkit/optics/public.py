"""The public model's own image of alpha Centauri, for comparison: dLuxToliman under linear jitter."""

from __future__ import annotations

from collections.abc import Callable

from jitterkit.errors import ConfigurationError, ErrorCode

PUBLIC_LINES = (530.0, 585.0, 640.0)
"""nm, equally strong: what it takes for a band here."""

PUBLIC_SHAPE = (128, 128)


def public_image(images: int = 5, samples: int = 4) -> Callable:
    """Return the public model's frame of alpha Centauri under linear jitter.

    Parameters
    ----------
    images : int
        Along the smear.
    samples : int
        Points along the side of a pixel.

    Returns
    -------
    image : callable
        Of a vector of 15: separation [arcsec], position angle [deg], x, y [arcsec], log10 of the flux,
        contrast, seven aberrations [m], length [arcsec] and angle [deg] of the smear.  Returns (128, 128).

    Raises
    ------
    ConfigurationError
        If dLuxToliman is not installed.
    """
    import equinox as eqx

    try:
        from dLuxToliman import AlphaCen, JitteredToliman, TolimanOpticalSystem
    except ImportError:
        raise ConfigurationError(
            ErrorCode.MISSING_PACKAGE, "dLuxToliman is not installed; install jitterkit[toliman]."
        ) from None
    optics = TolimanOpticalSystem(noll_indices=list(range(4, 11)), oversample=samples)
    source = AlphaCen(n_wavels=len(PUBLIC_LINES))
    telescope = JitteredToliman(optics, source, 0.1, 0.0, n_psfs=images, jitter_shape="linear")

    def where(t):
        s = t.source
        scene = [s.separation, s.position_angle, s.x_position, s.y_position, s.log_flux, s.contrast]
        return [*scene, t.optics.layers["aperture"].coefficients, t.jitter_mag, t.jitter_angle]

    def image(vector):
        values = [*vector[:6], vector[6:13], vector[13], vector[14]]
        fine = eqx.tree_at(where, telescope, values).jitter_model()
        return fine.reshape(PUBLIC_SHAPE[0], samples, PUBLIC_SHAPE[1], samples).sum(axis=(1, 3))

    return image
