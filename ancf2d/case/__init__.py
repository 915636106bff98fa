"""Reads the text of a case file into a validated case."""

from .binder import Vocabulary
from .definition import DefinitionNode, ElementDefinition, load_definition, read_definition
from .load import CaseText, LoadedCase, load_case, load_case_text, refined, with_overrides
from .nodes import Source
from .reference import (
    SCHEMA_FILE,
    TEMPLATES,
    definition_schema,
    json_schema,
    markdown_reference,
    template,
)
from .schema import *  # noqa: F403
from .schema import __all__ as _schema

__all__ = [
    "SCHEMA_FILE", "TEMPLATES", "CaseText", "DefinitionNode", "ElementDefinition", "LoadedCase", "Source",
    "Vocabulary", "definition_schema", "json_schema", "load_case", "load_case_text",
    "load_definition", "markdown_reference", "read_definition",
    "refined", "template", "with_overrides", *_schema,
]
