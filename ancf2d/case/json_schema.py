"""The JSON Schema of case files, for editors; made from the same records that read them."""

from __future__ import annotations

from typing import Any

from .binder import Vocabulary
from .definition import ElementDefinition
from .kinds import Book
from .records import define
from .schema import Case

SCHEMA_FILE = "ancf2d.schema.json"


def json_schema(vocabulary: Vocabulary | None = None) -> dict[str, Any]:
    """Return the JSON Schema (draft-07) of case files.

    It speaks of data as this package's loader reads it (YAML 1.2: 1e3 is a number), which is how
    YAML language servers read it too. What depends on several values at once is left to
    ``validate``.
    """
    return _root(Case, "ancf2d case", vocabulary)


def definition_schema(vocabulary: Vocabulary | None = None) -> dict[str, Any]:
    """Return the JSON Schema (draft-07) of element definition files."""
    return _root(ElementDefinition, "ancf2d element definition", vocabulary)


def schema_comment(schema: str = SCHEMA_FILE) -> str:
    """Return the first line of a case that tells editors where its schema is.

    ``schema`` is a path relative to the case, or a URL. A file beside the case works offline, in
    every editor and on every machine that the two are copied to.
    """
    return f"# yaml-language-server: $schema={schema}"


def _root(cls: type, title: str, vocabulary: Vocabulary | None) -> dict[str, Any]:
    book = Book(vocabulary or Vocabulary())
    define(cls, book)
    root = book.definitions.pop(cls.__name__)
    return {"$schema": "http://json-schema.org/draft-07/schema#", "title": title, **root,
            "definitions": book.definitions}
