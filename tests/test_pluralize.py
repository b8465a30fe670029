"""Numbers and the words that go with them."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import legoworld
from legoworld.pluralize import first_few, in_another_folder, plural, share, word_for

PACKAGE = Path(legoworld.__file__).parent
#: A number in an f-string with a plural right behind it: wrong for 1.
PLURAL = re.compile(
    r"^ (more )?(boxes|categories|checks|draws|evaluations|files|images|instances|masks|names|"
    r"orders|photos|pixels|predictions|runs|scenes|shards|truths|views|warnings)\b"
)
#: What is printed when a command went well; messages of errors have their own numbers.
PRINTED = [
    *sorted((PACKAGE / "commands").glob("*.py")),
    PACKAGE / "report" / "tables.py",
    PACKAGE / "report" / "tie_picture.py",
    PACKAGE / "evaluation" / "detection" / "text.py",
]


def plurals(path: Path) -> Iterator[str]:
    """Every number of an f-string that is followed by a plural."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.JoinedStr):
            continue
        for value, after in zip(node.values, node.values[1:], strict=False):
            if (
                isinstance(value, ast.FormattedValue)
                and isinstance(after, ast.Constant)
                and PLURAL.match(str(after.value))
            ):
                yield f"{path.name}, line {node.lineno}: {ast.unparse(value)}{after.value!r}"


@pytest.mark.parametrize("path", PRINTED, ids=lambda p: p.name)
def test_no_plural_follows_a_number_that_may_be_one(path):
    assert list(plurals(path)) == []


def test_numbers_with_their_words():
    assert [plural(n, "box", "boxes") for n in (0, 1, 2, 5000)] == [
        "0 boxes", "1 box", "2 boxes", "5,000 boxes",
    ]  # fmt: skip
    assert share(0, 1, "view", "views") == "0 of 1 view"
    assert share(1, 5000, "view", "views") == "1 of 5,000 views"
    assert [word_for(n, "is", "are") for n in (0, 1, 2)] == ["are", "is", "are"]


def test_the_same_name_in_another_folder():
    known = ["a.jpg", "val2017/b.jpg", "val2017/c.jpg"]
    assert in_another_folder("images/b.jpg", known) == "val2017/b.jpg"
    assert in_another_folder("images\\b.jpg", known) == "val2017/b.jpg"
    assert in_another_folder("b.jpg", known) == "val2017/b.jpg"
    assert in_another_folder("val2017/b.jpg", known) is None
    assert in_another_folder("d.jpg", known) is None


@pytest.mark.parametrize(
    ("names", "text"),
    [([], ""), (["a"], "a"), (["a", "b"], "a, b"), (["a", "b", "c"], "a, b and 1 more")],
)
def test_the_first_few_names_and_how_many_more(names, text):
    assert first_few(names, 2) == text


#: Words that differ by more than an ending.
IRREGULAR = {("is", "are"), ("has", "have"), ("no", "not")}


def is_one_of_many(one: str, many: str) -> bool:
    """Whether two words are a noun's, or a verb's, forms for 1 and for more."""
    endings = (many, f"{many}s", f"{many}es", f"{many[:-1]}ies" if many.endswith("y") else many)
    of_verb = one in endings
    of_noun = many in (f"{one}s", f"{one}es", f"{one[:-1]}ies" if one.endswith("y") else one)
    return of_noun or of_verb or (one, many) in IRREGULAR


def test_the_words_for_one_and_for_more_are_forms_of_each_other() -> None:
    wrong = []
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_bytes())):
            if not isinstance(node, ast.Call) or len(node.args) < 3:
                continue
            forms = [a.value for a in node.args[-2:] if isinstance(a, ast.Constant)]
            if ast.unparse(node.func) in ("plural", "share", "word_for") and len(forms) == 2:
                words = zip(*(str(form).split() for form in forms), strict=True)
                if not all(is_one_of_many(one, many) for one, many in words):
                    wrong.append((path.name, node.lineno, forms))
    assert wrong == []
    assert is_one_of_many("box", "boxes")
    assert is_one_of_many("matches", "match")
    assert not is_one_of_many("XXimage", "images")
    assert not is_one_of_many("image", "XXimages")
