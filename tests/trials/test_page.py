"""The report is one file that asks for nothing else, says the numbers of the log, and shows the attempts."""

import argparse
import re
import shutil
import time
from html.parser import HTMLParser
from pathlib import Path

import pytest
from big_log import big_log
from picking_fakes import Lab

from evg_app.cli import trials as verb
from evg_app.trials import charts
from evg_app.trials.labels import add_label
from evg_app.trials.page import page
from evg_app.trials.recorder import Recorder
from evg_app.trials.rows import read_rows
from evg_app.trials.summary import summary

MOST_STATS_CPU_S, MOST_REPORT_CPU_S = 0.25, 5.0
"""Of this process for 2,000 attempts: a fifth of what 10,000 may take (1 s and 20 s, docs/trials.md)."""
VOID = {"meta", "img", "circle", "line", "rect", "polygon", "polyline", "br"}


class Outline(HTMLParser):
    """Collects headings, images and links, and checks that tags close."""

    def __init__(self) -> None:
        super().__init__()
        self.open, self.headings, self.images, self.text = [], [], [], []

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        if tag == "img":
            self.images.append(found["src"])
        assert tag not in ("script", "link", "iframe", "object"), "nothing is fetched or run"
        assert not any(name in ("href", "srcset") for name in found)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)
        if self.open and self.open[-1] == "h2":
            self.headings.append(data)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("page") / "run"
    lab = Lab(script="SFSMFFSSFF" * 4, objects=5)
    config = {"robot": {"name": "<b>evil & co</b>"}, "calibration": {"T": [1, 2]}}
    with Recorder(folder, config, {"git_commit": "c0ffee", "packages": {"numpy": "2"}}) as recorder:
        lab.listeners.append(recorder)
        lab.run(rounds=4)
    return folder


@pytest.fixture
def run(recorded, tmp_path):
    return Path(shutil.copytree(recorded, tmp_path / "run"))


def outline(text: str) -> Outline:
    found = Outline()
    found.feed(text)
    assert found.open == [], "every tag is closed"
    return found


def test_it_needs_nothing_but_itself(run):
    found = outline(page(read_rows(run)))
    assert found.images and all(src.startswith("data:image/png;base64,") for src in found.images)
    text = page(read_rows(run))
    assert "http" not in text and "url(" not in text and "@import" not in text


def test_it_says_the_numbers_of_the_log_with_intervals_and_hashes(run):
    facts, text = summary(run), "".join(outline(page(read_rows(run))).text)
    assert (
        f"{facts['successes']}/{facts['attempts']} = " in text and f"{facts['removed']}/{facts['objects']} = " in text
    )
    for word in (facts["config_sha256"], facts["weights_sha256"], "c0ffee", "calibration sha256", "numpy 2"):
        assert word in text
    assert "<b>evil & co</b>" in text, "values are escaped, not interpreted"


def test_best_and_worst_attempts_are_shown_the_surest_first(run):
    found = outline(page(read_rows(run)))
    assert {"Best attempts", "Worst attempts: failures that the planner was surest of"} <= set(found.headings)
    rows = read_rows(run)
    executed = [rows.success(row) for row in rows.passes if row["counts"]]
    assert len(found.images) == min(sum(executed), 6) + min(len(executed) - sum(executed), 6)


def test_a_missing_picture_is_said(run):
    for path in (run / "attempts").glob("*.png"):
        path.unlink()
    text = page(read_rows(run))
    assert "its picture was not kept" in text and "<img" not in text


def test_the_operator_s_disagreement_is_in_it(run):
    for row in read_rows(run).passes[:3]:
        add_label(run, row["attempt_id"], True)
    assert "The operator agrees with the automatic label" in page(read_rows(run))


def test_an_empty_run_still_has_a_report(tmp_path):
    lab = Lab()
    lab.motion_planner.refuses = True
    with Recorder(tmp_path / "run", {}, {}) as recorder:
        lab.listeners.append(recorder)
        lab.run()
    text = page(read_rows(tmp_path / "run"))
    outline(text)
    assert "0/0 = no trial" in text and "all candidates refused" in text


def test_it_is_made_for_paper_too(run):
    text = page(read_rows(run))
    assert "@media print" in text and "@page" in text and "break-inside: avoid" in text


def test_success_and_failure_differ_in_shape_not_only_in_colour():
    drawn = charts.rounds([("r", [True, False])], "t")
    assert drawn.count("<circle") == 1 and drawn.count("<line") == 2


@pytest.mark.parametrize("n", [0, 1, 5, 3000])
def test_the_running_rate_has_a_bounded_size(n):
    drawn = charts.running_rate([True] * n, "t")
    assert len(drawn) < 40_000 and (n == 0 or re.search(r"<polyline", drawn))


def test_the_verb_writes_it_into_the_run_folder_or_where_it_is_told(run, tmp_path, capsys):
    parser = argparse.ArgumentParser()
    verb.add_parser(parser.add_subparsers())
    args = parser.parse_args(["trials", "report", str(run)])
    assert args.run(args) == 0 and (run / "report.html").read_text().startswith("<!doctype html>")
    args = parser.parse_args(["trials", "report", str(run), "--out", str(tmp_path / "r.html")])
    assert args.run(args) == 0 and (tmp_path / "r.html").exists()
    assert "report:" in capsys.readouterr().out


@pytest.mark.slow
def test_thousands_of_attempts_are_counted_and_reported_quickly(tmp_path):
    folder = big_log(tmp_path / "run", 2000)
    seconds = []
    for action in (lambda: summary(folder), lambda: page(read_rows(folder))):
        tries = []
        for _ in range(3):
            start = time.process_time()
            action()
            tries.append(time.process_time() - start)
        seconds.append(min(tries))
    assert seconds[0] < MOST_STATS_CPU_S and seconds[1] < MOST_REPORT_CPU_S
    assert summary(folder)["attempts"] == 2000
