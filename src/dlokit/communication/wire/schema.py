"""Schema fingerprints: the wire form of a type in eight bytes, which both ends of the bus compare."""

import enum
import hashlib
import re
from functools import lru_cache
from typing import Any, get_origin, get_type_hints

import msgspec
from msgspec import inspect

FINGERPRINT_BYTES = 8


@lru_cache(maxsize=512)
def fingerprint(*types: Any) -> bytes:
    """Eight bytes that change with any field, type, tag or union member of the types; not with docs or defaults."""
    text = "\n".join(description(each) for each in types)
    return hashlib.blake2b(text.encode(), digest_size=FINGERPRINT_BYTES).digest()


def description(wanted: Any) -> str:
    """A type's wire form as text, the same in every process."""
    return _described(inspect.type_info(wanted), ())


@lru_cache(maxsize=512)
def is_listing(wanted: Any) -> bool:
    """Whether a value may have any number of items, so that few bytes can need much memory; arrays do not count."""
    return _is_listing(inspect.type_info(wanted), ())


_DTYPE = re.compile(r"numpy\.dtype\[[^\]]*\]")
_LISTINGS = (inspect.CollectionType, inspect.VarTupleType, inspect.DictType, inspect.AnyType)


def _described(node: Any, within: tuple[Any, ...]) -> str:
    match node:
        case inspect.StructType():
            if node.cls in within:
                return f"^{len(within) - within.index(node.cls)}"  # a recursive type: by depth, not by name
            inner = (*within, node.cls)
            dtypes = _dtypes(node.cls)
            fields = (
                f"{field.encode_name}{'' if field.required else '?'}:{_described(field.type, inner)}"
                f"{dtypes.get(field.name, '')}"
                for field in node.fields
            )
            return f"{node.tag_field}={node.tag}{{{','.join(fields)}}}"
        case inspect.EnumType():
            return f"enum{sorted(str(member.value) for member in _members(node.cls))}"
        case inspect.CustomType():
            return str(node.cls)
        case inspect.UnionType():
            return f"({'|'.join(sorted(_described(each, within) for each in node.types))})"
        case msgspec.Struct():
            parts = (_described(getattr(node, name), within) for name in node.__struct_fields__)
            return f"{type(node).__name__}[{','.join(parts)}]"
        case tuple():
            return f"({','.join(_described(each, within) for each in node)})"
        case _:
            return str(node)


def _dtypes(cls: Any) -> dict[str, str]:
    """Dtypes of the arrays among a Struct's fields, which msgspec does not report."""
    hints = get_type_hints(get_origin(cls) or cls)
    return {name: "".join(_DTYPE.findall(str(hint))) for name, hint in hints.items()}


def _members(cls: type[enum.Enum]) -> list[enum.Enum]:
    return list(cls)


def _is_listing(node: Any, within: tuple[Any, ...]) -> bool:
    if isinstance(node, _LISTINGS):
        return True
    if isinstance(node, inspect.StructType):
        if node.cls in within:
            return False
        return any(_is_listing(field.type, (*within, node.cls)) for field in node.fields)
    if isinstance(node, inspect.UnionType):
        return any(_is_listing(each, within) for each in node.types)
    return isinstance(node, inspect.TupleType) and any(_is_listing(each, within) for each in node.item_types)
