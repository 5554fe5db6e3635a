"""The Dagster layer: the assets, their checks and their automation, over `tactile_core`."""

import sys
import warnings
from types import TracebackType

from tactile_core.errors import TactileError

# Of no use to whoever runs a pinned Dagster; `--select '*'` alone sets one off. Its category is not
# imported: `tactile --help` lists commands of this package, and Dagster takes a second or two.
warnings.filterwarnings("ignore", message=".* is currently in beta")

_others = sys.excepthook


def say_in_one_line(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """What a user got wrong ends any command with the sentence that says so, and no stack."""
    # Of run config that has no such field, or no such choice; it is raised where Dagster is loaded.
    misread = getattr(sys.modules.get("dagster"), "DagsterInvalidConfigError", ())
    if isinstance(error, TactileError):
        print(error, file=sys.stderr)
    elif isinstance(error, misread):
        said = "; ".join(message.splitlines()[0] for message in error.error_messages)
        print(f"Error: {said}", file=sys.stderr)
    else:
        _others(kind, error, trace)


sys.excepthook = say_in_one_line
