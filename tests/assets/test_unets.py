"""A U-Net of each seed, from its training to the tables."""

import pytest

from tactile_assets.resources import Store
from tactile_core.errors import TactileError
from tactile_core.parquet import read_table
from tactile_core.reconstruction.unets import load_unets, version_of
from tests.assets.running import run_config, run_for

ASSETS = (
    "unet", "reconstruction_evaluation", "policies", "rollouts", "per_step_evaluation",
)  # fmt: skip
GAIN = {"approaches": ["gain"], "gain_iterations": 2}


def config(*assets: str, further_seeds: list[int], seeds: list[int]) -> dict:
    every = run_config(
        unet={"further_seeds": further_seeds, "epochs": 1}, policies=GAIN | {"seeds": seeds}
    )
    return {"ops": {asset: some for asset, some in every["ops"].items() if asset in assets}}


def test_each_seed_has_a_unet_of_its_own_and_is_evaluated_with_it(copy_of_chain, capfd):
    both = config(*ASSETS, further_seeds=[1], seeds=[0, 1])
    assert copy_of_chain.materialise(*ASSETS, config=both).success
    store = copy_of_chain.store
    unets = load_unets(store.path("unet"))
    assert list(unets) == [0, 1] and len({unet.version() for unet in unets.values()}) == 2
    reconstruction = read_table(store.path("reconstruction_evaluation.parquet"))
    assert set(reconstruction["seed"]) == {0, 1}
    rollouts = read_table(store.path("rollouts.parquet"))
    for policy in ("random", "even", "oracle", "gain", "recall"):
        assert set(rollouts.loc[rollouts["policy"] == policy, "seed"]) == {0, 1}, policy
    capfd.readouterr()
    more = config("unet", further_seeds=[2, 1], seeds=[])
    assert copy_of_chain.materialise("unet", config=more).success
    said = capfd.readouterr().err
    assert said.count("U-Net: kept, as nothing that it depends on has changed") == 2
    assert list(load_unets(store.path("unet"))) == [0, 2, 1]


def test_a_run_killed_in_the_second_training_keeps_the_first(copy_of_chain, monkeypatch, capfd):
    from tactile_core.reconstruction import training

    train, store = training.train_unet, copy_of_chain.store
    before = version_of(load_unets(store.path("unet")))

    def killed_at_seed_1(*arguments, **named):
        if arguments[2].seed == 1:
            raise KeyboardInterrupt
        return train(*arguments, **named)

    both = config("unet", further_seeds=[1], seeds=[])
    monkeypatch.setattr(training, "train_unet", killed_at_seed_1)
    with pytest.raises(BaseException):  # noqa: B017, PT011
        copy_of_chain.materialise("unet", config=both)
    assert version_of(load_unets(store.path("unet"))) == before  # as before it began
    monkeypatch.setattr(training, "train_unet", train)
    capfd.readouterr()
    assert copy_of_chain.materialise("unet", config=both).success
    assert capfd.readouterr().err.count("U-Net: kept, as nothing that it depends on") == 1
    assert list(load_unets(store.path("unet"))) == [0, 1]


def test_a_run_whose_store_was_full_after_the_training_does_not_train_again(
    copy_of_chain, monkeypatch, capfd
):
    def full(*arguments):
        raise TactileError("No space left on device")

    store, other = copy_of_chain.store, run_for(("unet",), unet={"seed": 7})
    before = version_of(load_unets(store.path("unet")))
    with monkeypatch.context() as patch:
        patch.setattr(Store, "picture", full)
        with pytest.raises(TactileError, match="No space left"):
            copy_of_chain.materialise("unet", config=other)
    assert version_of(load_unets(store.path("unet"))) == before
    for _ in range(2):
        capfd.readouterr()
        assert copy_of_chain.materialise("unet", config=other).success
        assert "U-Net: kept, as nothing that it depends on" in capfd.readouterr().err
    assert version_of(load_unets(store.path("unet"))) != before
    assert not list(store.work("unet").rglob("trained"))  # as it is stored


def test_a_seed_that_is_named_twice_is_refused_before_a_run(copy_of_chain):
    with pytest.raises(Exception, match="seed and further_seeds names 0 twice"):
        copy_of_chain.materialise("unet", config=config("unet", further_seeds=[0], seeds=[]))
