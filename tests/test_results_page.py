"""The pages of results: a section for each command, with what it was measured with."""

import subprocess
from importlib.metadata import version

import results_page
from results_page import measured_with, put_section

TABLE = "| a | b |\n|---|---:|\n| 1 | 2 |\n"


def test_a_new_page_has_a_title_and_a_section():
    page = put_section("", "blind_fits", "scripts/blind_fits --frames 9", "jitterkit 9.9", TABLE)
    assert page == ("# Blind fits\n\n## `scripts/blind_fits --frames 9`\n\n*jitterkit 9.9.*\n\n" + TABLE)


def test_a_second_run_replaces_its_own_section_and_no_other():
    page = "# Title\n\nWhat is measured.\n\n## Version 0.1.0\n\nold\n"
    page = put_section(page, "x", "scripts/x --seed 1", "first", TABLE)
    page = put_section(page, "x", "scripts/x", "second", "seconds 3\n")
    again = put_section(page, "x", "scripts/x --seed 1", "third", TABLE.replace("1", "7"))
    assert again.startswith(
        "# Title\n\nWhat is measured.\n\n## `scripts/x`\n\n*second.*\n\n```text\nseconds 3\n```\n"
    )
    assert "first" not in again
    assert again.count("*third.*") == again.count("| 7 | 2 |") == 1
    assert again.endswith("## Version 0.1.0\n\nold\n")


def test_a_measurement_says_version_commit_date_and_machine(tmp_path):
    def git(*words):
        subprocess.run(["git", "-C", str(tmp_path), *words], check=True, capture_output=True)

    git("init")
    (tmp_path / "file").write_text("one")
    git("add", "file")
    git("-c", "user.name=n", "-c", "user.email=e@e", "commit", "-m", "one")
    clean = measured_with(tmp_path)
    assert clean.startswith(f"jitterkit {version('jitterkit')}, commit ")
    assert results_page.machine() in clean
    (tmp_path / "file").write_text("two")
    assert "with changes" in measured_with(tmp_path)
    assert "with changes" not in clean
