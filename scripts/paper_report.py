"""The seed paper's tables and figures, remade, in one HTML page that needs no other file."""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from html import escape
from typing import Any

from scripts import table3
from scripts.pages import machine, versions
from scripts.paper_figures import Drawn, Workshop, mode_figures, static_figures
from scripts.paper_motion import motion_figures
from scripts.paper_tables import TABLES

PAPER = ("Transversally higher-order interpolating polynomials for the two-dimensional shear deformable ANCF beam "
         "elements based on common coefficients")
MIME = {"svg": "image/svg+xml", "png": "image/png"}
SAME = "same to all printed digits"
# what the paper's formulas and data have to be read as, for its own numbers to come out
READINGS = (
    ("Eq. (9)", "puts 2 mu on the tensor component eps_xy, and Eq. (10) counts it once: the shear energy is half of "
     "the right one, a shear factor of 0.5. All tables carry it, and so do the cases here (preset: paper). It, not the "
     "y^2 term, is why the shear frequencies of Table 3 are low."),
    ("Eq. (5)", "has x^3/l in s_5 where x^3/l^2 is meant."),
    ("Eq. (13)", "has a factor 1/2 too many: with it, no frequency of Table 3 comes out."),
    ("Table 1", "drops the minus signs of the column of Ref. [18]."),
    ("Table 3", "is in rad/s for E = 1e9, not for the 2.07e11 of the text."),
    ("Figs. 3 to 19", "show curves without printed numbers: they are compared with this program's own geometrically "
     "exact and Euler-Bernoulli beams, which stand for BEAM188, BEAM189, B32 and BEAM3. How long the motions last and "
     "how large the driving force of the slider-crank is, the text does not say."),
)
STYLE = """
body { font: 15px/1.5 system-ui, -apple-system, "Segoe UI", sans-serif; color: #1a1a1a; background: #fff;
  max-width: 62rem; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.5rem; line-height: 1.25; } h2 { margin-top: 2.4rem; border-bottom: 1px solid #ccc; }
table { border-collapse: collapse; margin: 0.8rem 0; font-variant-numeric: tabular-nums; width: 100%; }
th, td { text-align: left; padding: 0.15rem 0.7rem 0.15rem 0; vertical-align: top; border-bottom: 1px solid #eee; }
th { border-bottom: 1px solid #888; } td.n, th.n { text-align: right; }
td:first-child, table.numbers td:nth-child(2) { white-space: nowrap; }
.same { color: #1a6b3c; } .differs { color: #a33; } .alarm { background: #fdd; font-weight: bold; }
figure { margin: 1.6rem 0; break-inside: avoid; } figure img { max-width: 100%; width: 40rem; display: block; }
figure img.wide { width: 60rem; }
figcaption { max-width: 46rem; } figcaption p { margin: 0.2rem 0; } ol.why { padding-left: 1.4rem; }
thead { display: table-header-group; } tr { break-inside: avoid; }
@media print { body { margin: 0; max-width: none; font-size: 11px; } h2 { break-after: avoid; } }
"""


@dataclass(frozen=True)
class Count:
    """How much of a table is as it is printed, and whether the rest is as documented."""

    name: str
    same: int
    whole: int
    documented: bool


def table_html(head: Sequence[tuple[str, bool]], rows: Sequence[Sequence[str]], kind: str = "numbers") -> str:
    """Return an HTML table of a kind with a style; of the head each (text, whether it is a number); cells are HTML."""
    marks = [' class="n"' if number else "" for _, number in head]
    top = "".join(f"<th{m}>{escape(text)}</th>" for (text, _), m in zip(head, marks, strict=True))
    body = "\n".join("<tr>" + "".join(f"<td{m}>{c}</td>" for c, m in zip(row, marks, strict=True)) + "</tr>"
                     for row in rows)
    return f'<table class="{kind}"><thead><tr>{top}</tr></thead><tbody>\n{body}\n</tbody></table>'


def difference(printed: str, computed: str, sign_lost: bool = False) -> str:
    """Return computed less printed to the printed digits, empty where they are the same."""
    value = abs(float(computed)) - abs(float(printed)) if sign_lost else float(computed) - float(printed)
    decimals = len(printed.partition(".")[2])
    return "" if round(value, decimals) == 0 else f"{value:+.{decimals}f}"


def verdict(same: bool, documented: bool = True, mark: str = "") -> str:
    """Return the verdict on one number as HTML."""
    word = '<span class="same">same digits</span>' if same else f'<span class="differs">differs</span>{mark}'
    return word if documented else f'<span class="alarm">{word}, not as documented</span>'


def static_table(name: str, verdicts: Sequence[dict[str, Any]]) -> tuple[str, Count]:
    """Return Table 1 or 2 with its verdicts, and how much of it is as printed."""
    table = TABLES[name]
    reasons = list(dict.fromkeys(v["why"] for v in verdicts if v["why"]))
    lost = {(e.row, e.column): e.sign_lost for e in table.entries}
    rows = []
    for v in verdicts:
        mark = f" [{reasons.index(v['why']) + 1}]" if v["why"] else ""
        rows.append([escape(v["row"]), escape(v["column"]), v["printed"], v["computed"],
                     difference(v["printed"], v["computed"], lost[v["row"], v["column"]]),
                     verdict(v["same"], v["documented"], mark)])
    head = [("", False), ("", False), ("printed", True), ("computed", True), ("difference", True), ("verdict", False)]
    notes = "".join(f"<p>{escape(text)}</p>" for text in table.notes)
    why = "".join(f"<li>{escape(text)}.</li>" for text in reasons)
    html = (f'<h2 id="table{name}">{escape(table.title)} [{table.unit}]</h2>{notes}{table_html(head, rows)}'
            f'<ol class="why">{why}</ol>')
    same = sum(v["same"] for v in verdicts)
    return html, Count(f"Table {name}", same, len(verdicts), all(v["documented"] for v in verdicts))


