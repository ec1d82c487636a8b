# SPDX-License-Identifier: MIT
"""The documentation: every link leads somewhere, and every public name has an entry."""

import importlib
import inspect
import re

import pytest

from tests.helpers.data_paths import ROOT

PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
_FENCED = re.compile(r"^(```|~~~|:::).*?^\1", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|srcset|href)=\"([^\"]+)\"")


def links_of(page):
    """Relative links of a page, code left out."""
    text = re.sub(r"`[^`\n]*`", "", _FENCED.sub("", page.read_text(encoding="utf-8")))
    targets = [first or second for first, second in _LINK.findall(text)]
    return [target for target in targets if not re.match(r"[a-z]+:", target)]


def anchors_of(page):
    """What a page's headings are called in links."""
    text = _FENCED.sub("", page.read_text(encoding="utf-8"))
    found: list[str] = []
    for heading in re.findall(r"^#+ +(.+?) *$", text, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        slug = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        before = sum(re.fullmatch(rf"{re.escape(slug)}(-\d+)?", one) is not None for one in found)
        found.append(f"{slug}-{before}" if before else slug)
    return found


def leads_somewhere(page, link):
    """Whether there is such a file in the checkout, with such a heading."""
    name, _, anchor = link.partition("#")
    target = (page.parent / name).resolve() if name else page
    if not (target.is_file() and target.is_relative_to(ROOT)):
        return False
    return not anchor or target.suffix != ".md" or anchor in anchors_of(target)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files_and_headings(page):
    assert [link for link in links_of(page) if not leads_somewhere(page, link)] == []


def test_broken_links_are_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text('# A `b`, c\n# Again\n# Again\n[x](y.md#z) ![p](q.png) `[no](code)` <img src="r.png">\n')
    assert links_of(page) == ["y.md#z", "q.png", "r.png"]
    assert anchors_of(page) == ["a-b-c", "again", "again-1"]
    assert leads_somewhere(ROOT / "README.md", "CONVENTIONS.md#words")
    assert not leads_somewhere(ROOT / "README.md", "CONVENTIONS.md#wrods")
    assert not leads_somewhere(ROOT / "README.md", "../README.md")


@pytest.mark.parametrize("package", ["scenes", "texture", "completion", "nbv"])
def test_every_public_name_has_an_entry(package):
    text = (ROOT / "docs" / "api" / f"{package}.md").read_text(encoding="utf-8")
    entries = re.findall(rf"^\.\. auto\w+:: {package}\.(\w+)$", text, re.MULTILINE)
    assert sorted(entries) == sorted(importlib.import_module(package).__all__)


@pytest.mark.parametrize("package", ["scenes", "texture", "completion", "nbv"])
def test_every_public_name_says_what_it_is(package):
    face = importlib.import_module(package)
    for name in face.__all__:
        text = getattr(face, name).__doc__ or ""
        assert text.strip(), name
        assert not text.startswith(f"{name}("), f"{name}: only the signature that dataclasses make"


def docstrings_of(value):
    """The docstrings that the site shows of a public name: its own, and those of its public members."""
    texts = [inspect.getdoc(value) or ""]
    if inspect.isclass(value):
        members = [getattr(value, name) for name in vars(value) if not name.startswith("_")]
        texts += [
            inspect.getdoc(member) or "" for member in members if callable(member) or is_property(member)
        ]
    return texts


def is_property(member):
    """Whether it is a property or slot, whose docstring is shown."""
    return isinstance(member, property) or inspect.isdatadescriptor(member)


def substitutions_of(docstring):
    """Words between bars outside literals, which reStructuredText takes for undefined substitutions."""
    plain = re.sub(r"``.*?``|`[^`\n]*`|>>> .*|::\n\n(?: +.*\n)+", "", docstring)
    return re.findall(r"(?<![\w|])\|(?![\s|])[^|\n]*(?<!\s)\|(?![\w|])", plain)


@pytest.mark.parametrize("package", ["scenes", "texture", "completion", "nbv"])
def test_no_docstring_of_the_site_holds_an_undefined_substitution(package):
    face = importlib.import_module(package)
    texts = [(name, text) for name in face.__all__ for text in docstrings_of(getattr(face, name))]
    assert [(name, marks) for name, text in texts if (marks := substitutions_of(text))] == []


def test_undefined_substitutions_are_found():
    assert substitutions_of("Metres, and |cosine| of incidence.") == ["|cosine|"]
    assert substitutions_of("`|a|, |b| <= 1`, ``|x|``, `int | None`, a | b | c, 'auto|off|FILE'") == []


def test_guides_are_short_and_the_documentation_too():
    words = {page: len(page.read_text("utf-8").split()) for page in ROOT.glob("docs/**/*.md")}
    assert [page.name for page, n in words.items() if page.parent.name == "guides" and n > 1500] == []
    assert sum(n for page, n in words.items() if page.parent.name != "results") <= 48_000
