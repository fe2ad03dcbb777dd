"""Remarks about a frame as one integer, and back.

A remark does not invalidate a frame's numbers; its status would.  The code travels in the ``flags``
column, the meanings in the table's metadata, so that a file explains itself.
"""

from __future__ import annotations

from collections.abc import Iterable

#: Every remark and its meaning; the bit is the place in the list, so add at the end only.
FLAGS: dict[str, str] = {
    "other": "a remark without a bit of its own; the message ends with it",
    "saturated": "saturated pixels were masked",
    "jitter_undetected": "the blur does not differ from none",
    "misfit": "chi-squared is further from its degrees of freedom than chance allows",
    "degenerate": "the frame does not determine every parameter; some errors are not to be trusted",
    "gain_assumed": "nobody said the gain, so errors and chi-squared rest on an assumption",
    "read_noise_assumed": "nobody said the read noise, so errors and chi-squared rest on an assumption",
    "bias_assumed": "nobody said the bias level, so the background rests on an assumption",
    "above_adc_range": "a value lies beyond the detector's bits: the frame may come from another detector",
    "header_odd": "the header says something odd; the frame's metadata warns of it",
    "masked": "bad or missing pixels were masked",
    "cut_out": "the region about the stars was cut out of a larger frame",
    "aberrations_held": "aberrations that the image does not show to first order were not fitted",
    "prior_contradicted": "the frame lies further from the prior it was given than chance allows",
    "prior_unused": "the prior holds this frame only and was not used",
    "dark_not_subtracted": "the exposure is not known, so the dark current was not subtracted",
    "rays_masked": "pixels hit by cosmic rays were found by the fit and masked",
    "outlier": "the frame contradicts the others of its sequence and was not counted",
    "maybe_pair": "one star that moves was fitted, or two close ones: both look alike",
    "outliers_left_out": "single pixels that do not belong to the image were found and left out",
    "blur_varies": "the stars of the field differ in their blur: the PSF changes over it, or it rolled",
    "faint_companion": "the companion is faint and close enough to be an error of the optics",
    "further_stars": "stars beside those of the scene were found and fitted",
    "model_error": "errors of the optics were allowed for: errors are larger than by noise alone",
    "scale_degenerate": "the fitted plate scale makes the error of the separation more than twice as large",
    "prior_namesake": "the prior was estimated from a frame of this name with other pixels",
    "noise_correlated": "the noise of neighbouring pixels is correlated, as resampling or smoothing leaves "
    "it: that is part of the blur, and errors are not valid",
    "sign_unknown": "the pupil is its own mirror image: focus, astigmatism and other even aberrations may "
    "all have the other sign",
}


def encode_flags(words: Iterable[str]) -> int:
    """Code of some remarks; one that is not in :data:`FLAGS` counts as ``other``.

    >>> encode_flags(["saturated", "misfit"])
    10
    """
    bits = {word: bit for bit, word in enumerate(FLAGS)}
    return sum(1 << bit for bit in {bits.get(word, 0) for word in words})


def decode_flags(code: int) -> tuple[str, ...]:
    """Words of a code; bits of a later version than this are left out.

    >>> decode_flags(10)
    ('saturated', 'misfit')
    """
    return tuple(word for bit, word in enumerate(FLAGS) if int(code) >> bit & 1)


def flag_meanings() -> dict[int, str]:
    """Meaning of each bit's value, as kept in a table's metadata."""
    return {1 << bit: f"{word}: {meaning}" for bit, (word, meaning) in enumerate(FLAGS.items())}
