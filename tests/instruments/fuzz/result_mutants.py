"""Mutants of result files: sound files of every kind with changed bytes and HDF5 objects."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from . import trees
from .case_mutants import ROOT, small
from .command import call

# a result of each kind: the case, the command, and what is asked for beyond the case
KINDS: dict[str, tuple[str, list[str], list[str]]] = {
    "static": ("static/elastica", ["run"], []),
    "frame": ("static/portal_frame", ["run"], []),
    "path": ("paths/lee_frame_vallejo", ["run"], ["output.every=1"]),
    "modes": ("modes/portal_frame", ["run"], []),
    "buckling": ("buckling/euler_propped", ["run"], []),
    "motion": ("dynamic/pendulum2_2d3n_4", ["run"], ["output.fields=[stress, energy]", "output.every=2"]),
    "mechanism": ("dynamic/four_bar", ["run"], []),
    "convergence": ("static/thick_cantilever", ["convergence", "--elements", "1,2,4"], []),
}


def make_bases(folder: Path) -> list[Path]:
    """Write the sound result files from which mutants are made. Raises RuntimeError if one cannot be made."""
    from ancf2d.case.compose import compose
    from ancf2d.case.nodes import Origin, plain_data

    found = []
    for name, (case, command, more) in KINDS.items():
        text = (ROOT / "cases" / f"{case}.yaml").read_text(encoding="utf-8")
        path, out = folder / f"{name}.yaml", folder / f"{name}.h5"
        path.write_text(json.dumps(small(plain_data(compose(text, Origin("", text.split("\n")))))), encoding="utf-8")
        sets = [v for m in more for v in ("--set", m)]
        done = call(command[0], str(path), *command[1:], "-o", str(out), *sets)
        if not out.exists():
            raise RuntimeError(f"{name}: {done.err}")
        found.append(out)
    return found


def mutant(bases: list[Path], path: Path, seed: int, number: int) -> Path:
    """Write one mutant to ``path``; return the sound file it is made from."""
    rng = random.Random(f"{seed}:{number}")
    base = rng.choice(bases)
    content = base.read_bytes()
    if rng.random() < 0.3:
        path.write_bytes(_damaged(content, rng))
        return base
    path.write_bytes(content)
    try:
        with h5py.File(path, "r+") as file:
            for _ in range(rng.choice([1, 1, 1, 2, 4])):
                _edit(file, rng)
    except (OSError, RuntimeError, KeyError, TypeError, ValueError, AttributeError, MemoryError):
        # what HDF5 itself does not allow, or an edit after which it writes no more: what is there is a mutant, too
        pass
    if rng.random() < 0.05:
        path.write_bytes(_damaged(path.read_bytes(), rng))
    return base


def _damaged(content: bytes, rng: random.Random) -> bytes:
    """Return bytes flipped, cut, moved, doubled or blanked."""
    out = bytearray(content)
    for _ in range(rng.choice([1, 2, 8, 64])):
        at, size = rng.randrange(len(out)), rng.choice([1, 4, 8, 64, 512, 4096])
        if rng.random() < 0.2:  # where HDF5 keeps its own: headers are near the beginning of what they describe
            at = rng.randrange(min(len(out), 4096))
        act = rng.randrange(5)
        if act == 0:
            out[at] ^= 1 << rng.randrange(8)
        elif act == 1:
            out[at] = rng.randrange(256)
        elif act == 2:
            out[at:at + size] = bytes(len(out[at:at + size]))
        elif act == 3:
            out[at:at + 8] = rng.choice([b"\xff" * 8, b"\x00" * 8, b"\x7f" + b"\xff" * 7, rng.randbytes(8)])
        else:
            other = rng.randrange(len(out))
            out[at:at + size] = out[other:other + len(out[at:at + size])]
    way = rng.random()
    if way < 0.15:
        del out[rng.randrange(len(out) + 1):]
    elif way < 0.2:
        out += rng.randbytes(rng.choice([1, 100, 10_000]))
    elif way < 0.22:
        out[:0] = bytes(512)
    return bytes(out)


def _edit(file: h5py.File, rng: random.Random) -> None:
    """Change one object or attribute."""
    names: list[str] = []
    file.visit(names.append)
    name = rng.choice(names)
    rng.choice(EDITS)(file, name, rng)


def _replace(file: h5py.File, name: str, rng: random.Random) -> None:
    """Replace an object by data of another shape, type or size."""
    attributes = dict(file[name].attrs)
    old = file[name]
    shape = old.shape if isinstance(old, h5py.Dataset) and old.shape else (3,)
    del file[name]
    options: list[dict[str, Any]] = [
        {"data": np.zeros((*shape, 2))}, {"data": np.zeros(shape[1:])}, {"data": np.zeros([n + 1 for n in shape])},
        {"data": np.zeros(shape, complex)}, {"data": np.zeros(shape, bool)}, {"data": np.zeros(shape, "i1")},
        {"data": np.zeros(shape, "u8")}, {"data": np.zeros(shape, [("a", "f8"), ("b", "S3")])},
        {"data": h5py.Empty("f8")},
        {"data": np.zeros(shape, ">f4")}, {"data": "text"}, {"data": np.bytes_(b"\xff\xfe")},
        {"data": ["a"] * 3}, {"data": np.zeros(shape, "V8")}, {"data": np.zeros(0)},
        {"shape": (10**9,), "dtype": "f8", "chunks": (1000,)}, {"shape": (10**15, 3), "dtype": "f8", "chunks": (10, 3)},
        {"shape": (10**7,), "dtype": "f8", "chunks": (10**6,), "compression": "gzip", "data": np.zeros(10**7)},
        {"shape": (2**40,), "dtype": "i1", "chunks": (2**30,)}, {"shape": (0, *shape[1:]), "dtype": "f8"},
        {"data": np.zeros(shape, h5py.vlen_dtype(float))}, {"data": np.zeros(shape, h5py.ref_dtype)},
        {"shape": shape, "dtype": "f8", "external": [("/etc/passwd", 0, 10**6)]},
        {"data": np.full(shape, 2**62, "i8")}]
    new = file.create_dataset(name, **rng.choice(options))
    for key, value in attributes.items():
        new.attrs[key] = value


def _fill(file: h5py.File, name: str, rng: random.Random) -> None:
    """Put odd numbers into a dataset."""
    data = file[name]
    if not isinstance(data, h5py.Dataset) or data.dtype.kind not in "iuf" or not data.size:
        _attribute(file, name, rng)
        return
    values = data[()]
    odd = [np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 0.0, -1.0] if data.dtype.kind == "f" else [
        -1, 0, 1, 2**31, -2**31, 2**62, -2**62, 10**6]
    flat = np.atleast_1d(values).reshape(-1)
    part = slice(None) if rng.random() < 0.3 else [rng.randrange(len(flat)) for _ in range(3)]
    with np.errstate(all="ignore"):
        flat[part] = np.asarray(rng.choice(odd)).astype(data.dtype)
    data[...] = flat.reshape(data.shape)


def _delete(file: h5py.File, name: str, rng: random.Random) -> None:
    del file[name]


def _link(file: h5py.File, name: str, rng: random.Random) -> None:
    """Replace an object by a link: to nothing, to itself, to another file, round in a circle."""
    names: list[str] = []
    file.visit(names.append)
    other = rng.choice(names)
    hard = file[other]
    del file[name]
    file[name] = rng.choice([h5py.SoftLink("/" + name), h5py.SoftLink("/nothing"), h5py.SoftLink("/" + other),
                             h5py.ExternalLink("mutant.h5", "/"), h5py.ExternalLink("/etc/passwd", "/"), hard,
                             file["/"]])


def _kind(file: h5py.File, name: str, rng: random.Random) -> None:
    """Replace a dataset by a group or vice versa, or move an object."""
    if rng.random() < 0.5:
        del file[name]
        file.create_group(name)
        return
    file.move(name, rng.choice(["x", "mesh/x", "states/x", "probes/ü", "tables/a%2Fb", "arrays/" + "n" * 300,
                                "fields/x/y"]))


def _attribute(file: h5py.File, name: str, rng: random.Random) -> None:
    """Change or remove an attribute, in half of all calls one of the file itself."""
    node = file if rng.random() < 0.5 else file[name]
    keys = list(node.attrs)
    key = rng.choice(keys) if keys else "committed"
    if rng.random() < 0.25 and keys:
        del node.attrs[key]
        return
    value = rng.choice([0, -1, 2**40, 1e308, np.nan, "", "x", "\u202e😀", np.zeros(3), np.zeros(0), np.array([2, 2, 2]),
                        np.array([10**6] * 3), np.array([-1, 0, 0]), np.bytes_(b"\xff\xfe"), True, h5py.Empty("f8"),
                        "a" * 60_000, np.zeros((2, 2), complex), ["a", "b"], 99, "converged", "running", "dynamic",
                        "eigen", "static", "tangent", "theta", "interpolated"])
    node.attrs[key] = value


def _texts(file: h5py.File, name: str, rng: random.Random) -> None:
    """Change the summary as JSON, or another text."""
    texts = [n for n in ("summary", "case/text", "case/completed", "case/overrides") if n in file]
    chosen = rng.choice([*texts, *["summary"] * 4])
    if chosen == "summary" and "summary" in file:
        data = json.loads(file["summary"][()])
        for _ in range(rng.choice([1, 1, 3])):
            data = trees.changed(data, rng)
        content = json.dumps(data).encode("utf-8", "surrogatepass")
    else:
        content = rng.choice([b"", b"\xff", b"[" * 10**5, b"{" * 10**5, b"null", b"<script>alert(1)</script>",
                              b"x" * 10**6, b'{"a": NaN}', b'{"probes": {"</script><script>": 1}}'])
    if chosen in file:
        del file[chosen]
    file.create_dataset(chosen, data=np.bytes_(content or b"\x00"))


EDITS: list[Callable[[h5py.File, str, random.Random], None]] = [
    _replace, _replace, _fill, _fill, _delete, _link, _kind, _attribute, _attribute, _texts, _texts]
