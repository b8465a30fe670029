"""What a readout would find in a trial's scene, so that a score of 0 surprises nobody."""

from __future__ import annotations

from collections import Counter
from typing import Final

from legoworld.errors import LegoWorldError, one_line
from legoworld.pluralize import first_few, plural, share
from legoworld.readouts.family import Protocol
from legoworld.records.agents import SceneContent
from legoworld.running.inspection import label, open_scene
from legoworld.scene.blender_process import BlenderProcess
from legoworld.scene.folder import SceneFolder

_SHOWN: Final = 5


def scene_content(folder: SceneFolder, protocol: Protocol, blender: BlenderProcess) -> SceneContent:
    """What scene.blend of a folder holds for a task; its `problem` where it cannot be read."""
    labelled = protocol.task.family.labelled
    try:
        opened = open_scene(folder, source="blend", blender=blender, cache=None)
        found = label(opened, protocol.vocabulary, protocol.override_property).grouping
    except LegoWorldError as error:
        return SceneContent(labelled=labelled, problem=str(error))
    named = Counter(i.category.name for i in found.instances if i.category is not None)
    return SceneContent(
        labelled=labelled,
        objects=len(found.instances),
        categories=dict(sorted(named.items())),
        outside_vocabulary=dict(sorted(found.outside_vocabulary.items())),
        camera="perspective" if opened.scene.snapshot.camera.type == "PERSP" else "orthographic",
    )


def content_sentence(content: SceneContent) -> str:
    """One line: "2 of 9 objects labelled (1 cup, 1 bottle), outside the vocabulary: mug; ..."."""
    if content.problem is not None:
        return f"not readable: {one_line(content.problem, 200)}"
    objects = plural(content.objects, "object", "objects")
    if content.labelled:
        count = sum(content.categories.values())
        objects = f"{share(count, content.objects, 'object', 'objects')} labelled"
        objects += _list_counts(content.categories)
        if content.outside_vocabulary:
            names = sorted(content.outside_vocabulary)
            listed = first_few([repr(name) for name in names], _SHOWN)
            objects += f"; outside the vocabulary: {listed}"
    return f"{objects}; {content.camera} camera"


def _list_counts(counts: dict[str, int]) -> str:
    if not counts:
        return ""
    most = sorted(counts.items(), key=lambda one: (-one[1], one[0]))
    listed = [f"{count} {name}" for name, count in most[:_SHOWN]]
    more = f", {len(most) - _SHOWN} more kinds" if len(most) > _SHOWN else ""
    return f" ({', '.join(listed)}{more})"
