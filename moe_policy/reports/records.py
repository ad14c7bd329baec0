"""Typed records: every result in ``results/*.json`` is a frozen dataclass that reads and writes itself.

A record is declared once; its fields, in order, are the keys of the JSON object::

    @dataclass(frozen=True, kw_only=True)
    class LatencyRow(Record):
        name: str
        seconds: dict[str, float]
        ratio: float | None                              # null in the file
        memory: float | None | Absent = ABSENT           # a key that older files lack; it stays out of them
        env_id: str                 # a field whose key has another name
        metrics: Metrics = inline()                      # its keys stand among those of the row

    @dataclass(frozen=True, kw_only=True)
    class Latency(Record):
        rows: tuple[LatencyRow, ...]                     # tuples for lists; nested records
        provenance: Provenance

    report = read(path, Latency)                         # = Latency.from_json(json.loads(path.read_text()))
    write(path, report)                                  # the bytes of the file that was read

Rules:

* Reading is strict: an unknown key, a missing key whose default is not :data:`ABSENT` and a value of another type raise
  a ``ValueError`` with the place in the file. Nothing is converted: an ``int`` in a ``float`` field stays one.
* A record that was read writes its keys in the order of its file; a new one, or one made by ``dataclasses.replace``,
  in the order of its fields.
* A field's type may be any dataclass, a record or not. A class with ``to_json()`` and a class method ``from_json()`` of
  its own, such as one that also writes derived values, is read and written by these.
* ``inline()`` also serves a ``dict[str, T]``: it holds every key that is no field's.
* ``object`` accepts any JSON, :data:`Scalar` any text, number, truth value or null.
* Types are evaluated at run time: import them outside of ``TYPE_CHECKING``.
"""

from __future__ import annotations

import dataclasses
import enum
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, Self, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import cattrs
from cattrs.dispatch import StructureHook as Structure
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, override
from cattrs.strategies import configure_union_passthrough

from ocp_envs.support.provenance import write_json

T = TypeVar("T")
R = TypeVar("R", bound="Record")
Json = dict[str, object]
Scalar = str | bool | int | float | None


class Absent(enum.Enum):
    """The type of :data:`ABSENT`."""

    TOKEN = enum.auto()

    def __bool__(self) -> bool:
        return False


#: The value of a field whose key is not in the file, which is not the same as null.
ABSENT: Final = Absent.TOKEN


def present(value: T | Absent | None) -> T | None:
    """``value``, with ``None`` for :data:`ABSENT`."""
    return None if value is ABSENT else value


def renamed(key: str, default: object = dataclasses.MISSING) -> Any:
    """A field whose JSON key is ``key``; ``default`` is :data:`ABSENT` or nothing."""
    return dataclasses.field(metadata={"key": key}, default=default)


def inline() -> Any:
    """A field, a dataclass or a ``dict[str, T]``, whose keys stand among those of its record."""
    return dataclasses.field(metadata={"inline": True})


class RecordError(ValueError):
    """A file is not the record that was expected."""


class Record:
    """Base of the records; a subclass is a ``dataclass(frozen=True, kw_only=True)``."""

    @classmethod
    def from_json(cls, content: Mapping[str, object]) -> Self:
        """The record that :meth:`to_json` made ``content`` of.

        Raises:
            ValueError: ``content`` has unknown keys, lacks keys, or a value is of another type.
        """
        try:
            return _CONVERTER.structure(content, cls)
        except Exception as error:
            lines = cattrs.transform_error(error, path=cls.__name__, format_exception=lambda found, _: str(found))
            raise ValueError("\n".join(lines)) from error

    def to_json(self) -> Json:
        """The record as JSON, keys in the order of its file or else of its fields."""
        return _CONVERTER.unstructure(self)


def read(path: str | os.PathLike[str], kind: type[R], default: R | None = None) -> R:
    """The record of type ``kind`` in the file ``path``; the ``default``, if any, where there is none.

    Raises:
        RecordError: the file is not such a record; the message says where.
    """
    if default is not None and not Path(path).exists():
        return default
    try:
        return kind.from_json(json.loads(Path(path).read_text(encoding="utf-8")))
    except (ValueError, RecursionError) as error:
        raise RecordError(f"{path} is not a {kind.__name__}: {error}") from error


def write(path: str | os.PathLike[str], record: Record) -> None:
    """Write ``record`` to the file ``path``, in one step.

    Raises:
        TypeError, ValueError: a value that JSON cannot hold (NaN and infinity among them); the old file stays.
    """
    write_json(path, record.to_json())


