"""The files of deploy/ fit together, and every command in them has the options that it is given."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tactile_assets.paths import REPOSITORY

DEPLOY = REPOSITORY / "deploy"
COMPOSE = yaml.safe_load((DEPLOY / "compose.yaml").read_text())
DOCKERFILE = (DEPLOY / "Dockerfile").read_text()

# How many words of a command name it; what follows are options.
DEPTH = {"ray": 2, "dagster": 3, "dagster-daemon": 2, "dagster-webserver": 1}


def commands() -> dict[str, set[str]]:
    """Every command that a service or the image starts, as far as it is one, with its options."""
    found = [
        yaml.safe_load(line.removeprefix("CMD "))
        for line in DOCKERFILE.splitlines()
        if line.startswith("CMD ")
    ]
    for service in COMPOSE["services"].values():
        if "command" in service:
            command = service["command"]
            parts = command[2].split("&&") if command[0] == "sh" else [shlex.join(command)]
            found += [shlex.split(part.strip().removeprefix("exec ")) for part in parts]
        check = service.get("healthcheck", {}).get("test", [])
        found += [check[1:]] if check and check[1] == "dagster" else []
    options: dict[str, set[str]] = {}
    for words in found:
        name = " ".join(words[: DEPTH[words[0]]])
        given = {word.partition("=")[0] for word in words if word.startswith("--")}
        options.setdefault(name, set()).update(given)
    return options


@pytest.mark.parametrize(("command", "options"), sorted(commands().items()))
def test_every_command_has_the_options_that_it_is_given(command, options):
    program, *words = command.split()
    binary = str(Path(sys.executable).parent / program)
    shown = subprocess.run(
        [binary, *words, "--help"], capture_output=True, text=True, timeout=120, check=True
    )
    for option in options:
        assert re.search(rf"(^|\s){re.escape(option)}\b", shown.stdout), option


def test_the_dockerfile_is_as_hadolint_wants_it():
    hadolint = Path(sys.executable).parent / "hadolint"
    if not hadolint.exists():
        pytest.skip("hadolint is not installed")
    done = subprocess.run(
        [str(hadolint), str(DEPLOY / "Dockerfile")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


def test_what_the_image_copies_is_there():
    for line in DOCKERFILE.splitlines():
        if line.startswith("COPY") and "--from" not in line:
            *sources, _ = [word for word in line.split()[1:] if not word.startswith("--")]
            assert all((REPOSITORY / source).exists() for source in sources), line


def test_webserver_and_daemon_find_the_code_where_it_listens():
    [server] = yaml.safe_load((DEPLOY / "workspace.yaml").read_text())["load_from"]
    code = COMPOSE["services"]["code"]
    assert server["grpc_server"]["host"] == code["hostname"] == "code"
    assert f"--port {server['grpc_server']['port']}" in code["command"][2]
    assert server["grpc_server"]["location_name"] in code["command"][2]


def test_the_ui_is_for_this_machine_alone_and_nothing_else_is_open():
    ports = {name: service["ports"] for name, service in COMPOSE["services"].items()
             if "ports" in service}  # fmt: skip
    assert ports == {"webserver": ["127.0.0.1:3000:3000"]}


def test_what_the_users_env_file_sets_reaches_all_that_runs_the_platforms_code():
    services = COMPOSE["services"].values()
    assert all(service["env_file"] == ".env" for service in services if "build" in service)


def test_every_secret_is_the_users_own():
    text = (DEPLOY / "compose.yaml").read_text()
    for name in ("TACTILE_POSTGRES_PASSWORD", "RAY_AUTH_TOKEN"):
        assert f"${{{name}:?}}" in text and f"${{{name}:-" not in text
