"""Keys: what was made before is taken for what would be made now only where nothing differs."""

import ast
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import tactile_core
from tactile_core import keys
from tactile_core.keys import closure, code_version, work_key
from tactile_core.settings import UNetSettings

words = st.text("abc", min_size=1, max_size=4)
values = st.integers() | st.floats(allow_nan=False) | st.booleans() | words | st.none()
parts = st.fixed_dictionaries(
    {
        "settings": st.dictionaries(words, values | st.dictionaries(words, values), max_size=4),
        "seed": st.integers(0, 9),
        "inputs": st.dictionaries(words, words, max_size=3),
    }
)


def key_of(part) -> str:
    return work_key(
        "dataset.outlines", settings=part["settings"], seed=part["seed"], **part["inputs"]
    )


@given(one=parts, other=parts)
def test_keys_are_equal_where_all_parts_are_and_nowhere_else(one, other):
    assert (key_of(one) == key_of(other)) == (exact(one) == exact(other))


@given(part=parts, data=st.data())
def test_one_other_part_is_another_key(part, data):
    name = data.draw(st.sampled_from(sorted(part)))
    other = {**part, name: data.draw(parts)[name]}
    assume(exact(other) != exact(part))
    assert key_of(other) != key_of(part)
    assert work_key("dataset.splits", settings=part["settings"]) != key_of(part)


@given(part=parts)
def test_the_order_in_which_parts_are_named_does_not_matter(part):
    assert key_of(turned(part)) == key_of(part)


def turned(value):
    """`value` with every dict in it, however deep, in the other order."""
    if not isinstance(value, dict):
        return value
    return {name: turned(part) for name, part in reversed(value.items())}


def exact(value):
    """Equal only where types are too: 1, 1.0 and True are three settings."""
    if isinstance(value, dict):
        return {name: exact(part) for name, part in value.items()}
    return repr(value)


def test_a_setting_that_is_no_plain_value_is_an_error():
    """Its `repr` may be an address, or leave out what it does."""
    with pytest.raises(TypeError):
        work_key("dataset.splits", settings={"reward": object()})


def test_settings_count_by_name_and_value():
    one, other = UNetSettings(epochs=3), UNetSettings(patience=3)
    made = [work_key("dataset.splits", settings=some) for some in (one, other, one)]
    assert made[0] == made[2] != made[1]


def test_code_of_different_modules_has_different_versions():
    assert code_version("dataset.splits") != code_version("dataset.outlines")
    with pytest.raises(AssertionError, match=r"there is no tactile_core\.nowhere"):
        code_version("nowhere")


def test_imports_are_followed_inside_functions_and_through_packages():
    followed = closure(("exploration.practice.practice",))
    assert "tactile_core.dataset.seeds" in followed
    assert "tactile_core.reconstruction.known_shapes" in followed
    assert "tactile_core.exploration" in followed
    assert not any("figures" in module for module in followed)


def test_the_packages_that_a_module_lies_in_run_before_it_and_count():
    packages = ["tactile_core", "tactile_core.dataset", "tactile_core.dataset.sources"]
    assert [*keys.own_imports("tactile_core.dataset.sources.strangers")] == packages


def test_the_versions_of_the_libraries_that_compute_count(monkeypatch):
    found = dict(keys.libraries(closure(("dataset.outlines",))))
    assert {"numpy", "scipy"} <= set(found)
    assert "torch" not in found
    before = code_version.__wrapped__("dataset.outlines")
    monkeypatch.setattr(keys, "installed_version", lambda library: "another")
    assert code_version.__wrapped__("dataset.outlines") != before


@pytest.fixture
def copied(tmp_path, monkeypatch) -> Iterator[Path]:
    """A copy of the core, whose versions are taken anew each time."""
    folder = shutil.copytree(keys.FOLDER, tmp_path / "tactile_core")
    monkeypatch.setattr(keys, "FOLDER", folder)
    forget()
    yield folder
    monkeypatch.undo()
    forget()


def forget() -> None:
    for function in vars(keys).values():
        if hasattr(function, "cache_clear"):
            function.cache_clear()


def changed_by(file: Path, old: str, new: str) -> set[str]:
    """Of which of these modules the code version is another with `new` for `old` in the file."""
    some = ("dataset.outlines", "reconstruction.training", "exploration.learning.ppo")
    text = file.read_text()
    before = {module: code_version(module) for module in some}
    file.write_text(text.replace(old, new, 1))
    assert file.read_text() != text
    forget()
    after = {module: code_version(module) for module in some}
    file.write_text(text)
    forget()
    return {module for module in some if before[module] != after[module]}


