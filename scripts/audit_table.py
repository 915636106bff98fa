"""The examination of every element type as Markdown: a table of verdicts, and what fails in words.

    python -m scripts.audit_table            both tables

scripts/make_docs.py puts them into docs/audit.md.
"""

from __future__ import annotations

from functools import cache

from ancf2d.elements import registry
from ancf2d.study.audit.examine import CHECKS, Audit, audit
from ancf2d.study.audit.subject import FAIL, PASS, subject
from scripts.pages import table

# members of the family that stand for it
MEMBERS = ("ancf[1,2]", "ancf[2,2]", "ancf[3,3]")
# times differ from machine to machine
LEFT_OUT = ("cost",)


def asked() -> dict[str, tuple[str, dict[str, str]]]:
    """Return what is examined: each type as recommended, in the full continuum form, and as in the paper."""
    variants: list[tuple[str, dict[str, str]]] = [(name, {}) for name in (*registry.ELEMENTS, *MEMBERS)]
    variants += [(t.name, {"formulation": "continuum"}) for t in registry.ELEMENTS.values()
                 if t.degree_y == 1 and t.formulation != "continuum"]
    variants += [(t.name, {"preset": "paper"}) for t in registry.ELEMENTS.values() if t.preset]
    return {", ".join([name, *options.values()]): (name, options) for name, options in variants}


@cache
def examined(title: str) -> Audit:
    """Return the examination of one of them."""
    name, options = asked()[title]
    return audit(subject(name, **options), tuple(c for c in CHECKS if c.name not in LEFT_OUT))


def verdicts() -> str:
    """Return the table of verdicts: a column per type, a row per check."""
    found = {title: examined(title) for title in asked()}
    words = {PASS: "pass", FAIL: "**fail**"}
    names = [c.name for c in CHECKS if c.name not in LEFT_OUT]
    answers = {title: {a.check.name: a.finding.verdict for a in result.results} for title, result in found.items()}
    return table(["check", *found], [[f"`{name}`", *(words.get(answers[t][name], "note") for t in found)]
                                     for name in names])


def failures() -> str:
    """Return what fails, with number and meaning, type by type."""
    rows = []
    for title in asked():
        for a in examined(title).results:
            f = a.finding
            if f.verdict == FAIL:
                rows.append([title, f"`{a.check.name}`", "-" if f.value is None else f"{f.value:.3g}", f.meaning])
    return table(["type", "check", "value", "meaning"], rows)


if __name__ == "__main__":
    print(verdicts(), failures(), sep="\n\n")
