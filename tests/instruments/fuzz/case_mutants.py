"""Mutants of case files: small sound cases, changed as data, as text and as bytes."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Callable
from functools import cache
from typing import Any

import yaml

from ancf2d.case.compose import compose
from ancf2d.case.nodes import Origin, plain_data
from scripts.pages import ROOT

from . import trees

SOURCES = ("cases/*/*.yaml", "tests/case/valid/*.yaml")
DEFINITION = ROOT / "tests" / "case" / "definitions" / "own_element.yaml"
# what makes a case quick: most elements of a body, load steps, modes, time steps
COUNT, STEPS, MODES, TIMES = 3, 10, 4, 20
# what mutants can come from that no case of the repository has
EXTRAS = """
own: {bodies: {beam: {geometry: {type: line, start: [0, 0], end: [2, 0]}, section: {height: 0.2, width: 0.1},
  material: {E: 2.0e9, nu: 0.3, rho: 1000}, element: {definition: own.yaml, count: 2}}},
  boundary_conditions: [{type: clamp, at: beam@0}], loads: [{type: force, at: beam@1, value: [0, -100]}],
  solver: {type: linear_static}, goal: {probe: tip, quantity: uy}, output: {probes: {tip: beam@1}, fields: [stress]}}
auto: {bodies: {beam: {geometry: {type: line, start: [0, 0], end: [2, 0]}, section: {height: 0.2, width: 0.1},
  material: {E: 2.0e9, nu: 0.3, rho: 1000}, element: auto}},
  boundary_conditions: [{type: clamp, at: beam@0}], loads: [{type: force, at: beam@1, value: [0, -100]}],
  solver: {type: linear_static}, goal: {probe: tip, quantity: uy}, output: {probes: {tip: beam@1}}}
driven: {bodies: {a: {geometry: {type: line, start: [0, 0], end: [1, 0]}, section: {height: 0.1, width: 0.1},
  material: {E: 1.0e7, nu: 0.3, rho: 1000, damping: {kelvin_voigt: 1.0e-4}},
  element: {type: ancf, order: [2, 1], count: 2}},
  b: {geometry: {type: line, start: [1, 0], end: [2, 0.5]}, section: {EA: 1.0e5, kGA: 4.0e4, EI: 100, rhoA: 10,
  rhoI: 0.01}, element: {type: reissner3, count: 2}}},
  boundary_conditions: [{name: motor, type: prescribed, at: a@0, x: 0, y: {type: sine, frequency: 2, scale: 0.01},
  angle: {type: ramp, t0: 0, t1: 1}}], joints: [{type: pin, between: [a@1, b@0]}],
  springs: [{type: translational, between: [b@1, [3, 0]], stiffness: 100, damping: 1, length: 1},
  {type: rotational, between: [a@1, b@0], stiffness: 10, damping: 0.1}], masses: [{at: b@1, mass: 1, inertia: 0.1}],
  loads: [{type: follower_force, at: b@0.5, value: [0, 1],
  amplitude: {type: expression, value: "sin(t) if t < 0.5 else 1"}},
  {type: distributed, on: a, value: [0, -1], from: 0.2, to: 0.7,
  amplitude: {type: table, t: [0, 1], value: [0, 1]}}],
  damping: {rayleigh: {alpha: 0.1, beta: 1.0e-5}}, initial: {from: rest},
  solver: {type: dynamic, t_end: 0.02, dt: 0.002},
  output: {interval: 0.004, fields: [N, M], probes: {end: {at: b@1}, off: {at: a@0.5, y: 0.05}}}}
"""


class _Dumper(yaml.SafeDumper):
    """A YAML dumper without aliases."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


def small(data: Any) -> Any:
    """Reduce a case to few elements, steps and modes, so that it is solved in a moment."""
    out = json.loads(json.dumps(data))
    for path in list(trees.places(out)):
        parent, key = trees.value_at(out, path[:-1]), path[-1]
        most = {"count": COUNT, "steps": STEPS, "modes": MODES}.get(key)
        if most is not None and isinstance(parent[key], int):
            parent[key] = min(parent[key], most)
    solver = out.get("solver", {})
    if solver.get("type") == "dynamic":
        out.setdefault("output", {}).pop("interval", None)
        solver.update({"t_end": min(solver["t_end"], 0.05), "estimate": solver.get("estimate", False)})
        if "dt" in solver:
            solver["t_end"] = min(solver["t_end"], TIMES * solver["dt"])
        else:
            solver["tolerance"] = max(solver.get("tolerance", 0.0), 1e-4)
    for name, body in out["bodies"].items():
        if "definition" in body.get("element", ()):
            out["bodies"][name]["element"]["definition"] = "own.yaml"
    # errors estimated by finer meshes cost minutes
    out.pop("accuracy", None)
    if str(out.get("initial", {}).get("from", "")).endswith(".h5"):
        out["initial"]["from"] = "rest"
    out.pop("expected", None)
    return out


@cache
def bases() -> list[Any]:
    """Return the sound cases from which mutants are made, as plain data."""
    found = [_read(p.read_text(encoding="utf-8")) for pattern in SOURCES for p in sorted(ROOT.glob(pattern))]
    return [small(data) for data in (*found, *_read(EXTRAS).values())]


def _read(text: str) -> Any:
    """Return YAML as plain data, with numbers read as in cases."""
    return plain_data(compose(text, Origin("case.yaml", text.split("\n"))))