def test_code_counts_wherever_it_is_imported_from(copied):
    outlines, jaccard = copied / "dataset/outlines.py", copied / "reconstruction/jaccard.py"
    assert changed_by(outlines, "def trace", "X = 1\n\n\ndef trace") == {"dataset.outlines"}
    trained = {"reconstruction.training", "exploration.learning.ppo"}
    assert changed_by(jaccard, "THRESHOLD = 0.5", "THRESHOLD = 0.4") == trained
    package = copied / "exploration" / "world" / "__init__.py"
    assert changed_by(package, '"""\n', '"""\nX = 1\n') == {"exploration.learning.ppo"}
    outlines.write_text(f"import tactile_core.reconstruction.jaccard\n{outlines.read_text()}")
    forget()
    assert changed_by(jaccard, "THRESHOLD", "BAR") == {"dataset.outlines", *trained}


def test_words_do_not_count(copied):
    jaccard = copied / "reconstruction" / "jaccard.py"
    assert changed_by(jaccard, "in percent", "from 0 to 100") == set()
    assert changed_by(jaccard, "THRESHOLD = 0.5", "THRESHOLD = 0.5  # one half") == set()


@pytest.mark.parametrize(
    "module", ["settings", "errors", "files", "parquet", "keys", "value_versions"]
)
def test_what_every_module_imports_counts_by_what_it_gives_them(copied, module):
    assert changed_by(copied / f"{module}.py", "\n\n\n", "\nX = 1\n\n\n") == set()


def test_versions_are_equal_in_every_process():
    code = (
        "from tactile_core.keys import code_version, work_key;"
        "print(code_version('exploration.learning.train'), work_key(settings={'a': 1, 'b': 2}))"
    )
    found = {
        subprocess.run(
            [sys.executable, "-c", code], env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True, text=True, check=True,
        ).stdout
        for seed in ("1", "2", "3")
    }  # fmt: skip
    assert len(found) == 1
    version, key = found.pop().split()
    assert (len(version), len(key)) == (12, 16)


def test_a_library_that_is_not_installed_has_no_version():
    assert keys.installed_version("no_such_library") == ""


EDITED = r"""
import sys
from pathlib import Path
from tactile_core.keys import FOLDER, code_version, work_key
from tactile_core.errors import TactileError
code_version("dataset.splits")
splits = FOLDER / "dataset" / "splits.py"
splits.write_text("X = 1\n" + splits.read_text())
try:
    work_key("dataset.splits")
except TactileError as error:
    print(error)
first = work_key("reconstruction.training")
module = FOLDER / "reconstruction" / "jaccard.py"
text = module.read_text()
for new in ("# another comment\n" + text, "X = 1\n" + text, text[:40]):
    module.write_text(new)
    try:
        print(work_key("reconstruction.training") == first)
    except TactileError as error:
        print(error)
    print(len(work_key("dataset.outlines")))
module.unlink()
try:
    work_key("reconstruction.training")
except TactileError as error:
    print(error)
"""


def test_code_that_was_changed_while_a_process_runs_is_refused(tmp_path):
    """It may have read one version of a module, and another one of the next."""
    shutil.copytree(Path(tactile_core.__file__).parent, tmp_path / "tactile_core")
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", EDITED], cwd=tmp_path, env=environment,
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    refused = "tactile_core.reconstruction.jaccard was changed while this process was running"
    splits, comment, _, code, _, cut, _, gone = done.stdout.splitlines()
    assert splits.startswith("tactile_core.dataset.splits was changed")
    assert comment == "True"
    for said in (code, cut, gone):
        assert said.startswith(refused)


# Libraries that carry, store and show, and compute nothing that is stored.
CARRY = {
    "OpenGL", "click", "fastapi", "filelock", "fsspec", "matplotlib", "nicegui", "pandas",
    "platformdirs", "grpc", "psutil", "pyarrow", "pydantic", "pyrender", "requests", "safetensors",
    "starlette", "tensorboard", "upath", "urllib3", "uvicorn",
}  # fmt: skip


def test_every_library_counts_that_computes_something():
    """One that is new goes into `keys.LIBRARIES`, or into `CARRY` above."""
    files = Path(tactile_core.__file__).parent.rglob("*.py")
    trees = [ast.parse(file.read_bytes()) for file in files]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)]
    imported = {name.partition(".")[0] for name in names} - sys.stdlib_module_names
    assert imported - CARRY - {"tactile_core"} - set(keys.LIBRARIES) == set()
    assert all(keys.installed_version(name) for name in keys.LIBRARIES)
