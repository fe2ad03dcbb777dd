"""Nothing that a file, a header or a command line says becomes part of the page's structure.

The page of hostile names is compared with that of harmless ones: same elements, same attributes, and none of
the characters that a reader does not see.
"""

import json
from html.parser import HTMLParser
from itertools import pairwise

import pytest
from drawn import render_frame

from jitterkit.refit.result import FitResult, Status
from jitterkit.report.html import write_report
from jitterkit.report.pictures import FrameReport
from jitterkit.report.row import make_row
from jitterkit.report.summary import summarise
from jitterkit.report.table import make_table

HARMLESS = "name"
HOSTILE = {
    "script": "<script>alert(1)</script>",
    "attribute": '" onerror="alert(1)" x="',
    "single quote": "' onmouseover='alert(1)' x='",
    "unquoted": "x onload=alert(1) ",
    "image": "<img src=x onerror=alert(1)>",
    "end of style": "</style><script>alert(1)</script>",
    "end of title": "</title></head><body onload=alert(1)>",
    "end of table": "</td></tr></tbody></table></details></section><h1>Separation 1 ± 0</h1>",
    "comment": "<!-- --><![CDATA[ ]]>",
    "template": "{{ 7 * 7 }}{% raw %}{{ table.__class__.__mro__ }}{# x #}",
    "link": "<a href='javascript:alert(1)'>javascript:alert(1)</a>",
    "policy": '<meta http-equiv="Content-Security-Policy" content="default-src *"><base href=\'//evil\'>',
    "entities": "&lt;script&gt;alert(1)&lt;/script&gt;&#60;b&#62;&quot;",
    "direction": "photo\u202egnp.fits\u2066\u200f",
    "controls": "a\x00b\x07c\x1b[31md\x7fe\x85f\u2028g\r\nh\ti",
    "invisible": "a\u200bb\ufeffc\u00add",
    "undecodable": "bad\udcff\udcfename",
    "formula": "$\\frac{$ =HYPERLINK(1)",
    "very long": "<b>" * 5000,
}
UNSEEN = {*map(chr, range(32)), "\x7f", "\x85", *"\u00ad\u200b\u200f\u2028\u202e\u2066\ufeff"} - {"\n"}


class Page(HTMLParser):
    """Structure and text of a page."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.structure, self.words, self.policies = [], [], []
        self.feed(text)
        self.close()
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        fixed = {name: value for name, value in attrs if name not in ("alt", "src", "title")}
        self.structure.append((tag, tuple(name for name, _ in attrs), tuple(sorted(fixed.items()))))
        if fixed.get("http-equiv") == "Content-Security-Policy":
            self.policies.append(fixed["content"])

    def handle_endtag(self, tag):
        self.structure.append(f"/{tag}")

    def handle_comment(self, data):
        self.structure.append("comment")

    def handle_decl(self, decl):
        self.structure.append(decl)

    unknown_decl = handle_pi = handle_comment

    def handle_data(self, data):
        self.words.append(data)


@pytest.fixture(scope="module")
def fitted(make_fit):
    frame, result = make_fit()
    return render_frame(frame, result)


def _rows(text, fitted):
    """Rows as a ledger may hold them, every text as hostile as can be."""
    tried = [{"locus": text, "weight": 0.5, "objective": k, "separation": 8.1, "separation_err": 1e-4,
              "evidence": None} for k in range(2)]  # fmt: skip
    good = fitted.row | {"file": text, "path": text, "time": text, "locus": text, "message": f"fine. {text}"}
    good |= {"candidates": json.dumps(tried), "flags": 1}
    lost = make_row(FitResult(Status.UNREADABLE, ""), "x") | {
        "file": text,
        "path": f"/{text}",
        "message": text,
    }
    return [good, good, *[lost] * 15, lost | {"status": text}]


def _page(path, text, fitted):
    rows = _rows(text, fitted)
    entries = [FrameReport(text, row, fitted.picture, text) for row in (rows[0], rows[2])]
    meta = {"command": f"jitterkit process {text}", text: {"instrument": text, "many": [text, text]}}
    table = make_table(rows, meta)
    write_report(path, entries, table, summarise(table), title=text, overwrite=True)
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def harmless(fitted, tmp_path_factory):
    return Page(_page(tmp_path_factory.mktemp("page") / "report.html", HARMLESS, fitted))


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_no_name_changes_the_structure_of_the_page(text, harmless, fitted, tmp_path):
    source = _page(tmp_path / "report.html", text, fitted)
    page = Page(source)
    assert page.structure == harmless.structure
    assert page.policies == harmless.policies
    assert not UNSEEN & set(source)


def test_the_policy_forbids_all_but_what_is_in_the_page(harmless):
    assert harmless.policies == ["default-src 'none'; img-src data:; style-src 'unsafe-inline'"]
    tags = {entry[0] for entry in harmless.structure if isinstance(entry, tuple)}
    assert not tags & {"script", "iframe", "object", "embed", "form", "input", "a", "base", "link", "svg"}


def test_what_is_unseen_is_shown_escaped_and_the_rest_as_it_is(fitted, tmp_path):
    said = Page(_page(tmp_path / "report.html", HOSTILE["direction"], fitted)).text
    assert r"photo\u202egnp.fits\u2066\u200f" in said
    said = Page(_page(tmp_path / "report.html", HOSTILE["template"], fitted)).text
    assert HOSTILE["template"] in said
    assert "49" not in said.replace(HOSTILE["template"], "")[:200]
    said = Page(_page(tmp_path / "report.html", HOSTILE["entities"], fitted)).text
    assert HOSTILE["entities"] in said


def test_a_command_of_60_000_names_is_cut_short(tmp_path):
    names = " ".join(f"night/alpha_cen_{k:05d}.fits" for k in range(60_000))
    table = make_table([], {"command": names})
    write_report(tmp_path / "report.html", [], table, summarise(table))
    source = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "alpha_cen_00000.fits" in source
    assert f"({len(names)} characters)" in source
    assert len(source) < 10_000


def test_the_worst_residuals_are_shown_worst_first(make_fit, tmp_path):
    frame, result = make_fit()
    entry = render_frame(frame, result)
    entries = [
        FrameReport(f"f{k}", entry.row | {"chi2_dof": 1 + k / 100}, entry.picture) for k in (3, 9, 1, 7)
    ]
    table = make_table([one.row for one in entries] * 20)
    write_report(tmp_path / "r.html", entries, table, summarise(table), max_pictures=3)
    said = Page((tmp_path / "r.html").read_text(encoding="utf-8")).text
    positions = [said.rindex(name) for name in ("f9", "f7", "f3")]
    assert all(a < b for a, b in pairwise(positions))
    assert "Worst residuals 3 of 80 frames" in said
