"""jitterkit: telescope jitter from images, and the binary separation behind it.

Nothing is imported here, so that ``import jitterkit`` costs nothing.  The packages, in the order in which
the light passes through them:

``frames``        read and write FITS and TIFF, with where each number came from
``detectors``     ADU to electrons and back
``instruments``   a telescope, its light and its detector, as a preset or a TOML file
``optics``        pupil to transfer function
``loci``          the paths a pointing draws, as exact transfer functions
``forward``       scene, jitter and optics to an expected image, and its derivatives
``locate``        the star pair in a frame
``estimators``    frame to kernel estimate, with known optics
``starfield``     the blur of a field of stars, and whether it is tracking or optics
``extended``      the blur of scenes without stars, and the drift between frames
``kernels``       kernels as files for other tools, their quality, deblurring
``refit``         frame and estimate to separation, with errors
``simulate``      frames whose truth is known
``batch``         many frames
``report``        tables, pictures, HTML
"""
