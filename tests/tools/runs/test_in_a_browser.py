"""What people open in a browser, opened in one: reports in light and dark, and the viewer on a run's log."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from browser import Browser, Picture, drawn_in, near
from short_run import make_run

from hil.judge.seeds import merge
from hil.judge.verdict import trace
from hil.judge.verdict_files import read_verdict
from hil.record import state_timeline
from hil.record.rrd.rerun_program import rerun_environment
from hil.record.run_traces import read_scenario
from hil.scenario.checks import checks_of
from hil.show import window
from hil.show.report.pages import write_suite_report
from tools.runs.quiet_viewer import served

GREEN, RED = {False: (31, 138, 76), True: (63, 184, 114)}, {False: (207, 52, 56), True: (240, 102, 106)}
PAPER = {False: (255, 255, 255), True: (18, 20, 23)}
LANE_ROWS, STRIKER_ROWS = slice(100, 225), slice(250, 440)
"""Where the overview has its state timelines and the striker's motion."""


def rgb(rgba: int) -> tuple[int, int, int]:
    """Red, green and blue of a colour of the product's palette."""
    return rgba >> 24, rgba >> 16 & 255, rgba >> 8 & 255


TRUTH, STOP, START = map(rgb, (state_timeline.TRUTH, state_timeline.ALARM, state_timeline.WARN))
HEADINGS = "Array.from(document.querySelectorAll('h2'), h => h.innerText)"
OF_A_RUN = ["Checks", "Figures", "Made with"]
"""The parts of a run's report."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    page = Browser()
    yield page
    page.close()


@pytest.fixture(scope="module")
def run_dir(browser, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("seen") / "run"
    make_run(folder)
    return folder


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_a_report_shows_the_verdict_and_loads_nothing(browser, run_dir, dark):
    page = (run_dir / "report.html").as_uri()
    browser.open(page, dark)
    browser.wait_for("document.readyState == 'complete'")
    assert browser.evaluate(HEADINGS) == OF_A_RUN
    assert browser.requests == [page]
    width = browser.evaluate("document.documentElement.scrollWidth")
    assert width <= 1280, "nothing sticks out to the right"

    top = browser.look()
    assert near(top, PAPER[dark], 4) > 0.6 * top.shape[0] * top.shape[1]
    assert near(top, GREEN[dark], 8) > 800, "the badge of the verdict"


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_a_suites_page_leads_to_each_run(browser, run_dir, tmp_path, dark):
    verdict = read_verdict(run_dir / "verdict.json")
    checks = checks_of(read_scenario(run_dir))
    runs = (verdict, replace(verdict, reasons=("plant left no trace",)))
    both = [merge(checks, {1: one}) for one in runs]
    write_suite_report(tmp_path / "index.html", both, trace(both))
    browser.open((tmp_path / "index.html").as_uri(), dark)
    browser.wait_for("document.querySelectorAll('td a').length == 2")
    assert near(browser.look(), RED[dark], 8) > 800
    browser.follow("td a")
    assert browser.evaluate(HEADINGS) == OF_A_RUN


def test_the_viewer_shows_a_run_in_the_browser_from_this_machine_alone(browser, run_dir):
    def stop_line(seen: Picture) -> int:
        """How wide the widest row of the stop's colour is in the plot of the striker."""
        return int(drawn_in(seen[STRIKER_ROWS], STOP).sum(axis=1).max())

    def start_rows(seen: Picture) -> int:
        """How high the timeline of the run-up is, some 20 rows where it is drawn."""
        return int((drawn_in(seen[LANE_ROWS], START).sum(axis=1) > 1000).sum())

    command = window.viewer_command(run_dir / "run.rrd", web=True)
    with served(command, rerun_environment()) as (address, _):
        browser.open(address, dark=True)
        # The page is drawn piece by piece.
        picture = browser.look_until(lambda seen: stop_line(seen) > 1000 and start_rows(seen) >= 15)
    assert drawn_in(picture[STRIKER_ROWS], TRUTH, 40).sum() > 200, "the striker's position"
    # What the page's policy stops does not even become a request.
    asked = {urlsplit(url).hostname for url in browser.requests}
    assert asked == {"127.0.0.1", "localhost"}
