"""Writing files: each appears whole or not at all. Imports nothing heavy."""

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .errors import InputError


def writable_folder(folder: Any) -> Path:
    """The folder, made if it is not there. Raises InputError where nothing can be written into it."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(f"{folder}: cannot write into this folder ({error.strerror}); give another") from None
    return folder


def writable_file(path: Any, *, keep: Sequence[Path] = ()) -> Path:
    """A path at which a file can be written. Raises InputError where it cannot, or where it would replace one of ``keep``."""
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path}: this is a folder; allowed is the name of a file in it")
    if any(path.resolve() == other.resolve() for other in keep):
        raise InputError(f"{path}: this would overwrite what was read or is written as well; allowed is another name")
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist; allowed is one that does")
    writable_folder(path.parent)
    return path


def write(path: Any, content: str | bytes) -> Path:
    """Write a file through a temporary one beside it, so that it is never half there. Raises InputError where that cannot be done."""
    path = Path(path)
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".layerfit.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content.encode() if isinstance(content, str) else content)
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
    return path