# -- the converter -----------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class _Shape:
    """The JSON object of a dataclass."""

    kind: type  # the dataclass
    keys: dict[str, str]  # field → JSON key
    optional: frozenset[str]  # keys that a file may lack
    inlined: dict[str, type]  # field → type of the fields whose keys stand among the others

    @classmethod
    def of(cls, kind: type) -> _Shape:
        fields, types = dataclasses.fields(kind), get_type_hints(kind)
        keys = {field.name: field.metadata.get("key", field.name) for field in fields}
        optional = frozenset(keys[field.name] for field in fields if field.default is ABSENT)
        return cls(kind, keys, optional, {f.name: types[f.name] for f in fields if f.metadata.get("inline")})

    @property
    def own(self) -> list[str]:
        """Keys of the fields that are not inlined."""
        return [key for name, key in self.keys.items() if name not in self.inlined]

    def nested(self, content: Json) -> Json:
        """``content`` with the keys of inlined fields in objects of their own."""
        rest = {key: value for key, value in content.items() if key not in self.own}
        inlined = {}
        for name, kind in self.inlined.items():
            claimed = list(rest) if get_origin(kind) is dict else [*_Shape.of(kind).all()]
            inlined[name] = {key: rest.pop(key) for key in claimed if key in rest}
        unknown, missing = list(rest), [key for key in self.own if key not in content and key not in self.optional]
        if unknown or missing:
            raise ValueError(
                f"got {', '.join(f'the unknown key {key!r}' for key in unknown) or 'no unknown key'}"
                f"{''.join(f', no key {key!r}' for key in missing)}; expected the keys {', '.join(self.own)}: "
                f"add a field to {self.kind.__name__}, or write the file again with the script that makes it"
            )
        return {key: value for key, value in content.items() if key in self.own} | inlined

    def all(self) -> list[str]:
        """Keys, those of inlined dataclasses included."""
        return self.own + [key for kind in self.inlined.values() for key in _Shape.of(kind).all()]

    def flat(self, content: Json) -> Json:
        """The inverse of :meth:`nested`, keys in the order of the fields."""
        flat: Json = {}
        for name, key in self.keys.items():
            if key in content:
                flat |= cast(Json, content[key]) if name in self.inlined else {key: content[key]}
        return flat


def _structure(kind: type, converter: cattrs.Converter) -> Structure:
    shape = _Shape.of(kind)
    overrides: dict[str, Any] = {name: override(rename=key) for name, key in shape.keys.items()}
    build: Structure = make_dict_structure_fn(kind, converter, **overrides)

    def structure(content: object, _: object) -> object:
        if not isinstance(content, dict):
            raise ValueError(f"got {content!r}, expected an object with the keys {', '.join(shape.own)}")
        record = build(shape.nested(content), kind)
        if isinstance(record, Record):
            object.__setattr__(record, "_order", tuple(content))
        return record

    return structure


def _unstructure(kind: type, converter: cattrs.Converter) -> Callable[[object], Json]:
    shape = _Shape.of(kind)
    overrides: dict[str, Any] = {
        name: override(rename=key, omit_if_default=key in shape.optional) for name, key in shape.keys.items()
    }
    take: Callable[[object], Json] = make_dict_unstructure_fn(kind, converter, **overrides)

    def unstructure(record: object) -> Json:
        content = shape.flat(take(record))
        order = getattr(record, "_order", ())
        return {key: content[key] for key in order if key in content} | content

    return unstructure


def _reads_itself(kind: object) -> bool:
    return isinstance(kind, type) and hasattr(kind, "from_json") and not issubclass(kind, Record)


def _plain(*kinds: type) -> Structure:
    def structure(value: object, _: object) -> object:
        if type(value) not in kinds:
            raise ValueError(f"got {value!r}, expected {kinds[0].__name__}")
        return value

    return structure


def _without_absent(union: object, converter: cattrs.Converter) -> Structure:
    rest = cast(type, Union.__getitem__(tuple(kind for kind in get_args(union) if kind is not Absent)))
    structure = converter.get_structure_hook(rest)
    return lambda value, _: structure(value, rest)


def _converter() -> cattrs.Converter:
    made = cattrs.Converter(unstruct_collection_overrides={tuple: list})
    configure_union_passthrough(Scalar, made)
    for kinds in ((str,), (bool,), (int,), (float, int)):
        made.register_structure_hook(kinds[0], _plain(*kinds))
    made.register_structure_hook_func(lambda kind: kind is object, lambda value, _: value)
    made.register_structure_hook_factory(lambda kind: Absent in get_args(kind), _without_absent)
    made.register_structure_hook_factory(dataclasses.is_dataclass, _structure)
    made.register_unstructure_hook_factory(dataclasses.is_dataclass, _unstructure)
    made.register_structure_hook_func(_reads_itself, lambda value, kind: kind.from_json(value))
    made.register_unstructure_hook_func(_reads_itself, lambda value: value.to_json())
    return made


_CONVERTER = _converter()