def mutant(seed: int, number: int) -> tuple[bytes, bytes]:
    """Return one case file, and the element definition that may stand beside it; the same for the same numbers."""
    rng = random.Random(f"{seed}:{number}")
    base = rng.choice(bases())
    definition = DEFINITION.read_bytes()
    way = rng.random()
    if way < 0.04:  # the definition of an element is a case file of its own
        own = next(b for b in bases() if "own.yaml" in json.dumps(b))
        data = _read(definition.decode())
        for _ in range(rng.choice([1, 1, 2, 3])):
            data = trees.changed(data, rng, bases()[:3])
        return _text(own, rng).encode(), _damaged(_text(data, rng).encode(), rng, 0.2)
    if way < 0.75:
        strangers = rng.sample(bases(), 3)
        for _ in range(rng.choice([1, 1, 1, 1, 1, 2, 2, 3, 5])):
            base = trees.changed(base, rng, strangers)
        return _damaged(_text(base, rng).encode("utf-8", "surrogatepass"), rng, 0.02), definition
    if way < 0.85:
        return rng.choice(TRICKS)(_text(base, rng), rng), definition
    return _damaged(_text(base, rng).encode(), rng, 1.0), definition


def _text(data: Any, rng: random.Random) -> str:
    """Return plain data as YAML, in one of several styles."""
    if rng.random() < 0.3:
        return json.dumps(data, ensure_ascii=rng.random() < 0.5)
    return yaml.dump(data, Dumper=_Dumper, allow_unicode=True, sort_keys=False, width=math.inf,
                     default_flow_style=rng.choice([None, True, False]))


def _damaged(data: bytes, rng: random.Random, share: float) -> bytes:
    """Return bytes, a given share of the calls with some of them changed."""
    if rng.random() >= share:
        return data
    out = bytearray(data)
    for _ in range(rng.choice([1, 1, 2, 4, 16])):
        at, size = rng.randrange(len(out) + 1), rng.choice([1, 1, 1, 2, 8, 64])
        act = rng.randrange(6)
        if act == 0:
            out[at:at + 1] = bytes([rng.randrange(256)])
        elif act == 1:
            out[at:at] = rng.choice([b"\t", b":", b" ", b"\n", b"{", b"[", b"]", b"'", b'"', b"#", b"&a ", b"*a ",
                                     b"!!", b"\x00", b"\xff",
                                     b"\xc0\x80", b"\xed\xa0\x80", b"\xf4\x90\x80\x80", b"- ", b"? ",
                                     b"---\n", b"...\n", b"%YAML 1.1\n", b"|\n", b">\n", b"9", b"e", b"-", b"."])
        elif act == 2:
            del out[at:at + size]
        elif act == 3:
            out[at:at] = out[at:at + size] * rng.choice([1, 2, 50])
        elif act == 4:
            out[at:at + 1] = bytes(b ^ 1 << rng.randrange(8) for b in out[at:at + 1])
        elif rng.random() < 0.2:
            del out[at:]
    return bytes(out)


def _twice(text: str, rng: random.Random) -> bytes:
    lines = text.split("\n")
    at = rng.randrange(len(lines))
    return "\n".join([*lines[:at], lines[at], *lines[at:]]).encode()


def _indent(text: str, rng: random.Random) -> bytes:
    lines = text.split("\n")
    at = rng.randrange(len(lines))
    lines[at] = rng.choice([" ", "   ", "\t", "\u00a0", "\u3000"]) + lines[at]
    return "\n".join(lines).encode()


def _laughs(text: str, rng: random.Random) -> bytes:
    rows = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    rows += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, rng.choice([3, 9, 40]))]
    return ("\n".join(rows) + "\n" + text).encode()


def _big(text: str, rng: random.Random) -> bytes:
    """Blow a file up to megabytes, in one of several ways."""
    n = rng.choice([10**3] * 3 + [10**4] * 3 + [10**5] * 2 + [10**6])
    return rng.choice([
        lambda: text + "#" * n, lambda: text + "\n" * n, lambda: "title: " + "x" * n + "\n" + text,
        lambda: "[" * n, lambda: "{a: " * n, lambda: "- " * n, lambda: "? " * n, lambda: "'" + "''" * n,
        lambda: "\n".join(f"k{i}: {i}" for i in range(n // 10)) + "\n" + text,
        lambda: "loads: [" + "{type: force}, " * (n // 20) + "]\n", lambda: "loads: [" + "1, " * (n // 4) + "]\n",
        lambda: "title: " + "9" * min(n, 10**5) + "\n" + text, lambda: text + " " * n + "\t",
        lambda: "\u2028" * (n // 4) + text,
        lambda: "bodies: {" + ", ".join(f"b{i}: {{}}" for i in range(n // 20)) + "}"])().encode()


TRICKS: list[Callable[[str, random.Random], bytes]] = [
    _twice, _twice, _indent, _indent, _laughs, _big, _big,
    lambda text, rng: text.encode(rng.choice(["utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-8-sig", "utf-7"])),
    lambda text, rng: text.replace("\n", rng.choice(["\r\n", "\r", "\n\r", "\u2028", "\x85", "\x0b", "\x0c"])).encode(),
    lambda text, rng: text.replace("e", "é").encode(rng.choice(["latin-1", "cp1252", "cp037", "utf-8"])),
    lambda text, rng: (rng.choice(["--- ", "%TAG ! tag:x,2000:\n---\n", "%YAML 9.9\n---\n",
                                   "!!python/object/apply:os.system ", "&a ", "!!map ", "? ", "<<: *x\n"])
                       + text).encode(),
    lambda text, rng: (text + rng.choice(["\n---\n", "\n...\n", "\n...\nx", "\n--- {}\n"]) + text).encode(),
    lambda text, rng: rng.randbytes(rng.choice([0, 1, 10, 1000, 100_000])),
]
