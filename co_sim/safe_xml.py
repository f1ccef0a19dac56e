"""XML that nobody vouches for: no document type, no entities, nothing fetched; faults with their line."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.parsers import expat

from lxml import etree

from co_sim.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from lxml.etree import _Element

__all__ = ["parse", "schema_faults"]

_SCHEMAS: dict[Path, etree.XMLSchema] = {}


class _InsideRootError(Exception):
    """The root element has begun: no document type can follow."""


def parse(data: bytes, what: str) -> _Element:
    """Return the root of a document.

    Parameters
    ----------
    data : the document.
    what : its name in errors, such as ``"plant.fmu: modelDescription.xml"``.

    Raises
    ------
    InputError
        If the document is not well-formed or declares a document type, with which entities come: those of
        files, of the network, and those that grow without end. FMI and SSP have no use for one.
    """
    _refuse_document_type(data, what)
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_blank_text=False)
    try:
        return etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise _broken(what, str(error)) from error


def schema_faults(root: _Element, schema: Path, what: str) -> Iterator[Fault]:
    """Find everything by which a document of `parse` departs from an XML schema.

    Parameters
    ----------
    root : of the document.
    schema : the schema, an ``.xsd`` file.
    what : name of the document in the faults; the line is added to it.
    """
    if schema not in _SCHEMAS:
        _SCHEMAS[schema] = etree.XMLSchema(etree.parse(schema))
    validator = _SCHEMAS[schema]
    if not validator.validate(root):
        for entry in validator.error_log:
            message = " ".join(entry.message.split()).rstrip(".")
            yield Fault(f"{what}, line {entry.line}", message, f"what {schema.name} allows", "correct it")


def _refuse_document_type(data: bytes, what: str) -> None:
    """Read up to the root element, which is as far as a document type can stand."""
    scout = expat.ParserCreate()
    scout.StartDoctypeDeclHandler = _found_document_type
    scout.StartElementHandler = _found_root
    try:
        scout.Parse(data, True)
    except _InsideRootError:
        return
    except _DocumentTypeError as error:
        raise InputError(
            f"{what}, line {scout.CurrentLineNumber}",
            got=str(error),
            expected="XML without a document type, which could name other files or grow without end",
            remedy="remove the declaration or get the file from a source that you trust",
        ) from None
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise _broken(what, str(error)) from error


class _DocumentTypeError(Exception):
    """The document declares a document type."""


def _found_document_type(name: str, *_: object) -> None:
    raise _DocumentTypeError(f"<!DOCTYPE {name}>")


def _found_root(*_: object) -> None:
    raise _InsideRootError


def _broken(what: str, reason: str) -> InputError:
    got = " ".join(reason.split()) or "an empty document"
    return InputError(what, got=got, expected="well-formed XML", remedy="get or export the file again")
