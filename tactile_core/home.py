"""The home: the one folder that holds the platform's files on this machine.

`TACTILE_HOME` names it; else it is `.tactile` in the checkout, or the user's data folder where the
package is installed. A home that cannot be used is refused and never replaced by another.

`environment.sh` asks by `python -P -m tactile_core.home`; nothing heavy may be imported here.
"""

import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path

from tactile_core.addresses import checked, holds_secret, shown
from tactile_core.errors import ODD, TactileError

CHECKOUT = Path(__file__).resolve().parents[1]
LAST_PROFILE = "profile"  # file in the home: the name of the last run's profile
# Dagster opens its database by an address: there these begin a query, or stand for another letter.
UNUSABLE = re.compile(rf"\?|%[0-9A-Fa-f]{{2}}|{ODD.pattern}")


def find_home(environ: Mapping[str, str] = os.environ) -> Path:
    """The home as an absolute path; it is made where it is not there yet.

    Raises `TactileError` where it cannot be made or written to.
    """
    given, home = environ.get("TACTILE_HOME"), home_named(environ)
    said = f"TACTILE_HOME={given}" if given else f"the home {home}"
    if letter := UNUSABLE.search(str(home)):
        shown = "".join(sign if sign.isprintable() else "…" for sign in said)
        raise TactileError(
            f"{shown} cannot be used, as Dagster's database cannot lie in a folder with "
            f"{letter[0]!r} in its name: name another"
        )
    try:
        home.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TactileError(
            f"{said} cannot be made ({error.strerror}): mount it or correct it; nothing was written"
        ) from error
    if not os.access(home, os.W_OK | os.X_OK):
        raise TactileError(f"{said} cannot be written to: name another folder, nothing was written")
    return home.resolve()


def home_named(environ: Mapping[str, str] = os.environ) -> Path:
    """The home as an absolute path, whether it is there or not."""
    given = environ.get("TACTILE_HOME")
    return Path(expanded(given)).absolute() if given else default_home()


def remembered_profile(environ: Mapping[str, str] = os.environ) -> str | None:
    """The name of the profile that the last run in this home had; None where there was no run.

    Raises `TactileError` where it cannot be read: all would be made anew with another.
    """
    file = home_named(environ) / LAST_PROFILE
    try:
        return file.read_text().strip() or None
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise TactileError(
            f"{file}, the profile of the last run, cannot be read ({error}): mend or remove it, or "
            "let TACTILE_PROFILE name a profile"
        ) from error


def find_artifacts(environ: Mapping[str, str] = os.environ) -> str:
    """Folder or fsspec URL that holds what the assets store: `TACTILE_STORE`, else in the home.

    Raises `TactileError` where it is no address, holds a password, which every message about a
    file would show, is the home itself, or would be another folder in every working directory.
    """
    store = environ.get("TACTILE_STORE")
    if store and holds_secret(checked(store)):
        scheme = store.partition("://")[0].upper()
        raise TactileError(
            f"TACTILE_STORE={shown(store)} holds a password or signature, which would be stored "
            "and shown with the name of every file: leave it out, and give it in the environment "
            f"as fsspec reads it (FSSPEC_{scheme}_PASSWORD, FSSPEC_S3_SECRET, AWS_… and so on)"
        )
    if not store:
        return f"{find_home(environ)}/artifacts"
    place = expanded(store)
    if "://" not in place:
        if not Path(place).is_absolute():
            raise TactileError(
                f"TACTILE_STORE={store} is another folder wherever a command is called: give its "
                "whole path, or activate the environment again (. .venv/bin/activate)"
            )
        if Path(place).resolve() == home_named(environ).resolve():
            raise TactileError(
                f"TACTILE_STORE={store} is the home itself: name a folder in it, or another"
            )
    return place


def expanded(path: str) -> str:
    """A path whose `~` is a user's own folder; any other, as an address, stays as it is.

    Raises `TactileError` where there is no such user: a folder called so is nobody's wish.
    """
    found = os.path.expanduser(path)  # noqa: PTH111 (pathlib has another error for each system)
    if found.startswith("~"):
        raise TactileError(f"{path} names the folder of a user that is not known here: correct it")
    return found


def default_home() -> Path:
    """`.tactile` in a checkout; the user's data folder for an installed package."""
    if (CHECKOUT / "pyproject.toml").is_file():
        return CHECKOUT / ".tactile"
    import platformdirs

    return Path(platformdirs.user_data_dir("tactile-exploration"))


def check_one_home(home: Path, environ: Mapping[str, str] = os.environ) -> None:
    """Raises `TactileError` where Dagster's records would go to another home than all the rest."""
    dagster_home = environ.get("DAGSTER_HOME")
    if dagster_home and Path(dagster_home).resolve() != home / "dagster":
        raise TactileError(
            f"DAGSTER_HOME={dagster_home} does not lie in the home {home}: activate the "
            "environment again (. .venv/bin/activate), which sets it after TACTILE_HOME"
        )


if __name__ == "__main__":
    try:
        print(find_home())
    except TactileError as error:
        sys.exit(str(error))
