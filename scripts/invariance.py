"""Examine ancf2d by random scenes that must not change when they are turned, mirrored, split, ...

    python -m scripts.invariance --scenes 20000 --seed 1 --jobs 2

What is found is kept in a folder, and a run that is stopped goes on from there. Prints how many scenes held under each
invariance, and why scenes were refused; exits with 1 where an invariance is violated that no warning explains, and
writes the smallest case that shows it. ``--scene 17`` tries one scene and tells what each check finds; ``--page``
writes the tables into docs/robustness.md.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path

from scripts.pages import DOCS, stamp, table, write
from scripts.scenes import campaign
from scripts.scenes.checks import Scene, checks_for
from scripts.scenes.generate import SOLVERS, scene

PAGE = DOCS / "robustness.md"
# violations that are made small, of each check and solver
SHRUNK = 2


def main() -> None:
    """Try the scenes that are asked for."""
    args = arguments()
    if args.scene is not None:
        sys.exit(one(args))
    folder = Path(args.folder or f"invariance-{args.seed}{'-laws' * args.laws}")
    folder.mkdir(exist_ok=True)
    log, began = folder / "scenes.jsonl", time.monotonic()
    done = campaign.kept(log)
    open_ = [n for n in range(args.first, args.first + args.scenes) if n not in done]
    jobs = [(args.seed, n, args.solver, args.checks, args.laws) for n in open_]
    for i, record in enumerate(campaign.examined(jobs, args.jobs)):
        campaign.keep(log, record)
        done[record.number] = record
        for name, what in record.violations.items():
            print(f"{record.number} {record.solver}: {name}: {what}", file=sys.stderr, flush=True)
        if args.minutes and time.monotonic() - began > 60 * args.minutes:
            print(f"stopped after {i + 1} scenes; the same command goes on", file=sys.stderr)
            break
    records = list(done.values())
    if not args.keep_large:
        shrink(folder, records, args)
    text = report(records, args.seed)
    print(text)
    if args.page:
        alone = (" --laws" if args.laws else "") + (f" --solver {args.solver}" if args.solver else "")
        made = stamp(f"invariance --scenes {len(records)} --seed {args.seed}{alone} --page", "h5py")
        write(PAGE, "laws" if args.laws else "invariances", f"{text}\n\n{made}")
    sys.exit(1 if any(r.violations for r in records) else 0)


def arguments() -> argparse.Namespace:
    """Return what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=1000, help="how many scenes")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--checks", type=int, default=campaign.DRAWN,
                        help="per scene, drawn by lot, beside those that need no further solution")
    parser.add_argument("--solver", choices=list(SOLVERS), help="this one alone")
    parser.add_argument("--laws", action="store_true", help="scenes whose materials yield, follow a curve or relax")
    parser.add_argument("--folder", help="where records and counterexamples go (default: invariance-SEED)")
    parser.add_argument("--minutes", type=float, help="stop after so many")
    parser.add_argument("--keep-large", action="store_true", help="do not make counterexamples small")
    parser.add_argument("--scene", type=int, help="try this scene alone, with every check")
    parser.add_argument("--page", action="store_true", help="write the tables into docs/robustness.md")
    return parser.parse_args()


def one(args: argparse.Namespace) -> int:
    """Tell what each check finds in one scene; return 1 where one is violated."""
    case = scene(args.seed, args.scene, args.solver, args.laws)
    path = Path(f"scene-{args.seed}-{args.scene}.yaml")
    campaign.write_case(path, case, f"scene {args.scene} of seed {args.seed}")
    item = Scene(case, (args.seed, args.scene))
    print(f"wrote {path}", item.base.refusal or f"converged; round-off {item.known:.1g}", *item.base.warnings, sep="\n")
    found = {c.name: campaign.outcome(item, c) for c in checks_for(item)}
    for name, (word, what) in found.items():
        print(f"{name:30} {word:10} {what}")
    return int(any(word == "violated" for word, _ in found.values()))


def shrink(folder: Path, records: list[campaign.Record], args: argparse.Namespace) -> None:
    """Write the smallest cases that show the first violations of each check."""
    seen: Counter[tuple[str, str]] = Counter()
    for record in sorted(records, key=lambda r: r.number):
        for name, what in record.violations.items():
            seen[name, record.solver] += 1
            path = folder / f"{record.number}-{name.replace(' ', '-')}.yaml"
            if seen[name, record.solver] > SHRUNK or path.exists() or "itself failed" in what:
                continue
            case = campaign.counterexample(args.seed, record.number, args.solver, name, args.laws)
            campaign.write_case(path, case, f"{name}, scene {record.number} of seed {args.seed}\n{what}")
            print(f"wrote {path}", file=sys.stderr)


def report(records: list[campaign.Record], seed: int) -> str:
    """Return the tables."""
    rows = campaign.counts(records)
    head = ["invariance", "solver", "held", "announced", "refused", "ill-conditioned", "not fit", "violated"]
    refused = campaign.refusals(records)
    total = Counter(r.solver for r in records)
    counts = ", ".join(f"{n} {solver}" for solver, n in total.most_common())
    return (f"{table(head, rows)}\n\n{len(records)} scenes of seed {seed}: {counts}; "
            f"{sum(bool(r.violations) for r in records)} with a violation, {sum(bool(r.refusal) for r in records)} "
            f"refused:\n\n{table(['why', 'solver', 'scenes'], refused)}")


if __name__ == "__main__":
    main()
