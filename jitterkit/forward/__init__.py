"""The forward model: from a scene, a jitter locus and a telescope to the expected image.

    image = crop . IFFT{ sinc(p fx) sinc(p fy) M(f) sum_s OTF_s(f) F_s exp(-2 pi i f.r_s) }

Every factor is exact at every frequency of the grid, and the optics pass no frequency beyond it, so
the image is exact too, up to the light that the padding lets wrap around.  A rolling shutter blends a few
such images row by row: :mod:`jitterkit.shutter`.  One formula serves fitting, forecasting and simulation;
:func:`image_and_jacobian` differentiates it.
"""

from jitterkit.forward.image import background_of, displacement_effect, expected_image, image_and_jacobian
from jitterkit.forward.parameters import (
    GRADIENT,
    Parameters,
    free_parameters,
    held_with,
    parameter_names,
    to_vector,
)
