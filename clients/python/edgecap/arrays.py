"""Messages as NumPy arrays that share their memory."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from .names import unknown

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def view(message: ctypes.Structure, field: str) -> NDArray[Any]:
    """A field of a message as an array over the message's own memory.

    Raises `UnknownName`; `ImportError` where NumPy is not installed.
    """
    import_numpy()
    records = _records(message, type(message))
    # One of one person, without its first axis; `[0]` would copy a number out of the message.
    return records[_known(type(message), field)].squeeze(axis=0)  # type: ignore[no-any-return]


def view_of_all(people: ctypes.Array[Any], count: int, field: str) -> NDArray[Any]:
    """A field of the first `count` people of a message, one after the other along the first axis.

    Raises as `view`.
    """
    import_numpy()
    element: type[ctypes.Structure] = people._type_
    return _records(people, element)[:count][_known(element, field)]  # type: ignore[no-any-return]


def import_numpy() -> None:
    """Says what to do where NumPy is missing."""
    try:
        import numpy  # noqa: F401, PLC0415
    except ImportError as e:
        raise ImportError(
            "array() needs NumPy: `pip install numpy`, or read the fields themselves, which need nothing"
        ) from e


def _records(memory: Any, element: type[ctypes.Structure]) -> Any:
    import numpy as np  # noqa: PLC0415

    return np.frombuffer(memory, dtype=_dtype(element))


@lru_cache(maxsize=None)
def _dtype(element: type[ctypes.Structure]) -> np.dtype[Any]:
    import numpy as np  # noqa: PLC0415

    return np.dtype(element)


def _known(element: type[ctypes.Structure], field: str) -> str:
    """The name of a field in memory: codes that properties give words for begin with an underscore there."""
    names = tuple(str(f[0]) for f in element._fields_)
    for name in (field, f"_{field}"):
        if name in names:
            return name
    raise unknown("field", field, tuple(n.lstrip("_") for n in names))
