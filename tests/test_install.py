"""`make install` on machines that this one is not: what pip is asked for, and finds, there."""

import os
import shutil
import subprocess
import tomllib
from importlib.metadata import distributions
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

REPOSITORY = Path(__file__).resolve().parents[1]
# Stands for Python: makes an environment whose pip writes down what it was asked for.
PYTHON = """#!/bin/sh
[ "$1 $2" = "-m venv" ] || exit 0
mkdir -p .venv/bin
printf '#!/bin/sh\\necho "$@" >> asked\\n{refuses}\\n' > .venv/bin/pip
printf '#!/bin/sh\\n' > .venv/bin/python
chmod +x .venv/bin/pip .venv/bin/python
touch .venv/bin/activate
"""


def asked(folder: Path, system: str, gpu: bool, refuses: str = "") -> list[str]:
    """The lines that pip was called with, by a copy of the Makefile on such a machine."""
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(REPOSITORY / name, folder)
    commands = {
        "python": PYTHON.replace("{refuses}", refuses),
        "uname": f"#!/bin/sh\necho {system}\n",
    }
    if gpu:
        commands["nvidia-smi"] = "#!/bin/sh\n"
    place = folder / "bin"
    place.mkdir()
    for name, text in commands.items():
        (place / name).write_text(text)
        (place / name).chmod(0o755)
    subprocess.run(
        ["make", "install", f"PYTHON={place / 'python'}"],
        cwd=folder, env=os.environ | {"PATH": f"{place}:{os.environ['PATH']}"}, check=True,
    )  # fmt: skip
    return (folder / "asked").read_text().splitlines()


@pytest.mark.parametrize(
    ("system", "gpu", "cpu_only"),
    [("Linux", False, True), ("Linux", True, False), ("Darwin", False, False)],
)
def test_torch_comes_without_cuda_where_no_nvidia_gpu_is(
    tmp_path: Path, system: str, gpu: bool, cpu_only: bool
) -> None:
    if not gpu and shutil.which("nvidia-smi"):
        pytest.skip("this machine has an NVIDIA GPU")
    lines = asked(tmp_path, system, gpu)
    first = [line for line in lines if "download.pytorch.org/whl/cpu torch" in line]
    assert len(first) == cpu_only
    assert first == lines[: len(first)]  # what comes after finds it there
    assert any(line.endswith("-e .[dev]") for line in lines)


def test_a_machine_that_pytorchs_index_does_not_answer_installs_from_pypi(tmp_path: Path) -> None:
    lines = asked(tmp_path, "Linux", gpu=False, refuses='case "$*" in *pytorch.org*) exit 1; esac')
    assert any(line.endswith("-e .[dev]") for line in lines)


@pytest.mark.parametrize("python", ["3.11.0", "3.12.0", "3.13.0"])
def test_no_pinned_package_refuses_a_python_that_the_project_allows(python: str) -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    assert SpecifierSet(project["requires-python"]).contains(python)
    pins = (REPOSITORY / "constraints.txt").read_text().splitlines()
    pinned = {canonicalize_name(pin.split("==")[0]) for pin in pins if "==" in pin}
    installed = {canonicalize_name(each.name): each for each in distributions()}
    refusing = [
        f"{name} {installed[name].version} asks for Python {asks}"
        for name in sorted(pinned & installed.keys())
        if (asks := installed[name].metadata["Requires-Python"])
        and not SpecifierSet(asks).contains(python)
    ]
    assert not refusing
