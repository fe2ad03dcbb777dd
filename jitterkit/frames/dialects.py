"""Keywords of the numbers about a frame, by who wrote the header.

:data:`ALIASES` are everybody's.  :data:`DIALECTS` are observatories whose keywords are their own, or mean
something else than everybody's.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

Keyword = str | tuple[str, ...]
"""A keyword, or those of the amplifiers of one detector, of which the mean is taken."""


def _of_eso(name: str) -> tuple[str, ...]:
    return tuple(f"ESO DET OUT{number} {name}" for number in range(1, 5))


ALIASES: Mapping[str, tuple[Keyword, ...]] = {
    "exposure": ("EXPTIME", "EXPOSURE", "EXP_TIME", "XPOSURE"),
    "gain": ("EGAIN", "EPERADU", "CVF", _of_eso("CONAD"), "GAIN"),
    "read_noise": ("RDNOISE", "READNOIS", "READNOISE", "READNOI", "RON", "ENOISE", _of_eso("RON")),
    "saturation": ("SATURATE", "SATLEVEL", "MAXLIN", "DATAMAX"),
    "bias": ("BIASLVL", "BIASLEV", "SOFTBIAS"),
    "plate_scale": ("PIXSCALE", "PIXSCAL1", "SCALE", "SECPIX", "SECPIX1", "PIXELSCL"),
    "va_factor": ("VAFACTOR", "VA_SCALE"),
    "line_time": ("LINETIME",),
}
"""Keywords of each number, the first believed first."""


@dataclass(frozen=True)
class Dialect:
    """Keywords of one observatory.

    Parameters
    ----------
    name : str
    key, pattern : str
        It is spoken where the text of ``key`` matches ``pattern``.
    keywords : mapping
        By number; asked before everybody's.
    others : frozenset of str
        Keywords of everybody's that mean something else here.
    of_cubes : mapping
        As ``keywords``, asked before them for an image of several planes.
    """

    name: str
    key: str
    pattern: str
    keywords: Mapping[str, tuple[Keyword, ...]]
    others: frozenset[str] = field(default_factory=frozenset)
    of_cubes: Mapping[str, tuple[Keyword, ...]] = field(default_factory=dict)


DIALECTS = (
    Dialect(
        "JWST", "TELESCOP", r"^JWST$",
        {"exposure": ("XPOSURE", "EFFEXPTM", "EFFINTTM")}, frozenset({"EXPOSURE"}),
        of_cubes={"exposure": ("EFFINTTM",)},  # a plane is one integration, an image their mean
    ),
    Dialect(
        "HST", "TELESCOP", r"^HST$",
        {
            "gain": (("ATODGNA", "ATODGNB", "ATODGNC", "ATODGND"), "ATODGAIN", "CCDGAIN", "ADCGAIN"),
            "read_noise": (("READNSEA", "READNSEB", "READNSEC", "READNSED"), "READNSE"),
        },
    ),
    Dialect(
        "DECam", "INSTRUME", r"^DECam$",
        {"gain": (("GAINA", "GAINB"),), "read_noise": (("RDNOISEA", "RDNOISEB"),)},
    ),
    Dialect("Spitzer", "TELESCOP", r"^Spitzer$", {"read_noise": ("RONOISE",)}),
)  # fmt: skip

OBSERVATORIES = re.compile(
    r"\b(NOAO(?!-IRAF)|NOIRLAB|KPNO|CTIO|WIYN|SOAR|GEMINI-(NORTH|SOUTH)|GMOS|SAAO|ESO(?!-MIDAS)|STSCI|HST|SPITZER|CFHT|SUBARU|"
    r"KECK|LCOGT|OCIW|MAGELLAN|MMTO|LBTO|PALOMAR|LICK|CAHA|CALAR ALTO|SDSS|2MASS|UKIRT|AAO|SIDING SPRING|"
    r"IUCAA|IIA|MCDONALD|PAN-?STARRS|DECAM)\b",
    re.I,
)
"""Who means e-/ADU by GAIN, in the observatory, telescope, instrument or origin of a header."""

_CAPTURE_SOFTWARE = (
    "n.i.n.a", "nina", "nighttime imaging", "sharpcap", "asiair", "asi air", "zwo", "asistudio", "asiimg",
    "firecapture", "astro photography tool", "kstars", "ekos", "indi", "sequence generator", "sgpro", "phd2",
    "astrodmx", "voyager", "maxim", "theskyx", "ezcap", "toupsky", "siril", "astap", "indigo", "ain imager",
    "ccdciel", "qhy", "pixinsight", "astroart", "apt", "nebulosity", "stellarmate", "seestar", "dwarf",
    "altaircapture", "player one", "prism", "deepskystacker", "oacapture", "lucam", "astroimager",
    "toupcam", "touptek", "svbony", "atik", "altair", "canon", "nikon",
)  # fmt: skip
SOFTWARE_KEYS = ("SWCREATE", "SOFTWARE", "CREATOR", "PROGRAM", "SWMODIFY", "APPLICAT", "ORIGIN", "INSTRUME")

CAPTURE_PROGRAM = re.compile(rf"(?<![a-z])({'|'.join(map(re.escape, _CAPTURE_SOFTWARE))})(?![a-z])", re.I)
"""Programs and makes of cameras in whose files GAIN is a camera setting; "India" is not INDI."""
