"""The measured tables of motions and robustness: their places on the pages, and with --pages their contents."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
from instruments.endurance import events, repeats, stops
from instruments.fuzz import case_trial, result_trial
from instruments.motions import cases, conservation, crossings, estimates, joints, kills, orders, traps

from scripts.pages import DOCS

# by page and place; a place that tests of random trials fill is named without what makes it
TABLES: dict[str, dict[str, Callable[[], str] | None]] = {
    "motion.md": {
        "stamp": None, "cases": cases.exact, "given": cases.given, "paper": cases.paper, "apart": cases.apart,
        "drift": lambda: conservation.drifts(1_000_000), "steady": lambda: conservation.steadies(1000.0),
        "turned": conservation.turned, "traps": traps.report, "tolerances": traps.tolerances,
        "estimates": estimates.report, "joints": joints.report,
        "orders": orders.report, "kills": lambda: kills.report(50)},
    "moving.md": {"crossings": crossings.report},
    "robustness.md": {
        "invariances": None, "laws": None, "frames": None, "mechanisms": None,
        "cases": lambda: case_trial.report(10_000), "results": lambda: result_trial.report(1000),
        "growth": lambda: repeats.growth_report(1000), "threads": repeats.thread_report,
        "crowds": repeats.crowds_report, "stops": lambda: stops.stops_report(10), "places": stops.places_report,
        "events": lambda: events.report(100_000)},
    "extremes.md": {"stamp": None, "counts": None, "map": None},
}
# what a table says where something is not as promised; faults are items of a list
WRONG = re.compile(r"MISSED|MISLEADS|^\* .*", re.M)


@pytest.mark.pages
@pytest.mark.parametrize(("page", "place"), [pytest.param(page, place, id=f"{page.split('.')[0]}-{place}")
                                             for page, made in TABLES.items() for place in made if made[place]])
def test_table(page: str, place: str, measured: Callable[..., None]) -> None:
    make = TABLES[page][place]
    assert make is not None
    text = make()
    measured(page, place, text)
    assert WRONG.findall(text) == []


@pytest.mark.parametrize("page", TABLES)
def test_every_table_has_its_place_on_the_page(page: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    assert sorted(re.findall(r"<!-- measured: (\S+) -->", text)) == sorted(TABLES[page])
    assert re.findall(r"<!-- measured: (\S+) -->\n<!-- end -->", text) == []
    assert WRONG.findall("\n".join(re.findall(r"<!-- measured: .*?<!-- end -->", text, re.S))) == []
