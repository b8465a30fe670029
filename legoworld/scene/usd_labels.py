"""The semantic labels of a USD stage, as properties that Blender's importer gives to objects."""

# pxr fills its modules at run time.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from legoworld import extras
from legoworld.conventions import CATEGORY_KEY
from legoworld.errors import SceneInvalidError, UsageError, one_line

#: Taxonomies: of categories, in the order in which they are taken; and of instances.
CLASS: Final = "class"
CATEGORIES: Final[tuple[str, ...]] = (CATEGORY_KEY, CLASS)
INSTANCE: Final = "instance"
#: Namespace of attributes that Blender takes for custom properties, and writes them to.
_PROPERTIES: Final = "userProperties"


def refuse_missing_usd() -> None:
    """UsageError where usd-core is not installed."""
    if find_spec("pxr") is None:
        raise UsageError(
            "USD needs a package",
            found="no usd-core",
            expected="usd-core",
            next_step=extras.install_command("usd"),
        )


@dataclass(frozen=True, kw_only=True)
class LabelLayer:
    """What a layer of labels has: labelled prims; losses: labels left out, as sentences."""

    metres_per_unit: float
    labelled: int
    losses: tuple[str, ...]


def write_label_layer(file: Path, layer: Path) -> LabelLayer:
    """Write a USD layer over a file in which each labelled prim has its label as a property.

    For a child process with limits: the file is untrusted. A prim's category is its label of the
    first taxonomy of CATEGORIES, or of the only one it has. SceneInvalidError for a file that USD
    cannot open.
    """
    from pxr import Sdf, Tf, Usd, UsdGeom, UsdUtils

    try:
        Usd.Stage.Open(str(file))
    except Tf.ErrorException as error:
        raise SceneInvalidError(
            f"USD cannot read {file.name}",
            found=one_line(str(error).rpartition(" : ")[2], 200),
            expected="a .usd, .usda, .usdc or .usdz file",
            next_step="export it again; `usdcat FILE` reads what USD can read",
        ) from error
    own = Sdf.Layer.CreateNew(str(layer))
    # Of units, up axis and default prim only the uppermost layer's count.
    UsdUtils.CopyLayerMetadata(Sdf.Layer.FindOrOpen(str(file)), own, skipSublayers=True)
    own.subLayerPaths = [str(file)]
    stage = Usd.Stage.Open(own)
    labelled, several, unclear = 0, [], []
    for prim in stage.Traverse():
        labels = _labels(prim)
        taxonomy = next((t for t in CATEGORIES if t in labels), None)
        others = [t for t in labels if t != INSTANCE]
        if taxonomy is None and len(others) == 1:
            taxonomy = others[0]
        if taxonomy is None:
            unclear += [str(prim.GetPath())] if others else []
            continue
        labelled += 1
        several += [str(prim.GetPath())] if len(labels[taxonomy]) > 1 else []
        for key, value in ((CATEGORY_KEY, labels[taxonomy]), (INSTANCE, labels.get(INSTANCE))):
            if value:
                attribute = prim.CreateAttribute(f"{_PROPERTIES}:{key}", Sdf.ValueTypeNames.String)
                attribute.Set(value[0])
    own.Save()
    lost = [f"{path} has several labels: the first was taken" for path in several]
    lost += [f"{path} has labels of several taxonomies, none of them class" for path in unclear]
    return LabelLayer(
        metres_per_unit=UsdGeom.GetStageMetersPerUnit(stage), labelled=labelled, losses=tuple(lost)
    )


def _labels(prim: Any) -> dict[str, list[str]]:
    """The labels of a prim by taxonomy: UsdSemantics', and those of the older SemanticsAPI."""
    from pxr import UsdSemantics

    labels: dict[str, list[str]] = {}
    for schema in prim.GetPrimTypeInfo().GetAppliedAPISchemas():
        kind, _, name = schema.partition(":")
        if kind == "SemanticsAPI":
            values = [
                prim.GetAttribute(f"semantic:{name}:params:{what}").Get()
                for what in ("semanticType", "semanticData")
            ]
            if all(values):
                labels.setdefault(str(values[0]), []).append(str(values[1]))
    for taxonomy in UsdSemantics.LabelsAPI.GetDirectTaxonomies(prim):
        labels[taxonomy] = list(UsdSemantics.LabelsAPI(prim, taxonomy).GetLabelsAttr().Get() or ())
    return {taxonomy: names for taxonomy, names in labels.items() if names}
