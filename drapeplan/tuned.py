"""Tuned: what a scene says of its own tuning, and whether that is of its path still."""

from __future__ import annotations

from drapeplan.intervals import share_interval
from drapeplan.plan import document_hash
from drapeplan.scene import CountedSection, PathSection, Scene, TunedSection


def path_hash(path: PathSection) -> str:
    """SHA-256 of a path section.

    Args:
        path: The section.
    """
    return document_hash(path.model_dump(mode="json"))


def tuned_lines(scene: Scene) -> list[str]:
    """What tuning gained for a scene's path, in at most one sentence.

    Args:
        scene: The scene; one whose path was changed since says so.
    """
    if not scene.tuned:
        return []
    if scene.tuned.path != path_hash(scene.path):
        return [
            "The path was changed since it was tuned: what was gained is not known."
        ]
    return [gain_sentence(scene.tuned)]


def gain_sentence(tuned: TunedSection) -> str:
    """What tuning gained, for a reader.

    Args:
        tuned: Counts before and after.
    """
    before, after = (_share(one, tuned.samples) for one in (tuned.before, tuned.after))
    return (
        f"Tuned, by {tuned.samples} samples that neither search nor choice has seen, "
        f"intervals of 95 %: before {before}; after {after}."
    )


def _share(one: CountedSection, samples: int) -> str:
    if one.wrong is None:
        return "no plan"
    low, high = share_interval(one.wrong, samples)
    share = f"P(wrong order) {one.wrong / samples:.3f} ({low:.3f} to {high:.3f})"
    return share + ("" if one.good else ", the plan itself not good")
