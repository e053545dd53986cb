"""Errors in the entries of an axis file: where they are, and which entries would be right."""

import re
import tomllib
from collections.abc import Sequence
from typing import Any

import msgspec
from msgspec.inspect import LiteralType, StructType, Type, UnionType, VarTupleType, type_info

from jaxid.axis.schema import AxisTables

_WHERE = re.compile(r"(.*?)(?: - at `\$\.?(.*)`)?", re.DOTALL)
_UNKNOWN = re.compile(r"Object contains unknown field `(.*)`")
_MISSING = re.compile(r"Object missing required field `(.*)`")
_VALUE = re.compile(r"Invalid (?:enum )?value '(.*)'")
_KIND = re.compile(r"Expected `(.*)`, got `(.*)`")
_LENGTH = re.compile(r"Expected `array` of length (\d+), got (\d+)")
_LINE = re.compile(r"(.*) \(at line (\d+), column \d+\)")
_ENTRY = re.compile(r"(terms|motion\.via)\[(\d+)\](?:\.(.*))?")
_KINDS = {
    "array": "a list",
    "bool": "true or false",
    "float": "a number",
    "int": "a whole number",
    "null": "nothing",
    "object": "a table",
    "str": "text in quotes",
}


def explained(error: msgspec.ValidationError, data: bytes) -> str:
    """Return the message of an error with the place in the file, and what would be right.

    Args:
        error: error from decoding a file as `AxisTables`.
        data: content of the file, which is valid TOML.
    """
    whole = _WHERE.fullmatch(str(error))
    assert whole is not None
    problem, path = whole[1], whole[2] or ""
    raw = tomllib.loads(data.decode())
    place, steps = _place(path, raw), re.findall(r"\w+", path)
    if found := _UNKNOWN.fullmatch(problem):
        return f"{place} has the unknown entry `{found[1]}`; it may have {_names(steps, raw)}."
    if found := _MISSING.fullmatch(problem):
        return f"{place} must have an entry `{found[1]}`; it may have {_names(steps, raw)}."
    if found := _VALUE.fullmatch(problem):
        return f"{place} must be one of {_values(steps, raw)}, but is {found[1]!r}."
    if found := _KIND.fullmatch(problem):
        expected, got = (_in_words(kinds) for kinds in found.groups())
        fraction = found.groups() == ("int", "float")
        return f"{place} must be {expected}, but is {'a fraction' if fraction else got}."
    if found := _LENGTH.fullmatch(problem):
        return f"{place} must be a list of {found[1]} numbers, but has {found[2]}."
    if problem == "Number out of range":
        return f"{place} must be a number that fits into 64 bits."
    return f"{problem}, in {place[0].lower()}{place[1:]}." if path else f"{problem}."


def invalid_line(error: Exception, data: bytes) -> str:
    """Return the message of an error in the syntax of a file, with the line where it is.

    Args:
        error: error from decoding TOML.
        data: content of the file.
    """
    found = _LINE.fullmatch(str(error))
    if found is None:
        return str(error)
    line = data.decode(errors="replace").splitlines()[int(found[2]) - 1].strip()
    twice = ": an entry or a table stands there twice" if "overwrite" in found[1] else ""
    twice = ": a table stands there twice" if "twice" in found[1] else twice
    return f"line {found[2]}, `{line}`, is no valid TOML ({found[1]}){twice}."


def _in_words(kinds: str) -> str:
    return " or ".join(_KINDS.get(kind, kind) for kind in kinds.split(" | "))


def _place(path: str, raw: dict[str, Any]) -> str:
    """Return a path such as terms[2].beta in words: `beta` in entry 3 of [[terms]] (Fc)."""
    found = _ENTRY.fullmatch(path)
    if not found:
        table = isinstance(_value(re.findall(r"\w+", path), raw), dict)
        return "The file" if not path else f"[{path}]" if table else f"`{path}`"
    several, number, rest = found[1], int(found[2]), found[3]
    name = _value([*several.split("."), str(number)], raw).get("name")
    entry = f"entry {number + 1} of [[{several}]]" + (f" ({name})" if name else "")
    return f"`{rest}` in {entry}" if rest else entry[0].upper() + entry[1:]


def _value(steps: Sequence[str], raw: Any) -> Any:
    """Return the value in a file at a path."""
    for step in steps:
        raw = raw[int(step)] if isinstance(raw, list) else raw.get(step)
    return raw


def _type(steps: Sequence[str], raw: Any) -> Type:
    """Return the type of the value in a file at a path."""
    found: Type = type_info(AxisTables)
    for step in steps:
        if isinstance(found, VarTupleType):
            found = found.item_type
        elif isinstance(struct := _chosen(found, raw), StructType):
            found = next(field.type for field in struct.fields if field.name == step)
        raw = _value([step], raw)
    return found


def _chosen(found: Type, raw: Any) -> Type:
    """Return the kind of table that a value is, of those that a type allows."""
    if not isinstance(found, UnionType):
        return found
    tables = [x for x in found.types if isinstance(x, StructType)]
    return next((x for x in tables if x.tag_field and raw.get(x.tag_field) == x.tag), tables[0])


def _names(steps: Sequence[str], raw: Any) -> str:
    """Return the names of the entries that a table may have."""
    table = _chosen(_type(steps, raw), _value(steps, raw))
    assert isinstance(table, StructType)
    tag = (table.tag_field,) if table.tag_field else ()
    return ", ".join((*tag, *(field.name for field in table.fields)))


def _values(steps: Sequence[str], raw: Any) -> str:
    """Return the values that an entry may have, or the kinds of its table."""
    *above, last = steps
    parent = _type(above, raw)
    if isinstance(parent, UnionType):
        tables = [x for x in parent.types if isinstance(x, StructType)]
        if all(x.tag_field == last for x in tables):
            return ", ".join(str(x.tag) for x in tables)
    found = _type(steps, raw)
    assert isinstance(found, LiteralType)
    return ", ".join(map(str, found.values))
