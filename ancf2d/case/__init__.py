"""From the text of a case file to a validated case."""

from .binder import Vocabulary
from .definition import DefinitionNode, ElementDefinition, load_definition
from .load import LoadedCase, load_case, load_case_text
from .schema import *  # noqa: F403
from .schema import __all__ as _schema
from .source import Source

__all__ = [
    "DefinitionNode", "ElementDefinition", "LoadedCase", "Source", "Vocabulary", "load_case",
    "load_case_text", "load_definition", *_schema,
]
