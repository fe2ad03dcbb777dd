"""Units that headers write: of pixel values, times, angles and noise, and where in a card they count.

:func:`resolve_unit` is for pixel values; :func:`stated_unit` finds the unit in a card's value or comment;
:func:`factor` converts it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache, lru_cache, partial

#: Units of pixel values that a detector converts; the exposure turns the rates into counts.
COUNTS = ("adu", "electron")
RATES = ("adu/s", "electron/s")

#: Spellings of the unit of a pixel value, in lower case, without blanks and "per pixel".
UNITS: Mapping[str, str] = {
    **dict.fromkeys(
        ("adu", "adus", "adu1", "rawadu", "count", "counts", "ct", "cts", "cnt", "cnts", "dn", "dns",
         "d.n.", "du", "dataunit", "dataunits", "datavalue", "datanumber", "datanumbers",
         "digitalnumber", "digitalnumbers", "lsb"), "adu"
    ),
    **dict.fromkeys(
        ("electron", "electrons", "e", "e-", "e^-", "el", "elec", "photoelectron", "photoelectrons",
         "photo-electron", "photo-electrons", "electron1"), "electron"
    ),
    "cps": "adu/s",
}  # fmt: skip

_PER_PIXEL = re.compile(r"(/|per)\s*pix(el)?s?(?![a-z])|[ .*]pix(el)?s?(\*\*|\^)?\(?-1\)?", re.I)
_PER_BOTH = re.compile(r"/ ?\((?:pix(?:el)?s?[ .*]+)?(s|sec|seconds?)(?:[ .*]+pix(?:el)?s?)?\)", re.I)
"""Per pixel and second in brackets, as astropy writes: "electron / (pix s)"."""

_PER_SECOND = re.compile(r"(?P<counts>.+?)((/|per)(s|secs?|seconds?)|[.*]?(s|sec|second)(\*\*|\^)?\(?-1\)?)")


def resolve_unit(text: str) -> str | None:
    """Read the unit of a pixel value leniently.

    Parameters
    ----------
    text : str
        As found in ``BUNIT`` or a TOML: ``"e-"``, ``"electrons"``, ``"counts/s"``, ``"DN"``, ``""``.

    Returns
    -------
    unit : {"adu", "electron", "adu/s", "electron/s"} or None
        None where the text says none of them; an empty text is ``"adu"``.
    """
    text = _PER_PIXEL.sub("", _PER_BOTH.sub(r"/\1", text))
    twice = re.fullmatch(r"([^([]+)[([](.+)[])]", text.strip())  # "Counts (ADU)"
    if twice:
        unit = resolve_unit(twice[1])
        return unit if unit == resolve_unit(twice[2]) else None
    word = "".join(text.split()).lower().strip("[]()").replace("^1", "1").replace("e^-/", "e-/")
    if not word:
        return "adu"
    rate = _PER_SECOND.fullmatch(word)
    counts = UNITS.get(rate["counts"]) if rate else None
    return f"{counts}/s" if counts in COUNTS else UNITS.get(word)


def _spelled(table: Mapping[float, str]) -> dict[str, float]:
    return {word: value for value, words in table.items() for word in words.split()}


_SECONDS = _spelled(
    {
        1.0: "s sec secs second seconds",
        1e-3: "ms msec msecs millisec millisecs millisecond milliseconds",
        1e-6: "us µs usec usecs microsec microsecond microseconds",
        1e-9: "ns nsec nanosecond nanoseconds",
        60.0: "min mins minute minutes",
        3600.0: "h hr hrs hour hours",
        86400.0: "d day days",
    }
)
_ARCSECONDS = _spelled(
    {
        1.0: "arcsec arcsecs arcsecond arcseconds asec \" ''",
        1e-3: "mas marcsec milliarcsec milliarcsecond milliarcseconds",
        1e-6: "uas µas microarcsec microarcsecond microarcseconds",
        60.0: "arcmin arcmins arcminute arcminutes amin",
        3600.0: "deg degs degree degrees",
        206264.80624709636: "rad radian radians",
        206.26480624709636: "mrad mrads milliradian milliradians",
        0.20626480624709636: "urad urads µrad µrads microrad microradian microradians",
    }
)
_MILLIMETRES = _spelled(
    {
        1.0: "mm millimeter millimeters millimetre millimetres",
        10.0: "cm centimeter centimeters centimetre centimetres",
        1000.0: "m meter meters metre metres",
        25.4: "in inch inches \" ''",
        304.8: "ft foot feet",
        1e-3: "um µm micron microns micrometer micrometers micrometre micrometres",
    }
)
_METRES = {word: mm / 1e3 for word, mm in _MILLIMETRES.items() if mm not in (25.4, 304.8)}
_METRES |= _spelled({1e-9: "nm nanometer nanometers nanometre nanometres"})
_PIXELS = ("", "/pixel", "/pixels", "/pix", "/px", "/p")
_FACTORS = {
    **dict.fromkeys(("time", "exposure", "line_time"), _SECONDS),
    "angle": _ARCSECONDS,
    "focal_length": _MILLIMETRES,
    "pixel_size": {word: 1e3 * value for word, value in _MILLIMETRES.items()},
    "plate_scale": {word + pixel: value for word, value in _ARCSECONDS.items() for pixel in _PIXELS},
    "pupil_scale": {word + pixel: value for word, value in _METRES.items() for pixel in _PIXELS},
    "va_factor": dict.fromkeys(("none", "unitless", "dimensionless", "ratio", "factor", "1", "-"), 1.0),
}
"""Factors to the unit of a quantity, by the spelling of the unit; mm of a focal length, um of a pixel, m of a
pupil, of its samples and of a wavelength."""

_MEGA = re.compile(r"M(s|secs?|as|arcsecs?|m|rad)(?![a-z])")
"""A symbol of mega that some write for milli; in a header in capitals, ``MS``, it is milli."""

_SHORT = ("mm", "cm", "um", "µm", "ms")
"""Units of two letters that are no words."""

_LENGTH = re.compile(r"\d[\d.,]*\s?(mm|cm|um|µm)\b")
"""A length in a comment, of something else: "in 9 um pixels"."""

_CLAUSE_ONLY = ("min", "h", "d", "in", "m")
"""Units that are words or letters of other meaning where prose goes on behind them: "min exposure"."""

_ATTRIBUTE = re.compile(r"\b(day|hour|minute)(?= \w)|^[A-Z](?= \w)", re.ASCII)
"""A unit that describes the word behind it: "day flat", "hour angle", "H band"."""

_APART = re.compile(r"\b(milli|micro|nano|arc)[- ](?=s(ec)?|arc|min)", re.I)
"""A unit that is written in two words: "milli-arcsec"."""

_PREFIXES = ("milli", "mili", "micro", "mikro", "nano", "kilo", "mega")

_PREFIXED = re.compile(
    r"([cdk]|da)s(ec(ond)?s?)?\.?|[zc]enti?-?[sm]\w+|de[cz]i-?[sm]\w+|(hekto|hecto|giga)\w+", re.I
)
"""Seconds and metres with a prefix that programs hardly use."""

_FOREIGN = re.compile(
    r"(minut(en|os|i|y|er)|stunden?|horas?|heures?|ore|uren?|tagen?|jours?|dias?|giorni|bogenmin\w*"
    r"|grad(os?|i)?|degr[eé]s?)",
    re.I,
)
"""Words for minutes, hours, days, arcminutes and degrees in other languages."""

_OTHER_NUMBER = re.compile(
    r"\b(log\d*|ln|no\.|counter|index|identifier|id|flag)(?!\w)"
    r"|(?<!data )(?<!digital )\bnumber\b(?! of (\w*sec|electron|e-|count|adu))"
    r"|#(?=\s*(of\b|$))|(^\W*|\b(in|as) )(%|percent)"
    r"|(?<![\df])(x|\*|/|\^)\s?(10+|1e[-+]?\d+)\b|\b10+\s?(\^|\*|x\b)|\b1/10+\b"
    r"|\b(tenths?|hundredths?|thousandths?|tens|hundreds|thousands|millions) of\b"
    r"|\b(clock )?ticks\b|\bin (tdi )?(clocks|cycles|lines|rows|frames|fields|samples)\b|\bjiff(y|ies)\b"
    r"|\bk(adu|dn|e-|electrons?)(?!\w)"
    r"|(^\W*|\bin )(weeks?|months?|years?|fortnights?|[km]?eV|lux)( \(?rms\)?)?(?=\W*$)"
    r"|\b(dummy|placeholder|bogus|fake)\b|(?<!if )(?<!=)(?<!= )\b(invalid|undefined|unknown|tbd"
    r"|(not|not yet|to be) (known|measured|set|available|applicable|calibrated|determined|valid))\b(?! \w)",
    re.I,
)
"""What makes of a number another one, in the comment: a count, a name, a logarithm, a power of ten, none."""

_SCALED = re.compile(
    r"(?<![\d.a-wyz_])(0?\.0*1|1e-\d+)\s?(?=[a-zµ\"])"
    r"|\b(units?|steps|multiples) of (?!1\b)[\d.]+|\bin (half|quarter|double)\b|\bin \d+ ?[mµun]?s(ec\w*)?\b",
    re.I,
)
"""A part or a multiple of a unit, in the comment: "in 0.01 s", "in units of 10 ms", "in half seconds"."""

_PIXELS_ALONE = re.compile(r"(^\W*|\bin )(pixels?|pix|px|frames?|rows?|lines?|columns?)(?=\W*$)", re.I)
"""A comment of an exposure or a level that names what it is not counted in."""

_OTHER_NUMBERS = {
    "exposure": r"\b(hh|mm|min)[.:](mm|ss)\b|\breciprocal\b|\b[kM]?Hz\b|\bfps\b|\bframes? ?(/|per) ?s"
    r"|^\W*1/s\b|\bfraction\b|\b1/\d+(?= ?s(ec\w*)?\b)|\bEV\b|\bexposure value\b|\bcompensation\b",
    "line_time": r"\b(lines?|rows?) ?(/|per\b)|\b[kM]?Hz\b|\b(rate|frequency)\b|\bfraction\b",
    "va_factor": r"\binverse\b|\b1/",
    "read_noise": r"\bvariance|\bsquared|\bfwhm\b|\bp-p\b|\bpeak\b|\^2|\*2",
    "focal_length": r"\b35 ?mm\b|\bequivalent\b|\bwithout (the |a )?(focal )?(reducer|barlow|extender)\b",
    "plate_scale": r"\bfield of view\b|\bFOV\b|\barea\b|\bzoom\b|\bfactor\b"
    r"|\bunbinned\b|\bp(x|ix\w*)\s?(/|per\b)|\bper \d|\^2|\*2"
    r"|(?<![\w.])(?!(as|mas|uas|deg|rad)/)[a-z]{1,3}/p(ix|x|ixel)s?\b|(^\W*|\bin )lambda\b",
    "saturation": r"\bbit depth\b|^\W*(number of )?bits?\b"
    r"|\babove (the )?bias|\bfraction\b|\bnormali[sz]ed\b|\bmag(nitude)?s?\b",
    "gain": r"\bper \d|/ ?\(\d|\binverse\b(?! gain,? [([]?e)|\b1/gain\b"
    r"|(?<!not )(?<!yet )(?<!be )\b(applied|multiplied)\b|\brelative\b"
    r"|\bnormali[sz]ed\b|\bmultiplication\b|\bmultiplying\b|\bEM[- ]?(CCD )?gain\b"
    r"|\bwavelength|\bvariable filter\b",
}
"""The same for one quantity."""

_ELECTRICAL = re.compile(r"\b[mkuµn]?V\b|(?i:(?<![a-z])((micro|milli)?volts?|voltage|db|decibels?)\b)")
"""Units of what is counted in ADU or electrons where the signal is a voltage."""


@lru_cache(maxsize=256)
def other_number(name: str, text: str) -> str | None:
    """Find what says in a comment that a number is not the quantity itself.

    Parameters
    ----------
    name : str
        The quantity.
    text : str
        The comment, and what stands behind the number.

    Returns
    -------
    words : str or None
        ``"log"``, ``"number"``, ``"x 1000"``; None where the number is what its keyword says.
    """
    own = re.compile(_OTHER_NUMBERS.get(name, "(?!)"), re.I)
    found = _OTHER_NUMBER.search(text) or _SCALED.search(text) or own.search(text)
    if found is None and name in ("exposure", "line_time", "read_noise", "saturation", "bias"):
        found = _PIXELS_ALONE.search(text)
    if found is None and name in ("gain", "read_noise", "saturation", "bias"):
        found = _ELECTRICAL.search(text)
    return None if found is None else found[0].strip()


@cache
def factor(name: str, unit: str) -> float | str | None:
    """Return what a unit means for a quantity.

    Parameters
    ----------
    name : str
        A field of :class:`~jitterkit.frames.metadata.Metadata`, ``"time"`` or ``"angle"``.
    unit : str
        As written in a header.

    Returns
    -------
    meaning : float, str or None
        The factor to the unit of the quantity; for what is counted ``"adu"`` or ``"electron"``; None of a
        unit that is unknown or has another dimension.
    """
    unit = unit.strip(" []().,;:")
    if _MEGA.match(unit):
        return None
    word = re.sub(r"\s+per\s+|\s*/\s*", "/", unit.lower())
    word = _APART.sub(r"\1", word)
    word = re.sub(r"^(in|rms)\s+|\s+\(?rms$", "", word)
    word = re.sub(r"/(read|readout|frame)$", "", word) if name == "read_noise" else word
    if name in _FACTORS:
        return _FACTORS[name].get(word)
    return resolve_unit(word) if word else None


@lru_cache(maxsize=256)
def stated_unit(name: str, comment: str, default: float | str) -> str | None:
    """Find the unit that a comment states for its number.

    Parameters
    ----------
    name : str
        The quantity.
    comment : str
    default : float or str
        What :func:`factor` says of the unit that is meant where none is stated.

    Returns
    -------
    unit : str or None
        The text in brackets, or at the beginning, or after "in" or a comma at the end; it may be unknown.
        None where the comment states none.  A comment that names other units only, in none of these
        places, is returned whole: its number may be in either.
    """
    meaning = partial(factor, name)  # None of a text that is no unit
    comment = re.sub(r"\s+per\s+", "/", " ".join(comment.split()), flags=re.I)
    comment = re.sub(r"(?<!\w)'(\w+)'(?!\w)", r"\1", _ATTRIBUTE.sub("", _APART.sub(r"\1", comment)))
    multiple = re.search(r"\bunits? of ([^\s,;:()]+)", comment, re.I)
    if multiple and not meaning(multiple[1]) and multiple[1] != "1":
        return comment
    square = [text for text in re.findall(r"\[([^]]*)\]", comment) if text.strip()]
    found = next(filter(meaning, (*square, *re.findall(r"[({<|]([^)}>|]*)[)}>|]", comment))), None)
    if found is not None or square:
        return found or square[0]
    start = re.match(r"(?:in |units?:? ?)?([^\s,;:()]+?)(\.?(?=$|[,;:(])|(?= ))", comment, re.I)
    if start and meaning(start[1]):
        clause = comment[start.end() :].startswith(" ") and start[1].lower() in _CLAUSE_ONLY
        return comment if clause else start[1]
    if start and meaning(start[1].partition("/")[0]):
        return start[1]
    for ending in (r"(?:\bin |[,;:] ?|= ?(?:[\d.]+ ?)?| - )([^\s,;:()]+?)\.?$", r"/([^\s,;:()/]+?)\.?$"):
        end = re.search(ending, comment, re.I)
        if end and meaning(end[1]):
            return end[1]
    # the comment where it mentions units, and not the one that is meant by default
    comment = _LENGTH.sub("", comment)
    words = [word for word in re.findall(r"[^\s,;:()]+", comment) if len(word) > 1]
    mentioned = {meaning(word) for word in words} - {None}
    foreign = any(
        word.lower().startswith(_PREFIXES) or _PREFIXED.fullmatch(word) or _names_other_unit(word)
        for word in words
    )
    return comment if (mentioned or foreign) and default not in mentioned else None


def _names_other_unit(word: str) -> bool:
    """Return whether a word is a unit of any quantity, and no word of other meaning."""
    unit, length = word.lower(), word.lower().partition("/")[0]
    known = any(length in table for table in (_SECONDS, _ARCSECONDS, _MILLIMETRES))
    other = (known and (len(length) > 2 or length in _SHORT)) or resolve_unit(unit) is not None
    return unit not in _CLAUSE_ONLY and (other or _FOREIGN.fullmatch(unit) is not None)
