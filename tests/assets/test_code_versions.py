"""Code versions: what changes them, and what does not."""

import shutil

import pytest

from tactile_assets import code_versions
from tactile_assets.code_versions import closure, code_version
from tactile_assets.config import PROFILE
from tactile_assets.definitions import defs

SPECS = {spec.key.to_user_string(): spec for spec in defs.resolve_all_asset_specs()}


@pytest.fixture
def core(tmp_path, monkeypatch):
    """A copy of the core whose files may be changed."""
    folder = shutil.copytree(code_versions.REPOSITORY / "tactile_core", tmp_path / "tactile_core")
    monkeypatch.setattr(code_versions, "REPOSITORY", tmp_path)
    forget()
    yield folder
    forget()


def forget() -> None:
    code_versions.parsed.cache_clear()
    code_versions.code_of.cache_clear()


def versions() -> dict[str, str]:
    forget()
    return {
        name: code_version(*modules)
        for name, modules in {
            "outlines": ["dataset.outlines"],
            "unet": ["reconstruction.training", "exploration.practice.practice"],
            "policies": ["exploration.learning.train"],
            "evaluations": ["evaluation.protocols"],
        }.items()
    }


def changed_by(file, old: str, new: str) -> set[str]:
    before, text = versions(), file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    after = versions()
    file.write_text(text)
    return {name for name in before if before[name] != after[name]}


def test_code_counts_wherever_it_is_imported_from(core):
    rewards = core / "exploration" / "world" / "rewards.py"
    assert changed_by(rewards, "PENALTY = -10.0", "PENALTY = -5.0") == {"policies"}
    threshold = core / "reconstruction" / "jaccard.py"
    assert changed_by(threshold, "THRESHOLD = 0.5", "THRESHOLD = 0.4") == {
        "unet", "policies", "evaluations",
    }  # fmt: skip
    outlines = core / "dataset" / "outlines.py"
    assert changed_by(outlines, "def trace", "X = 1\n\n\ndef trace") == {"outlines"}


def test_words_do_not_count(core):
    jaccard = core / "reconstruction" / "jaccard.py"
    assert changed_by(jaccard, "in percent", "from 0 to 100") == set()
    assert changed_by(jaccard, "THRESHOLD = 0.5", "THRESHOLD = 0.5  # one half") == set()


def test_settings_of_a_stage_count():
    other = PROFILE.unet.model_copy(update={"epochs": PROFILE.unet.epochs + 1})
    modules = "reconstruction.training", "exploration.practice.practice"
    assert code_version(*modules, PROFILE.unet) == SPECS["unet"].code_version
    assert code_version(*modules, other) != code_version(*modules, PROFILE.unet)


def test_imports_are_followed_inside_functions_and_through_packages():
    followed = closure(["tactile_core.exploration.practice.practice"])
    assert "tactile_core.dataset.seeds" in followed
    assert "tactile_core.reconstruction.known_shapes" in followed
    assert not any("figures" in module for module in followed)
