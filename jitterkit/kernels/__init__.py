"""What is done with a kernel: files that other tools read, measures of its quality, deblurring.

:func:`kernel_image` draws an estimate or a locus on pixels, :func:`write_kernel` gives it to photutils,
stpsf, GalSim and dLux, :func:`kernel_quality` says how good it is, and :func:`deblur` shows what an image
looks like without it.
"""

from jitterkit.kernels.deblurring import METHODS, deblur, fill_masked
from jitterkit.kernels.files import StoredKernel, in_rows, kernel_cards, read_kernel, write_kernel
from jitterkit.kernels.image import kernel_image, kernel_moments, locus_of
from jitterkit.kernels.quality import KernelQuality, kernel_quality, kernel_transfer
from jitterkit.kernels.ratio import TransferRatio, transfer_ratio
