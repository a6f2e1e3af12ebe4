"""Files that people write: YAML read strictly, and the first mistake as one line."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Hashable
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from drapeplan.errors import InputError

PLAIN = ("tag:yaml.org,2002:bool", "tag:yaml.org,2002:timestamp")
_BOUNDS = {
    "greater_than": ("greater than", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("less than", "lt"),
    "less_than_equal": ("at most", "le"),
}


class _Loader(yaml.SafeLoader):
    """Refuses keys given twice; `yes` and dates stay text, so no number hides there."""

    yaml_implicit_resolvers = {  # noqa: RUF012  # as PyYAML declares it
        first: [(tag, regexp) for tag, regexp in resolvers if tag not in PLAIN]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_mapping(
        self, node: yaml.MappingNode, deep: bool = False
    ) -> dict[Hashable, Any]:
        """The mapping of a node, whose keys must differ."""
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        for k, key in enumerate(keys):
            if key in keys[:k] and key != "<<":
                raise yaml.constructor.ConstructorError(
                    None,
                    None,
                    f"key {key!r} is given twice",
                    node.value[k][0].start_mark,
                )
        return super().construct_mapping(node, deep=deep)


def read_yaml(path: Path) -> dict[str, Any]:
    """Keys of a YAML file.

    Args:
        path: The file.

    Raises:
        InputError: The file cannot be read, is not YAML, or holds no keys.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "is not a text file"
        raise InputError(str(path), "", f"cannot read it ({reason})") from error
    try:
        data = yaml.load(text, _Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        line = f"line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or "is not YAML"
        raise InputError(str(path), line, str(problem), "mend the YAML") from error
    if not isinstance(data, dict):
        raise InputError(
            str(path), "", "holds no keys", "start from a file in examples/"
        )
    return data


def first_mistake(
    error: ValidationError,
    source: str,
    keys: Collection[str],
    variants: Collection[str],
) -> InputError:
    """The first mistake of many as one line; misspelled keys come first.

    Args:
        error: What pydantic found.
        source: Names the file in the message.
        keys: Known keys, to suggest one for a misspelled key.
        variants: Names of the members of unions, which are no part of a key.
    """
    errors = sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
    first = errors[0]
    location = [str(part) for part in first["loc"]]
    location = [part for part in location if not _is_variant(part, variants)]
    kind, limits = first["type"], first.get("ctx", {})
    problem = first["msg"].removeprefix("Value error, ")
    problem = problem[0].lower() + problem[1:]
    remedy = "drapeplan schema lists what is allowed"
    if kind == "extra_forbidden":
        problem = "unknown key"
        near = difflib.get_close_matches(location[-1], keys, 1)
        remedy = f"did you mean {near[0]}?" if near else "remove it"
        if location[-1] in keys:  # of another place, or another member of the union
            owner = str(first["loc"][-2]) if len(first["loc"]) > 1 else ""
            here = owner if _is_variant(owner, variants) else "this place"
            problem, remedy = f"is not a key of {here}", "remove it"
    elif kind == "missing":
        problem, remedy = "is missing", "add it"
    elif kind == "finite_number":
        problem, remedy = "must be a finite number", "kind: plane is flat"
        if "radius" not in location[-1]:
            remedy = "give a finite number"
    elif kind in _BOUNDS:
        words, key = _BOUNDS[kind]
        problem, remedy = f"must be {words} {limits[key]:g}", "mend the number"
    elif kind == "union_tag_invalid":
        problem = f"unknown {limits['discriminator']} {limits['tag']!r}"
        remedy = f"known: {limits['expected_tags']}"
    elif kind == "union_tag_not_found":
        problem = f"needs a key {limits['discriminator']}"
    if not isinstance(first["input"], dict | list | tuple):
        problem = f"{problem} (found {first['input']!r})"
    if len(errors) > 1:
        remedy += f" ({len(errors) - 1} more to mend)"
    return InputError(source, ".".join(location), problem, remedy)


def _is_variant(part: str, variants: Collection[str]) -> bool:
    """Whether pydantic put the chosen member of a union into an error's place."""
    return part in variants or part.startswith(("tuple[", "literal["))
