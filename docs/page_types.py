"""The report page's records as TypeScript: python docs/page_types.py [FILE].

Writes tools/page/records.d.ts, which is not committed: `make check-page` makes it and checks the
page's scripts with it. The types come from legoworld/records; nothing of them is part of a page.
"""

from __future__ import annotations

import inspect
import sys
from pathlib import Path
from typing import Any, Final

import msgspec

from legoworld.records import report_page, report_tables
from legoworld.report.page_file import SECTION_FIELDS

OUTPUT: Final = Path(__file__).parents[1] / "tools" / "page" / "records.d.ts"
#: What a page's scripts get; what these name comes along.
ROOTS: Final = (
    report_page.DetectionPageView,
    report_page.DepthPageView,
    report_page.NormalsPageView,
    report_page.RelationsPageView,
    report_page.LabelMapPageView,
    report_page.DetectionCell,
    report_page.PixelCell,
    report_page.RelationsCell,
    report_page.BenchPageView,
    report_page.BenchCell,
    report_page.CaseLine,
)
_PLAIN: Final = {
    msgspec.inspect.StrType: "string",
    msgspec.inspect.IntType: "number",
    msgspec.inspect.FloatType: "number",
    msgspec.inspect.BoolType: "boolean",
    msgspec.inspect.NoneType: "null",
    msgspec.inspect.AnyType: "any",
}
_HEAD: Final = "// Made by docs/page_types.py from legoworld/records: do not edit.\n\n"
_TAIL: Final = """\
interface PageData {
  sections: PageSection[];
  views: [string, number, string][];
  kinds: string[];
  beside: { folder: string; pictures: boolean; scenes: boolean };
  version: string;
  alone: boolean;
  trajectories: string;
}

/** What selectors find is known by the page's own templates, not by its type. */
interface ParentNode {
  querySelector(selectors: string): any;
  querySelectorAll(selectors: string): NodeListOf<any>;
}

interface Window {
  legoworldView(at: number, view: any): void;
  legoworldScene(at: number, text: string): void;
  legoworldThree(): any;
}
"""


def declarations() -> str:
    """Every record that the scripts see, as interfaces in the order of their names."""
    found: dict[str, str] = {}
    section = msgspec.inspect.type_info(report_tables.PageSection)
    assert isinstance(section, msgspec.inspect.StructType)
    fields = [f for f in section.fields if f.encode_name in SECTION_FIELDS]
    found["PageSection"] = _interface(report_tables.PageSection, fields, found)
    for kind in ROOTS:
        _type(msgspec.inspect.type_info(kind), found)
    return _HEAD + "\n".join(found[name] for name in sorted(found)) + "\n" + _TAIL


def _type(info: Any, found: dict[str, str]) -> str:
    """The TypeScript of a type; interfaces are added to what was found."""
    if type(info) in _PLAIN:
        return _PLAIN[type(info)]
    if isinstance(info, msgspec.inspect.LiteralType):
        return " | ".join(f'"{value}"' for value in sorted(map(str, info.values)))
    if isinstance(info, msgspec.inspect.UnionType):
        return " | ".join(dict.fromkeys(_type(t, found) for t in info.types))
    if isinstance(info, msgspec.inspect.VarTupleType | msgspec.inspect.ListType):
        return f"Array<{_type(info.item_type, found)}>"
    if isinstance(info, msgspec.inspect.TupleType):
        return f"[{', '.join(_type(t, found) for t in info.item_types)}]"
    if isinstance(info, msgspec.inspect.DictType):
        return f"Record<string, {_type(info.value_type, found)}>"
    if isinstance(info, msgspec.inspect.StructType):
        name = info.cls.__name__
        if name not in found:
            found[name] = ""  # a record may name itself
            found[name] = _interface(info.cls, info.fields, found)
        return name
    raise TypeError(f"no TypeScript for {info}")


def _interface(cls: type, fields: Any, found: dict[str, str]) -> str:
    first = (inspect.getdoc(cls) or "").split("\n", 1)[0]
    lines = [f"/** {first} */", f"interface {cls.__name__} {{"]
    for field in fields:
        optional = "" if field.required or field.default is not msgspec.UNSET else "?"
        lines.append(f"  {field.encode_name}{optional}: {_type(field.type, found)};")
    return "\n".join([*lines, "}", ""])


if __name__ == "__main__":
    output = Path(sys.argv[1]) if sys.argv[1:] else OUTPUT
    output.write_text(declarations(), encoding="utf-8")
