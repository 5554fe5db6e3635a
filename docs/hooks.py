"""What mkdocs does besides: notebooks become pages, and pages hold parts of README and such."""

import re
from pathlib import Path

import jupytext
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

REPOSITORY = Path(__file__).parents[1]
NOTEBOOK = re.compile(r"\]\(\.\./notebooks/(\w+)\.py\)")
PART = re.compile(r"<!-- (README|CONTRIBUTING): (.+) -->")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """A page for each notebook: its text, and its cells as code."""
    for source in sorted((REPOSITORY / "notebooks").glob("*.py")):
        text = jupytext.writes(jupytext.read(source), "md")
        page = text.partition("\n---\n\n")[2]  # without jupytext's own header
        files.append(File.generated(config, f"notebooks/{source.stem}.md", content=page))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The page, where `<!-- README: part -->` stands with that part of the README; links to recipes
    and notebooks, which are right in the repository, lead to their pages."""
    markdown = markdown.replace("](../README.md#", "](extend.md#")
    markdown = NOTEBOOK.sub(r"](notebooks/\1.md)", markdown)
    return PART.sub(lambda found: part_of(REPOSITORY / f"{found[1]}.md", found[2]), markdown)


def part_of(file: Path, name: str) -> str:
    """What stands between `<!-- name -->` and `<!-- end of name -->`, with links from docs/."""
    _, _, rest = file.read_text().partition(f"<!-- {name} -->")
    part, mark, _ = rest.partition(f"<!-- end of {name} -->")
    assert mark, f"{file.name} lacks the part {name!r}"
    return part.strip().replace("](docs/", "](")
