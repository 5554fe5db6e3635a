"""`tactile evaluate`: a policy of one's own beside those of a run."""

import shutil
import sys
import textwrap
import traceback

import pytest
from click.testing import CliRunner, Result

from tactile_core.commands import main
from tactile_core.parquet import read_table, write_table

EVEN = """
    import numpy as np
    from tactile_core.exploration.policies.rules import GOLDEN, towards_middle
    from tactile_core.exploration.world.interface import Interface

    def mine(observation, info):
        assert observation.shape == (2, 64, 64)
        angle = 2 * np.pi * GOLDEN * info["exploration"]["rays"]
        return Interface().actions_of(towards_middle(np.array([angle]), 64), 64)[0]
"""
MODEL = """
    import gymnasium
    import numpy as np
    from stable_baselines3 import A2C
    from tactile_core.exploration.world.interface import Interface

    class Spaces(gymnasium.Env):
        observation_space = Interface("angle and offset", ["ray number"]).observation_space(64)
        action_space = Interface("angle and offset").action_space(64)

    model = A2C("CnnPolicy", Spaces(), seed=0)
"""


@pytest.fixture
def evaluate(tmp_path, monkeypatch):
    """Runs the command on a file with some code."""

    def run(code: str, name: str, *options: str, home=None) -> Result:
        monkeypatch.setenv("TACTILE_HOME", str(home))
        monkeypatch.setenv("TACTILE_PROFILE", "smoke")
        monkeypatch.delenv("TACTILE_STORE", raising=False)
        file = tmp_path / "my_policy.py"
        file.write_text(textwrap.dedent(code))
        return CliRunner().invoke(main, ["evaluate", f"{file}:{name}", *options])

    return run


def rows(printed: str, policy: str) -> list[list[str]]:
    """What stands behind a policy's name in each table."""
    return [line.split()[1:] for line in printed.splitlines() if line.startswith(f"{policy} ")]


def test_the_rule_of_the_tables_as_a_function_has_the_rows_of_the_rule(evaluate, home):
    done = evaluate(EVEN, "mine", home=home)
    assert done.exit_code == 0, done.output
    stored = rows(done.stdout, "even")
    assert len(stored) == 2
    assert rows(done.stdout, "mine")[:2] == stored
    [compared] = [line for line in done.stdout.splitlines() if line.startswith("above even, end")]
    assert compared.split()[-2:] == ["+0.0", "+0.0"]
    assert "on none of which the U-Net was trained" in done.stdout
    assert rows(done.stdout, "oracle") and rows(done.stdout, "gain")


def test_a_model_of_stable_baselines_has_a_row_too(evaluate, home):
    options = ("--actions", "angle and offset", "--channels", "ray number")
    done = evaluate(MODEL, "model", *options, home=home)
    assert done.exit_code == 0, done.output
    assert len(rows(done.stdout, "model")) == 3
    plain = evaluate(MODEL, "model", home=home)
    assert plain.exit_code == 1
    assert "give the actions and channels of its environment" in plain.stderr.splitlines()[-1]


def test_an_error_in_the_user_s_code_is_shown_with_its_traceback(evaluate, home):
    code = "def mine(observation, info):\n    return 1 / info['exploration']['rays'].item()\n"
    done = evaluate(code, "mine", home=home)
    assert isinstance(done.exception, ZeroDivisionError)
    shown = "".join(traceback.format_exception(done.exception))
    assert "my_policy.py" in shown and "1 / info['exploration']" in shown


@pytest.mark.parametrize(
    ("code", "name", "said"),
    [
        ("mine = lambda seen, info: 3", "mine", "mine returned 3: an action is two whole numbers"),
        (
            "mine = lambda seen, info: [1, [2, 3]]",
            "mine",
            "mine returned [1, [2, 3]]: an action is",
        ),
        ("even = lambda seen, info: (1, 2)", "even", "the run has a policy called 'even'"),
        ("observer = lambda seen, info: (1, 2)", "observer", "stands for another policy in every"),
        ("x = 1", "mine", "my_policy.py has no 'mine'"),
        ("x = 1", "x", "x is a int: give a function"),
    ],
)
def test_what_cannot_be_evaluated_is_told_in_one_line(evaluate, home, code, name, said):
    done = evaluate(code, name, home=home)
    assert done.exit_code == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("Error: ") and said in last


def test_a_file_that_is_not_there_and_a_home_without_a_run_are_told_in_one_line(evaluate, tmp_path):
    assert "'*rollouts'" in evaluate(EVEN, "mine", home=tmp_path / "empty").stderr.splitlines()[-1]
    for own in ("nothing.py:choose", "my_policy.py", str(tmp_path)):
        done = CliRunner().invoke(main, ["evaluate", own])
        assert done.exit_code == 1 and "give FILE:NAME" in done.stderr


@pytest.mark.parametrize("name", ["random", "random.old", "scipy", "tactile_core"])
def test_a_file_called_as_what_others_import_is_refused(tmp_path, name):
    """In its place, what imports `random` would get the policy."""
    file = tmp_path / f"{name}.py"
    file.write_text("raise AssertionError('it was run')")
    there = sys.modules.get(name)
    done = CliRunner().invoke(main, ["evaluate", f"{file}:mine"])
    assert done.exit_code == 1 and sys.modules.get(name) is there
    assert done.stderr.strip() == (
        f"Error: {file} has the name of a module that others import ({name}): call it otherwise"
    )


def test_a_name_that_no_file_can_have_is_told_in_one_line():
    done = CliRunner().invoke(main, ["evaluate", f"{'a' * 300}.py:mine"])
    assert done.exit_code == 1 and "is no Python file that is there" in done.stderr


def test_rollouts_of_another_unet_are_no_bar(evaluate, home, tmp_path):
    copy = shutil.copytree(home, tmp_path / "copy")
    file = copy / "artifacts" / "rollouts.parquet"
    table = read_table(file)
    write_table(table.assign(jaccard=table["jaccard"] / 2), file)
    done = evaluate(EVEN, "mine", home=copy)
    assert done.exit_code == 1 and "of another U-Net" in done.stderr
