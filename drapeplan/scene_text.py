"""Scene text: a scene file with sections brought up to date, its comments kept."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import yaml

from drapeplan.files import read_text, write_text
from drapeplan.reading import read_yaml
from drapeplan.scene import Scene, scene_from

NAMED = (("mold", "mesh", "path"), ("robot", "urdf"), ("tool", "urdf"))
Edit = tuple[int, int, str]


class _Dumper(yaml.SafeDumper):
    """Writes what comes twice twice."""

    def ignore_aliases(self, data: Any) -> bool:
        """Whether data are written in full: always."""
        return True


def write_scene_like(
    output: Path, scene: Path, sections: dict[str, dict[str, Any]]
) -> bool:
    """Write a scene that differs from another in some sections alone.

    Files that the scene names are written as seen from the output's folder.

    Args:
        output: File to write.
        scene: The scene file that it is like.
        sections: New sections, plain data by key.

    Returns:
        Whether comments and layout of the rest are kept; they are lost where the scene
        is one flow mapping or uses anchors.

    Raises:
        InputError: A file cannot be read or written.
    """
    text = read_text(str(scene), "a scene is a text file")
    data = read_yaml(scene)
    moved = dict(_moved(data, scene.parent, output.parent))
    for keys, name in moved.items():
        _place(data, keys)[keys[-1]] = name
    wanted = scene_from({**data, **sections}, str(output))
    edited = _edited(text, sections, moved)
    kept = edited is not None and _reads_as(edited, wanted)
    plain = {**data, **sections}
    write_text(output, edited if kept and edited is not None else _dumped(plain))
    return kept


def _dumped(data: dict[str, Any]) -> str:
    """Plain data as YAML, what is innermost in one line."""
    return str(
        yaml.dump(
            data,
            Dumper=_Dumper,
            sort_keys=False,
            allow_unicode=True,
            default_flow_style=None,
        )
    )


def _moved(data: dict[str, Any], old: Path, new: Path) -> list[tuple[Any, str]]:
    """Names of files as seen from another folder, by where they stand."""
    found = []
    for keys in NAMED:
        name = (_place(data, keys) or {}).get(keys[-1])
        if name and not os.path.isabs(name) and old.resolve() != new.resolve():
            there = os.path.relpath(old.resolve() / name, new.resolve())
            found.append((keys, Path(there).as_posix()))
    return found


def _place(data: dict[str, Any], keys: tuple[str, ...]) -> Any:
    place: Any = data
    for key in keys[:-1]:
        place = (place or {}).get(key)
    return place


def _edited(
    text: str, sections: dict[str, dict[str, Any]], moved: dict[Any, str]
) -> str | None:
    """The text with edits in place; None where that is not simple."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    named = any(isinstance(token, yaml.AliasToken) for token in yaml.scan(text))
    if not isinstance(root, yaml.MappingNode) or root.flow_style or named:
        return None
    edits: list[Edit] = []
    added = ""
    for key, section in sections.items():
        block = _dumped({key: section})
        pair = _pair(root, (key,))
        if pair:
            edits.append((pair[0].start_mark.index, _end(pair[1]), block.rstrip()))
        else:
            added += block
    for keys, name in moved.items():
        pair = _pair(root, keys)
        if pair:
            edits.append((pair[1].start_mark.index, _end(pair[1]), repr(name)))
    for start, end, new in sorted(edits, reverse=True):
        text = text[:start] + new + text[end:]
    return text + ("" if text.endswith("\n") else "\n") + added


def _pair(node: yaml.Node, keys: tuple[str, ...]) -> tuple[yaml.Node, yaml.Node] | None:
    """Key and value of a mapping, however deep."""
    for key, value in node.value if isinstance(node, yaml.MappingNode) else ():
        if key.value == keys[0]:
            return (key, value) if len(keys) == 1 else _pair(value, keys[1:])
    return None


def _end(node: yaml.Node) -> int:
    """Where a node's own text ends; a block's mark stands at what follows it."""
    block = isinstance(node, yaml.CollectionNode) and not node.flow_style
    if not block or not node.value:
        return int(node.end_mark.index)
    last = node.value[-1]
    return _end(last[1] if isinstance(last, tuple) else last)


def _reads_as(text: str, wanted: Scene) -> bool:
    """Whether a text stands for a scene."""
    try:
        return scene_from(yaml.safe_load(text), "") == wanted
    except Exception:  # whatever it is, the plain form is right
        return False
