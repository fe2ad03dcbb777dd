import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from drawn import render_frame
from long_run import long_run
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import Metadata
from jitterkit.refit.result import FitResult, Status
from jitterkit.report.html import write_report
from jitterkit.report.row import make_row
from jitterkit.report.summary import summarise
from jitterkit.report.table import make_table

HOSTILE = '"><script>alert(1)<img src=x onerror=alert(2)>.fits'
VOID = {"meta", "img", "link", "br", "input"}


class Page(HTMLParser):
    """Tags, attributes and text of a page; its tags must nest."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.attributes, self.open, self.words = [], [], [], []
        self.feed(text)
        assert self.open == []
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture
def write(tmp_path):
    def write(rows, entries=(), meta=None, **options):
        table = make_table(rows, meta)
        write_report(tmp_path / "report.html", entries, table, summarise(table), overwrite=True, **options)
        return Page((tmp_path / "report.html").read_text(encoding="utf-8"))

    return write


def test_the_page_says_what_the_plate_scale_adds_where_its_error_is_stated(make_fit, write):
    result = make_fit()[1]
    known = Metadata().override("instrument file a.toml", plate_scale_err=1e-5)
    assert "± 81.0 µas" in write([make_row(result, "f", metadata=known)]).text  # of 8.1 arcsec
    assert "plate scale adds" not in write([make_row(result, "f")]).text


def test_the_page_says_what_came_out(make_fit, write):
    fits = [make_fit("mvn", seed=seed, path=f"{seed}.fits") for seed in range(9)]
    rows = [make_row(result, frame.path, pa=263.0) for frame, result in fits]
    page = write([*rows, make_row(FitResult(Status.NO_STAR, "Nothing shines."), "dark.fits")])
    mean = np.mean([row["separation"] for row in rows])
    assert f"Separation {mean:.6f} ± 0.000080 ″" in page.text  # 240 µas / 3
    assert "Weighted mean of 9 of 10 frames" in page.text
    assert "the two agree" in page.text
    assert "Position angle" in page.text
    assert "Nothing shines." in page.text
    assert all(f"{seed}.fits" in page.text for seed in range(9))


def test_scatter_beyond_the_errors_is_said(make_fit, write):
    row = make_row(make_fit()[1], "f")
    page = write([{**row, "separation": 8.1 + 0.01 * k} for k in range(9)])
    assert "more than chance allows" in page.text


def test_a_fitted_frame_is_shown_with_its_numbers(make_fit, write):
    frame, result = make_fit("shm", path="cube.fits", index=2, several=True)
    entry = render_frame(frame, result)
    page = write([entry.row], [entry])
    source = next(v for t, n, v in page.attributes if t == "img" and n == "src" and len(v) > 1000)
    assert source.startswith("data:image/png;base64,")
    pictures = [v.partition(",")[2] for t, n, v in page.attributes if (t, n) == ("img", "src")]
    assert entry.picture in [base64.b64decode(data) for data in pictures]
    for text in ("cube.fits[2]", "(3.81100 ± 0.00070) × 10⁷", "shm length 600 mas", "4.000 ± 0.050"):
        assert text in page.text


def test_what_a_fitted_frame_leaves_undecided_stands_beside_its_numbers(make_fit, write):
    frame, result = make_fit()
    entry = render_frame(frame, result)
    plain = write([entry.row], [entry])
    assert entry.row["message"] not in plain.text
    row = entry.row | {"message": "fitted: chi²/dof is 1.005. Undecided between shm and linear."}
    assert "Undecided between shm and linear." in write([row], [replace(entry, row=row)]).text


def test_no_name_or_message_can_run_code(make_fit, write):
    frame, result = make_fit(path=HOSTILE)
    entry = render_frame(frame, result, make_row(result, HOSTILE, flags=[HOSTILE]))
    broken = make_row(FitResult(Status.UNREADABLE, HOSTILE), HOSTILE)
    page = write([entry.row, broken], [entry], meta={HOSTILE: HOSTILE}, title=HOSTILE)
    assert "script" not in page.tags
    assert not [name for _, name, _ in page.attributes if name.startswith("on")]
    assert page.text.count("<script>alert(1)") >= 6


def test_the_page_needs_nothing_from_outside(make_fit, write):
    frame, result = make_fit()
    entry = render_frame(frame, result)
    page = write([entry.row], [entry])
    assert set(page.tags) & {"script", "link", "iframe", "object"} == set()
    assert all(value.startswith("data:") for _, name, value in page.attributes if name in ("src", "href"))
    assert not re.search(r"url\(|@import|https?:", " ".join(page.words))
    policy = next(value for tag, name, value in page.attributes if tag == "meta" and "default-src" in value)
    assert policy.startswith("default-src 'none'")


def test_a_long_run_stays_readable(make_fit, write):
    frame, result = make_fit()
    entry = render_frame(frame, result)
    lost = make_row(FitResult(Status.NO_STAR, "Nothing shines."), "f")
    rows = [{**(lost if k % 30 == 0 else entry.row), "frame": k} for k in range(4500)]
    page = write(rows, [entry] * 40, max_pictures=5)
    assert page.tags.count("article") == 5
    assert "5 of 4,500 frames: those that failed and those that fit worst" in page.text
    assert "One in 5 of 4,500; the results table has them all." in page.text
    assert page.tags.count("tr") < 1400
    assert page.text.count("Nothing shines.") == 1 + 150  # the example of the kind, and the list
    assert page.text.count(ErrorCode.NO_STAR.meaning) == 1  # the kind


def test_failures_are_counted_by_kind_and_the_first_are_listed(write):
    page = write(long_run(1500, np.random.default_rng(3), failing=0.6))
    kinds = page.text.partition("Frames that failed")[2].partition("and why")[0]
    assert kinds.count(ErrorCode.TRUNCATED.meaning) == 1
    assert kinds.count("of the 65536 declared") == 1  # the example
    assert kinds.count("✕") == 0  # the mark is the style's
    assert "These are the first 300; the results table has" in page.text
    counts = [
        int(count)
        for count in re.findall(
            r"(\d+) (?=no star|poor fit|no pair|no data|unreadable|mismatch|failed|not converged)", kinds
        )
    ]
    assert sum(counts) == sum(
        row["status"] != "ok" for row in long_run(1500, np.random.default_rng(3), failing=0.6)
    )
    assert counts == sorted(counts, reverse=True)


@pytest.mark.slow
def test_a_run_of_thousands_is_a_page_of_a_megabyte_with_every_part(write, tmp_path):
    page = write(long_run(6000, np.random.default_rng(3)))
    for heading in ("Separations", "How the separation averages", "Jitter", "How well frames fit"):
        assert heading in page.text
    alts = " ".join(value for tag, name, value in page.attributes if (tag, name) == ("img", "alt"))
    for drawn in (
        "weighted mean",
        "against 1/√N",
        "Allan",
        "Jitter ellipse with time",
        "Rose",
        "kurtosis",
        "locus",
        "chi-squared",
    ):
        assert drawn in alts
    assert (tmp_path / "report.html").stat().st_size < 1_500_000
    assert "time since" not in page.text  # it is in the picture


def test_one_frame_is_not_spoken_of_as_many(make_fit, write):
    row = make_row(make_fit()[1], "f")
    assert "From one of 1 frame, ±" in write([row]).text
    assert "Weighted mean of 2 of 2 frames, ±" in write([row, row]).text


def test_a_run_in_which_nothing_worked_says_so(write):
    page = write([make_row(FitResult(Status.UNREADABLE, "It ends too early."), "a.fits")])
    assert "No frame could be fitted." in page.text
    assert "It ends too early." in page.text
    assert "img" not in page.tags
    assert "No frame could be fitted." in write([]).text


def test_a_report_is_replaced_only_when_allowed(tmp_path):
    table = make_table([])
    write_report(tmp_path / "report.html", [], table, summarise(table))
    with refused(ErrorCode.EXISTS, tmp_path / "report.html", error=FrameError):
        write_report(tmp_path / "report.html", [], table, summarise(table))
