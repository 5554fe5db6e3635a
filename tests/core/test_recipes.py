"""What the README and docs/algorithms.md tell users to do is done here, as it is written there."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from upath import UPath

from tactile_core.commands import main
from tactile_core.dataset.procedural.models import obj_bytes, procedural_models
from tactile_core.dataset.real import render_real
from tactile_core.settings import MaskSettings, MeshSettings, SplitSettings

REPOSITORY = Path(__file__).resolve().parents[2]
README = (REPOSITORY / "README.md").read_text()
ALGORITHMS = (REPOSITORY / "docs" / "algorithms.md").read_text()
APPROACHES = "tactile_core/exploration/learning/approaches.py"
REFERENCES = "tactile_core/exploration/policies/references.py"
UNET = "tactile_core/reconstruction/unet.py"


def code_after(text: str, title: str, number: int = 0) -> str:
    """The block of Python that follows a title, or the next but `number`."""
    return re.findall(r"```python\n(.*?)```", text.partition(title)[2], re.DOTALL)[number]


def run(code: str, folder: Path) -> str:
    """What a process prints that runs `code` in `folder`, whose packages come before others."""
    kept = {key: value for key, value in os.environ.items() if not key.startswith("TACTILE")}
    kept |= {"PYTHONPATH": f"{folder}:{REPOSITORY}", "TACTILE_PROFILE": "smoke"}
    kept |= {"TACTILE_HOME": str(folder / "home")}
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], cwd=folder, env=kept, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def checkout(tmp_path) -> Path:
    """A copy of the code to add to."""
    shutil.copytree(REPOSITORY / "tactile_core", tmp_path / "tactile_core")
    return tmp_path


def add(checkout: Path, file: str, code: str) -> None:
    assert f"`{file.removeprefix('tactile_core/')}`" in README or f"`{file}`" in README
    path = checkout / file
    path.write_text(f"{path.read_text()}\n\n{code}")


LATER = """
from pathlib import Path
from upath import UPath
from tactile_core.dataset.shapes import load_shapes
from tactile_core.evaluation.rollouts import cast_rollouts
from tactile_core.exploration.learning.approaches import APPROACHES
from tactile_core.exploration.learning.train import train_policy
from tactile_core.exploration.policies.store import load_policies
from tactile_core.parquet import read_table
from tactile_core.reconstruction.trained import load_unet
from tests.core.small_run import QUICK, TRAINED, rollout_settings
import tactile_core
assert Path(tactile_core.__file__).parent.parent == Path.cwd()
artifacts = UPath("home/artifacts")
tables = [read_table(artifacts / f"{name}.parquet") for name in ("rotated_splits", "outlines")]
train, test = (load_shapes(*tables, split) for split in ("train", "test"))
unet, said = load_unet(artifacts / "unet"), []
"""


def test_a_reward_is_trained_and_what_was_trained_and_cast_before_is_kept(checkout, home):
    shutil.copytree(home, checkout / "home")
    add(checkout, APPROACHES, code_after(README, "**A reward**"))
    printed = run(
        LATER
        + """
names = [*TRAINED, "bold"]
places = [artifacts / "policies" / f"{name}-0" for name in names]
for name, place in zip(names, places):
    train_policy(APPROACHES[name], 0, train, unet, QUICK, directory=place,
                 work=Path("work", name), progress=said.append)
policies = load_policies(places, unet.version(), unet.resolution)
before = read_table(artifacts / "rollouts.parquet")
after = cast_rollouts(policies, test, unet, rollout_settings(), before, said.append)
kept = after[after["policy"] != "bold"].reset_index(drop=True)
print(kept.equals(before), len(after) > len(before))
print(*sorted(set(after["policy"])))
print(*said, sep="\\n")
""",
        checkout,
    )
    lines = printed.splitlines()
    assert lines[0] == "True True"
    assert lines[1] == "bold diff even gain oracle random recall sequence"
    kept = [line for line in lines if "kept, as nothing that it depends on has changed" in line]
    assert [line.split()[0] for line in kept] == ["diff", "gain", "sequence"]
    assert any(line.startswith("bold seed 0: 64/") for line in lines)
    assert any("7 of 8 are kept" in line for line in lines)


def test_a_rule_is_evaluated_without_being_named_anywhere_else(checkout, home):
    shutil.copytree(home, checkout / "home")
    add(checkout, REFERENCES, code_after(README, "**A rule**"))
    printed = run(
        LATER
        + """
some = rollout_settings().model_copy(update={"references": None, "count": 2, "ray_limit": 3})
table = cast_rollouts([], test.select([0, 1]), unet, some)
print(*sorted(set(table["policy"])))
""",
        checkout,
    )
    assert printed.split() == ["coverage", "crosswise", "even", "oracle", "random", "uncertainty"]


def test_another_unet_is_trained_and_predicts_as_it_is_written(checkout, home):
    shutil.copytree(home, checkout / "home")
    add(checkout, UNET, code_after(README, "**Another U-Net**"))
    printed = run(
        LATER
        + """
