"""What is written for people reads alike on the docs' site and on GitHub.

The two have other rules for Markdown: in a list the site wants tables and code four spaces deeper,
and it takes what follows a table without an empty line for another row of it.
"""

import re
from collections import Counter
from pathlib import Path

import pytest
from markdown import Markdown
from markdown_it import MarkdownIt
from mkdocs.config import load_config

REPOSITORY = Path(__file__).resolve().parents[1]
PAGES = sorted([*REPOSITORY.glob("*.md"), *REPOSITORY.glob("docs/**/*.md")])
PARTS = re.compile(r"<(h1|h2|h3|ol|ul|li|table|tr|td|pre|code|img|strong|em)\b")


@pytest.fixture(scope="module")
def site():
    """Text → HTML, as `make docs` does it."""
    config = load_config(str(REPOSITORY / "mkdocs.yml"))
    return Markdown(extensions=config.markdown_extensions, extension_configs=config.mdx_configs)


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(REPOSITORY)) for page in PAGES])
def test_a_page_has_the_same_lists_tables_and_code_on_the_site_and_on_github(page, site):
    text = page.read_text()
    on_github = MarkdownIt("commonmark").enable("table").render(text)
    on_site = site.reset().convert(text)
    assert Counter(PARTS.findall(on_site)) == Counter(PARTS.findall(on_github))
