"""The reading of the tables of an axis file; it imports nothing that is slow."""

import codecs
from pathlib import Path

import msgspec

from jaxid.axis.schema import AxisTables
from jaxid.axis.wrong_entry import explained, invalid_line


def read_tables(path: Path) -> tuple[AxisTables, bytes]:
    """Return the tables of an axis file, and its content.

    Args:
        path: axis file in TOML.

    Raises:
        ValueError: if the file is invalid; the message names the file and the entry.
    """
    data = path.read_bytes().removeprefix(codecs.BOM_UTF8)
    try:
        return msgspec.toml.decode(data, type=AxisTables), data
    except msgspec.ValidationError as error:
        raise ValueError(f"File {path}: {explained(error, data)}") from None
    except RecursionError:
        raise ValueError(f"File {path}: its entries are nested too deeply.") from None
    except UnicodeDecodeError:
        raise ValueError(f"File {path} must be text in UTF-8.") from None
    except msgspec.DecodeError as error:
        raise ValueError(f"File {path}: {invalid_line(error, data)}") from None