import numpy as np, torch
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.training import train_unet
from tactile_core.settings import UNetSettings
chosen = dict(learning_rate=1e-2, batch_size=8, depth=3, channels=12, epochs=1)
fresh = train_unet(train, train, UNetSettings(**chosen), work=Path("work"))
felt = np.zeros((2, 64, 64), np.int8)
felt[1, 20, 32] = 1
with torch.inference_mode():
    logits = fresh.net()(torch.from_numpy(felt).float()[:, None])
found = Reconstructor(fresh, "float32").predict(felt)
print(sum(w.numel() for w in fresh.weights.values()) > 30_000, "SiLU" in str(fresh.net()))
print(float(np.abs(found - torch.sigmoid(logits)[:, 0].numpy()).max()) < 1e-4)
""",
        checkout,
    )
    assert printed.split() == ["True", "True", "True"]


@pytest.fixture
def here(home, tmp_path, monkeypatch):
    """Runs code in this process, which has all that is heavy, as a script in a folder of its own;
    returns its variables."""
    monkeypatch.setenv("TACTILE_HOME", str(home))
    monkeypatch.setenv("TACTILE_PROFILE", "smoke")
    monkeypatch.delenv("TACTILE_STORE", raising=False)
    monkeypatch.chdir(tmp_path)

    def run(code: str) -> dict[str, Any]:
        variables: dict[str, Any] = {"__name__": "__main__"}
        exec(code, variables)
        return variables

    return run


def test_a_policy_acts_in_the_environment(here, capsys):
    first, second = (code_after(README, "## Use the environment", number) for number in (0, 1))
    here(first.replace("num_envs=256", "num_envs=4") + second)
    assert re.fullmatch(r"Jaccard index \d+\.\d\n", capsys.readouterr().out)


@pytest.mark.parametrize(
    ("title", "file"),
    [
        ("**A policy that is not part", "my_policy.py"),
        ("**An algorithm of Stable-Baselines3**", "my_model.py"),
    ],
)
def test_a_policy_of_one_s_own_is_evaluated(here, title, file):
    code = code_after(README, title).replace("50_000", "32").replace("(32, split", "(2, split")
    Path(file).write_text(code)
    [command] = re.findall(rf"    tactile (evaluate {file}.*)", README)
    done = CliRunner().invoke(main, shlex.split(command))
    assert done.exit_code == 0, done.output
    name = command.split(":")[1].split()[0]
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith(f"{name} ")]
    assert len(rows) == 3
    if file == "my_policy.py":  # the other is hardly trained here
        assert float(rows[0][-1]) > 9, "of ten rays so many hit"


def test_a_folder_with_one_mesh_is_a_class_to_test_on(tmp_path):
    [(_, _, build)] = procedural_models(MeshSettings(procedural_models={"mug": 1, "bottle": 0}))
    (tmp_path / "vases").mkdir()
    (tmp_path / "vases" / "ming.obj").write_bytes(obj_bytes(build()))
    samples, aside = render_real(
        MeshSettings(location=str(tmp_path / "vases")),
        MaskSettings(resolution=48, renderer="rasteriser"),
        SplitSettings(rotations=2, renderer="rasteriser"),
        UPath(tmp_path / "meshes"),
        tmp_path / "cache",
    )
    assert set(samples["category"]) == {"vases"} and set(samples["model_id"]) == {"ming"}
    assert len(samples) == 2 and aside.empty


def test_stable_baselines_trains_on_it(here):
    code = code_after(ALGORITHMS, "## Stable-Baselines3").replace("env(32", "env(4")
    assert here(shortened(code, 64))["model"].num_timesteps == 64


def test_masked_ppo_of_sb3_contrib_trains_on_it(here):
    done = here(shortened(code_after(ALGORITHMS, "## sb3-contrib"), 64))
    assert done["model"].num_timesteps == 64
    done["env"].reset(seed=0)
    assert done["worth_a_try"](done["env"]).sum() == 36 + 7


def test_qr_dqn_of_sb3_contrib_trains_on_it_and_its_function_acts(here):
    done = here(shortened(code_after(ALGORITHMS, "## sb3-contrib", 1), 40))
    assert done["model"].num_timesteps == 40
    action = done["choose"](*done["env"].reset(seed=1))
    assert done["env"].unwrapped.action_space.contains(np.array(action))


def test_a_loop_of_one_s_own_trains_on_it(here, capsys):
    code = code_after(ALGORITHMS, "## A loop of one's own")
    for written, short in (("UPDATES, RAYS = 500", "UPDATES, RAYS = 2"), ("envs=32", "envs=4")):
        assert written in code
        code = code.replace(written, short)
    here(code)
    assert re.fullmatch(r"0: -?\d+\.\d points an episode\n", capsys.readouterr().out)


def shortened(code: str, steps: int) -> str:
    assert code.count("50_000") == 1
    return code.replace("50_000", str(steps))
