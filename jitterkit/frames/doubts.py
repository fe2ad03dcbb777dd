"""What a header says beside its numbers that makes them doubtful: warnings, each with a remedy.

Reach for :func:`doubts`.  It warns of an image of several exposures, of an exposure that its own dates
contradict, of a bias or a gain that was applied before, and of numbers in keywords that are not read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from jitterkit.frames.cards import Cards, parse_number
from jitterkit.frames.dialects import ALIASES
from jitterkit.frames.metadata import Metadata
from jitterkit.frames.times import seconds_to_end
from jitterkit.frames.units import factor


def doubts(cards: Cards, known: Metadata) -> list[str]:
    """Return the warnings of a header about its numbers.

    Parameters
    ----------
    cards : Cards
    known : Metadata
        The numbers that were read from them.

    Returns
    -------
    warnings : list of str
        Empty for a plain exposure.
    """
    warnings, said = [*_combined(cards), *_elapsed(cards, known)], reduced_by(cards, "bias")
    if said and known.value("bias"):
        found = f"the bias of {known.value('bias'):g} ADU is used"
        warnings.append(f"{found}, and {said} says that it was subtracted: if so, give --bias 0")
    said = reduced_by(cards, "gain")
    if said and known.value("unit", "adu") in ("adu", "adu/s"):
        found = f"{said} says that the gain was applied"
        warnings.append(f"the pixels are taken as ADU, and {found}: they may be electrons")
    multipliers = filter(None, map(cards.number, filter(_MULTIPLIER.fullmatch, cards.names)))
    times = next((number for number in multipliers if number.value > 1), None)
    if times is not None and known.gain is not None:
        found = f"{times.said} multiplies the electrons before they are read"
        warnings.append(f"{found}: gain, read noise and saturation may be those without it")
    noise = known.read_noise
    key = "" if noise is None else noise.source.removeprefix("header ").partition(" (")[0]
    of_one = _ONE_READ.search((cards.find(key) or ("", ""))[1])
    reads = next(filter(None, (cards.number(name) for name in READS)), None)
    if of_one and (reads is None or reads.value > 1):
        found = f"{key} is the noise of one read by its comment ({of_one[0]!r})"
        warnings.append(f"{found}: if the exposure has several, give --read-noise")
    calibrated = known.value("unit") in ("electron", "electron/s")
    needless = ("gain", "saturation", "bias") if calibrated else ("bias",) if known.bias is not None else ()
    for name in (name for name in _ALIKE if not known.value(name) and name not in needless):
        read = {key for each in cards.keywords(name) for key in ((each,) if isinstance(each, str) else each)}
        alike = (key for key in cards.names if key not in read and _ALIKE[name].fullmatch(key))
        if (unread := next((key for key in alike if _is_stated(cards, key)), None)) is not None:
            option = f"--{name.replace('_', '-')}"
            warnings.append(f"{unread} = {cards.text(unread)} is not read: give {option} if it is needed")
    return warnings


_COMBINED = re.compile(
    r"(N|NO|NUM|NR)_?(OF_?)?(CO_?ADD(S|ED)?|COMB(INED?)?|EXP(S|OSURES)?|SUB(S|EXPS?|FRAMES?)?|STACK(S|ED)?"
    r"|(DRIZ)?IM(G|AGE)?S?|FRA?ME?S?|INPUTS?|AVG|AVERAGED?|SUM(MED)?|ACC(UM)?S?|DITS?)|CO_?ADDS?|COADD_NO"
    r"|STACK(CNT|NUM|FRM|ED)|TOTALBCD|SNAPSHOT|AVERAGED|AVGNUM|COMBINED|SUMMED|SUBS|LIGH_CNT|FRAMES|ACCUM"
    r"|ESO DET (\w+ )?NDIT|ESO PRO DATANCOM"
)
"""Numbers of exposures in one image: Keck, Gemini, IRTF; ESO; IRAF; Siril; SBFITSEXT; ESO's pipelines; Astro
Pixel Processor; ASTAP; Andor; AstroDrizzle; TESS; Spitzer; and others."""

_OF_OTHERS = re.compile(
    r"\b(sequence|series|templates?|visit|dither\w*|pattern|program\w*|blocks?|script|extensions?|planned"
    r"|requested|mosaic|queue|in (the |this )?(file|run|set))\b",
    re.I,
)
"""Comment of a number of exposures that are not in this image."""

_CODE = r"^[^AEIOU]*%s[^AEIOU]*$"
"""Letters that stand for steps, which make no word such as UNCALIBRATED."""

_STACKERS = {
    "IMCMB002": r".", "COMBINET": r".", "CALSTAT": _CODE % "S", "HISTORY": r"\bnumberOfImages: *([2-9]|\d\d)",
}  # fmt: skip
"""What else says that an image was combined: imcombine, SWarp, ASTAP, PixInsight."""

_OF_SEVERAL = re.compile(
    r"\bof ([2-9]|[1-9]\d+) (\w+ )?(frames|exposures|images|co-?adds|subs|subexposures|snapshots)\b"
    r"|\bsum(med)? (of|over)\b|\bper (sub(exposure|frame)?|exposure|integration)\b|\bco-?add(s|ed)?\b"
    r"|^\W*[x*] ?[2-9]|\bstacked\b|\b(mean|average) (exp|integ)",
    re.I,
)
"""Comment of an exposure that is that of several."""

_OF_CUBE = re.compile(r"\b(total|cube|stack|sequence|series|all (frames|planes|images))\b", re.I)
"""Comment of the exposure of a cube that is that of all its planes."""

_TOTALS = re.compile(
    r"LIVETIME|ESO PRO EXPTTOT|T(OT(AL)?)?_?EXP(T|TIME?|OSURE)?|EXP_?TOT(AL)?|TOT(AL)?_?(INT|TIM)\w*"
)
_PARTS = re.compile(r"(SING(LE)?|SUB|INDIV?|COADD)_?(EXP|INT|TIM)\w*|ESO DET (\w+ )?DIT\d?")
"""Times of all exposures that were combined, and of one of them."""

_WHOLE = ("TELAPSE", "ELAPTIME", "ELAPSED", "DARKTIME", "KCT", "FRAMTIME", "FRMTIME")
"""Times that are at least as long as the exposure: Andor's kinetic cycle, Spitzer's frame."""

_FRAME_RATES = ("FPS", "FRAMERAT", "FRAMERATE", "FRAME_RATE", "FRMRATE")
"""Frames per second, between whose beginnings an exposure fits."""

_ROUNDED = 2.0
"""Seconds by which the time between two dates may be short, if both are written in whole seconds."""


def _combined(cards: Cards) -> list[str]:
    """Warn of an image that is the sum or the mean of several exposures."""
    planes = [card[0] for card in map(cards.find, ("NAXIS3", "ZNAXIS3")) if card is not None]
    of_other = ("NFRAMES",) if cards.dialect.name == "JWST" else ()  # frames of a group, averaged on board
    unsure = "exposure, gain, read noise and saturation may be those of one"
    for key in (key for key in cards.names if _COMBINED.fullmatch(key) and key not in of_other):
        value, comment, _ = cards.find(key) or (None, "", "")
        number, _ = parse_number(value) or (2.0 * (value is True), "")  # T says that there are several
        if number > 1 and number not in planes and not _OF_OTHERS.search(comment):
            return [f"{key} = {cards.text(key)} exposures are combined in the image: {unsure}"]
    for key in filter(cards.find, (key for key in ALIASES["exposure"] if isinstance(key, str))):
        comment = (cards.find(key) or ("", ""))[1]
        if _OF_SEVERAL.search(comment) or (max(planes, default=1) > 1 and _OF_CUBE.search(comment)):
            return [f"{key} is of several exposures by its comment {comment!r}: {unsure}"]
    for key, pattern in _STACKERS.items():
        if any(re.search(pattern, str(header.get(key, ""))) for header, _ in cards.layers):
            return [f"several exposures are combined in the image by {key}: {unsure}"]
    return []


def _elapsed(cards: Cards, known: Metadata) -> list[str]:
    """Warn of an exposure that is part of a longer one, or longer than from its beginning to its end."""
    exposure = known.exposure
    if exposure is None:
        return []
    said = f"{exposure.source} = {exposure.value:g} s is used"
    for key in cards.names:
        longer = _TOTALS.fullmatch(key) is not None
        other = cards.quantity("exposure", key) if longer or _PARTS.fullmatch(key) else None
        ratio = other.value / exposure.value if other and other.positive and exposure.value else 1.0
        if other is not None and (ratio if longer else 1 / ratio) > 1.1:
            found = f"{other.said} s is {'longer' if longer else 'shorter'}"
            return [f"{said}, and {found}: exposures may be combined"]
    for rate in filter(None, map(cards.number, filter(cards.find, _FRAME_RATES))):
        unlike = re.search(r"\b[kM]Hz\b|\b(ms|min\w*|hour|h)\b", rate.words)
        if not unlike and rate.positive and exposure.value * rate.value > 1.1:
            frame = f"{rate.said} Hz leaves {1 / rate.value:.3g} s for a frame"
            return [f"{said}, and {frame}: check its unit"]
    wholes = (cards.quantity("exposure", key) for key in _WHOLE if cards.find(key))
    whole = next((number for number in wholes if number is not None and number.positive), None)
    key, passed = (whole.key, whole.value) if whole else seconds_to_end(cards, known.time)
    slack = _WRITTEN if key == "DATE" else 1.1
    if passed is not None and exposure.value > slack * passed + _ROUNDED:
        return [f"{said}, and by {key} it lasted {passed:g} s: check its unit"]
    return []


_WRITTEN = 10.0
"""Times the time until the file was written that an exposure may last: clocks differ, and units by 60."""


_NOT_DENIED = r"^(?!(F|FALSE|NO|NONE|0|OMIT|PERFORM)$)."

_APPLIED: Mapping[str, Mapping[str, str]] = {
    "bias": {
        "CALSTAT": _CODE % "B", "ZEROCOR": r"\d.*(IS|CORRECTION)|^T(RUE)?$", "OVERSCAN": r"\bIS \[",
        "BIASCOR": r"^(T|TRUE|DONE)$|\.FIT", "SUBBIAS": _NOT_DENIED, "BIASCORR": r"^COMPLETE",
        "SUBOSCAN": _NOT_DENIED,
    },
    "gain": dict.fromkeys(("GAINCOR", "GAINCORR"), _NOT_DENIED),
}  # fmt: skip
"""Cards of pixels whose bias was subtracted: MaxIm and ASTAP, IRAF, HST, ccdproc; and of those that were
multiplied by the gain: ccdproc, which leaves BUNIT if its gain has no unit."""

_MULTIPLIER = re.compile(r"EM[_-]?GAIN(_[ACM])?|GAINEM|EMREALGN|MULTGAIN", re.I)
"""Gain of an electron-multiplying register, which has no unit."""

_ONE_READ = re.compile(r"\b(per|single|each|one|of a) (\w+ )?(read|sample|cds)\b|/read\b", re.I)
READS = ("NSAMP", "NREADS", "NREAD", "MULTISAM", "NFOWLER", "NSAMPLE", "NSAMPLES")
"""Comment of a noise of one read, and numbers of reads in an exposure."""


def reduced_by(cards: Cards, number: str) -> str:
    """Return the card that says that the ``"bias"`` or the ``"gain"`` was applied, as words; else nothing."""
    texts = {key: cards.text(key)[:40] for key in _APPLIED[number]}
    found = (key for key, pattern in _APPLIED[number].items() if re.search(pattern, texts[key].upper()))
    return next((f"{key} = {texts[key]!r}" for key in found), "")


_ALIKE: Mapping[str, re.Pattern[str]] = {
    name: re.compile(pattern, re.I)
    for name, pattern in {
        "exposure": r"(?!N).{0,4}EXP(?!.*(ID|NUM|NO|NR|CNT|SEQ|START|STRT|BEG|END|MODE|TYPE)$).*"
        r"|(TRU)?ITIME|T_?INT|(INT|INTE?G\w{0,2}|ACC|ACQ|SHU?T?|FRA?ME?|OPEN|OBS|EFF)[_ ]?(T|TIM|TIME)|DWELL"
        r"|DURATION|ONTIME|ELAPTIME|ELAPSED|SHUTSPD|(ESO DET (\w+ )?)?DIT\d?|FPS|FRA?ME?_?RATE?",
        "gain": r"(?!.*(EM|MODE|COR|SET|ID))\w*GAIN\w*|E(L|LEC)?_?(P|PER|2)?_?(ADU|DN)\d?|ADU_?2?E|CONV?FACT?"
        r"|ESO (QC )?DET (\w+ ){1,2}(GAIN|CONAD)|CONAD\d?|CCDSENS|ESCALE",
        "read_noise": r"(\w*NOI(S|SE|SEE)?|(RD|READ|R|DET|CCD)_?(NSE?)?|RO?N|READOUTN)_?([A-H]|\d{1,2})?"
        r"|GTRON\d+|(DET|EFF)?RON_?([A-H]|\d{1,2})?|ESO (QC )?DET (\w+ ){1,2}RON|CCDREAD",
        "saturation": r"SATUR(A|AT)?_?([A-H]|\d{1,2})?|SATUR(ATI|VAL)"
        r"|(ESO DET )?SAT_?(LE?VE?L?|VAL|ADU|LIM(IT)?)"
        r"|FULLWELL|WELL\w*|MAX_?(ADU|COUNT|CNT)S?|GOODMAX|LIN_?LIM(IT)?",
        "bias": r"(BIAS|BLACK|BLK|OVSCA?N?|OVERSCA?N?)_?(LE?VE?LL?|LEV|VAL(UE)?|MEAN|MED(IAN)?|AVG|ADU)?_?"
        r"([A-H]|\d)?",
        "plate_scale": r"(ESO INS )?([XYAP]|PX|GS|SKY|IMG?|CCD|SPAT|[XYA]?_?PIX(EL)?|PLATE|PLT)"
        r"_?SC(A|AL|ALE|L)?_?[XY12]?|SCALE_?[XY12]|SECP?PIX\w?|[XY]_?SCALE|A(RC)?SEC_?P?(ER)?_?(PIX|X)|SECPERP\w*"
        r"|I?P?FOV|PIX(EL)?_?(FOV|SIZE)|FOCALLEN|CDELT1|CD1_1",
    }.items()
}
"""Keywords like those of a number, which are not read as their unit or meaning differs between programs."""


def _is_stated(cards: Cards, key: str) -> bool:
    """Return whether a card has a number that is no default, and no step along axes that are no angles."""
    number = parse_number((cards.find(key) or ("",))[0])
    if number is None or number[0] == 0:
        return False
    angles = not cards.text("CTYPE1") or factor("plate_scale", cards.text("CUNIT1"))
    return not key.startswith("CD") or (abs(number[0]) != 1 and bool(angles))
