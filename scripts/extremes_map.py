"""Try ancf2d at its extremes, judge every cell, and write the map into docs/extremes.md, stamped.

Cells that the store has are not tried again; ``--fresh`` begins anew. Exit code 1 where a cell is wrong.

    python -m scripts.extremes_map [--only TEXT] [--store FILE] [--fresh] [--list] [--no-page]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

from scripts.pages import DOCS, one_thread, stamp, write

# before NumPy is imported
one_thread()

from scripts.extremes import cell, table  # noqa: E402
from scripts.extremes.table import all_rows  # noqa: E402

PAGE = DOCS / "extremes.md"


def main() -> None:
    """Try the cells that are asked for, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", help="cells whose axis, measure, value or element has this text")
    parser.add_argument("--store", type=Path, default=Path("extremes.jsonl"), help="where verdicts are kept")
    parser.add_argument("--fresh", action="store_true", help="forget what the store has")
    parser.add_argument("--list", action="store_true", help="name the cells only")
    parser.add_argument("--no-page", action="store_true", help="leave docs/extremes.md as it is")
    args = parser.parse_args()
    cells = [c for c in all_rows() if args.only in c.key]
    if args.list:
        print("\n".join(c.key for c in cells))
        return
    store, began = table.Store(args.store, args.fresh), time.perf_counter()
    for k, c in enumerate(cells):
        if c.key not in store.found:
            store.add(cell.run(c))
            _tell(k + 1, len(cells), store.found[c.key])
    found = [store.found[c.key] for c in cells]
    total = Counter(v.verdict for v in found)
    print(", ".join(f"{total[w]} {w}" for w in cell.VERDICTS), f"({time.perf_counter() - began:.0f} s)")
    if not args.no_page and not args.only:
        write(PAGE, "stamp", f"{len(found)} cells. {stamp('extremes_map')}")
        write(PAGE, "counts", table.counts(found))
        write(PAGE, "map", table.grids(found))
    sys.exit(1 if total["wrong"] else 0)


def _tell(k: int, n: int, v: cell.Verdict) -> None:
    error = "" if v.error is None else f"{v.error:.1e}"
    if v.verdict != "holds" or v.seconds > 5.0:
        print(f"{k}/{n} {v.verdict:8} {error:8} {v.seconds:5.1f} s  {v.key}  {v.message[:150]!r}", flush=True)


if __name__ == "__main__":
    main()