def modes_table() -> tuple[str, Count]:
    """Return Table 3 with what each printed mode is, and how much of it is as printed."""
    rows, same = [], []
    for title, found in table3.paper().items():
        for r in found:
            computed = f"{r.omega:.2f}"
            same.append(r.same)
            rows.append([escape(title), r.name, r.printed, computed, difference(r.printed, computed), verdict(r.same),
                         escape(r.kind), escape(r.remark)])
    documented = all(same)
    for name, printed, omega in table3.analytic():
        computed = f"{omega:.2f}"
        right = computed == printed
        same.append(right)
        documented &= computed == table3.SLIPS.get(name, printed)
        rows.append(["analytical", name, printed, computed, difference(printed, computed), verdict(right), "",
                     "" if right else f"the formula gives {omega:.4f}: a slip of rounding"])
    head = [("element", False), ("name", False), ("printed", True), ("computed", True), ("difference", True),
            ("verdict", False), ("by its shape", False), ("remark", False)]
    text = ("Natural frequencies of a thick simply supported beam, exact integration. A frequency can be right and its "
            "name wrong: 'by its shape' says what the mode is by its kinetic energy; 'spurious' are modes of the mesh, "
            "whose elements part at their end faces. The analytical row is Timoshenko's beam with k = "
            "10(1+nu)/(12+11nu), the bar, and uncoupled stretch.")
    return (f'<h2 id="table3">Table 3: eigenfrequencies [rad/s]</h2><p>{escape(text)}</p>{table_html(head, rows)}',
            Count("Table 3", sum(same), len(same), documented))


def figure_html(drawn: Drawn) -> str:
    """Return a picture with its caption; the picture is inside the text."""
    suffix = drawn.file.suffix[1:]
    data = base64.b64encode(drawn.file.read_bytes()).decode()
    name, title = escape(drawn.name), escape(drawn.title)
    wide = ' class="wide"' if drawn.name == "Table 4" else ""
    return (f'<figure><img{wide} alt="{name}: {title}" src="data:{MIME[suffix]};base64,{data}">\n'
            f"<figcaption><p><b>{name}</b>, {title}. The paper: {escape(drawn.claim)} {_borne(drawn)}</p>\n"
            f"<p>{escape(drawn.seen)}</p></figcaption></figure>")


def _borne(drawn: Drawn) -> str:
    word = '<span class="same">Borne out</span>' if drawn.holds else '<span class="differs">Not borne out</span>'
    return f"{word}: {escape(drawn.but)}." if drawn.but else f"{word}."


def summary(counts: Sequence[Count], figures: Sequence[Drawn]) -> str:
    """Return what all of it comes to."""
    rows = [[f'<a href="#{c.name.lower().replace(" ", "")}">{c.name}</a>', f"{c.same} of {c.whole} {SAME}",
             "all others explained" if c.documented and c.same < c.whole else "" if c.documented else
             '<span class="alarm">some not as documented</span>'] for c in counts]
    names = list(dict.fromkeys(d.name for d in figures))
    for name in names:
        of = [d for d in figures if d.name == name]
        rows.append([name, escape(of[0].claim), _borne(of[0] if all(d.holds for d in of) else
                                                       next(d for d in of if not d.holds))])
    return table_html([("", False), ("", False), ("here", False)], rows, "summary")


def page(shop: Workshop, examine: Callable[[Any], list[dict[str, Any]]]) -> tuple[str, bool]:
    """Return the page, and whether every number is as documented. Raises CaseError, ComputationError, ResultsError.

    ``examine`` returns the verdicts on a table of numbers.
    """
    shop.told("tables 1 and 2")
    tables = [static_table(name, examine(TABLES[name])) for name in sorted(TABLES)]
    shop.told("table 3")
    tables.append(modes_table())
    figures = [*mode_figures(shop), *static_figures(shop), *motion_figures(shop)]
    counts = [count for _, count in tables]
    readings = "".join(f"<li><b>{escape(where)}</b> {escape(text)}</li>" for where, text in READINGS)
    stamp = f"{date.today()}; {versions()}; {machine()}"
    body = "\n".join([
        "<h1>The paper's tables and figures, remade</h1>",
        f"<p><i>{PAPER}</i>, computed by ancf2d: {escape(stamp)}.</p>",
        summary(counts, figures), "<h2>How the paper is read</h2>", f"<ul>{readings}</ul>",
        "<p>Figures 1, 2, 6 and 16 are sketches of the problems and hold no results.</p>",
        *(html for html, _ in tables), "<h2>Table 4</h2>",
        *(figure_html(d) for d in figures if d.name == "Table 4"), "<h2>Figures</h2>",
        *(figure_html(d) for d in figures if d.name != "Table 4")])
    text = ('<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>The paper, remade by ancf2d</title>\n'
            f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head>\n<body>\n{body}\n'
            "</body></html>\n")
    return text, all(c.documented for c in counts)
