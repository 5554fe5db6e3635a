"""`tactile evaluate my_policy.py:choose`: a policy of one's own in the tables of the last run."""

import os
import sys
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import click

from tactile_core.errors import TactileError
from tactile_core.keys import CORE
from tactile_core.value_versions import is_installed

ACTIONS = ("alpha and beta", "angle and offset")
CHANNELS = ("free space", "ray number")


@click.command()
@click.argument("own", metavar="FILE:NAME")
@click.option("--actions", type=click.Choice(ACTIONS), default=ACTIONS[0], show_default=True,
              help="How it names rays.")  # fmt: skip
@click.option("--channels", type=click.Choice(CHANNELS), multiple=True,
              help="What it observes besides; may be given twice.")  # fmt: skip
def evaluate(own: str, actions: Any, channels: tuple[Any, ...]) -> None:
    """Evaluate a policy of your own beside those of the last run.

    NAME is a function in FILE that takes an observation and an info and returns an action, or a
    model of Stable-Baselines3. It casts its rays on the run's test samples, and its row is printed
    among the others: with 95 % intervals, and with what it has more than the fixed rules on the
    same samples.
    """
    from upath import UPath

    from tactile_core.evaluation.own import results_beside, stored_run
    from tactile_core.evaluation.tables import text_table
    from tactile_core.exploration.policies.own import own_policy
    from tactile_core.exploration.world.interface import Interface
    from tactile_core.home import find_artifacts
    from tactile_core.profiles import active_profile

    name, choice = loaded(own)
    run = stored_run(UPath(find_artifacts()))
    policy = own_policy(name, choice, Interface(actions, channels), run.test.resolution)
    steps, grasps = results_beside(
        policy, run, active_profile(), lambda said: click.echo(said, err=True)
    )
    for heading, results in (("Per step: Jaccard index after each ray", steps),
                             ("Per grasp: Jaccard index at each touch", grasps)):  # fmt: skip
        click.echo(f"\n{heading}\n\n{text_table(results.rows)}")
    compared = steps.comparison.set_index("policy").loc[[name]].T.reset_index()
    compared[1] = grasps.comparison.set_index("policy").loc[name].to_numpy()
    compared.columns = [f"{name} on the same samples", "per step", "per grasp"]
    click.echo(text_table(compared))
    if steps.note:
        click.echo(steps.note)
    models = len(run.test.models())
    click.echo(
        f"{len(run.test)} test samples of {models} models, on none of which the U-Net was trained; "
        f'what {name} was trained on is yours to know (split="train").'
    )


def loaded(own: str) -> tuple[str, Any]:
    """The name, and what it names in a Python file; errors in the file pass as they are."""
    file, _, name = own.rpartition(":")
    path = Path(file)
    if not file or not name:
        raise TactileError(f"{own!r} names no policy: give FILE:NAME, as my_policy.py:choose")
    if path.suffix != ".py" or not os.path.isfile(file):  # noqa: PTH113 (False for any name)
        raise TactileError(f"{file} is no Python file that is there: give FILE:NAME")
    if is_taken(path.stem):
        raise TactileError(
            f"{file} has the name of a module that others import ({path.stem}): call it otherwise"
        )
    spec = spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[path.stem] = module
    sys.path.insert(0, str(path.resolve().parent))
    spec.loader.exec_module(module)
    if not hasattr(module, name):
        raise TactileError(f"{file} has no {name!r}")
    return name, getattr(module, name)


def is_taken(name: str) -> bool:
    """Whether Python or a package that is installed has a module of this name."""
    name = name.partition(".")[0]
    found = find_spec(name) if name not in sys.modules else sys.modules[name].__spec__
    installed = is_installed(Path((found and found.origin) or ""))
    return name in sys.stdlib_module_names or installed or name == CORE
