"""Training the U-Net (report, section V)."""

import copy
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch import nn
from upath import UPath

from tactile_core.errors import TactileError
from tactile_core.reconstruction import epoch, training
from tactile_core.reconstruction import trained as trained_module
from tactile_core.reconstruction import unet as unet_module
from tactile_core.reconstruction.batches import (
    ORIENTATIONS,
    TouchSource,
    draw_touch_sets,
    felt_outlines,
    outline_source,
)
from tactile_core.reconstruction.epoch import (
    PARTS,
    backward,
    begin_training,
    keep_mean_statistics,
    loss_and_logits,
    sharing_weights,
    train_epoch,
)
from tactile_core.reconstruction.inference import Reconstructor
from tactile_core.reconstruction.known_shapes import KnownShapes, unpack
from tactile_core.reconstruction.trained import load_unet, save_unet
from tactile_core.reconstruction.training import evaluate, stopped_early, train_unet
from tactile_core.settings import UNetSettings

QUICK = UNetSettings(learning_rate=1e-2, batch_size=6, depth=2, channels=4, epochs=4)


class PowerCutError(Exception):
    """Ends a training from outside."""


def cut_after(message: str):
    """A progress callback during which the power fails."""

    def progress(said: str) -> None:
        if message in said:
            raise PowerCutError

    return progress


@pytest.fixture
def train(small_shapes, tmp_path):
    """Trains on the small shapes in `tmp_path`, unless told otherwise."""

    def run(settings=QUICK, work=tmp_path, shapes=small_shapes, **options):
        return train_unet(shapes["train"], shapes["eval"], settings, work=work, **options)

    return run


def test_training_lowers_the_loss_on_shapes_never_seen(unet):
    curve = unet.curve
    assert curve["epoch"].tolist() == list(range(1, 41))
    assert curve["train_loss"].iloc[-1] < 0.5 * curve["train_loss"].iloc[0]
    assert curve["eval_loss"].min() < 0.5 * curve["eval_loss"].iloc[0]
    assert curve["eval_jaccard"].max() > 50


def test_the_weights_kept_are_those_of_the_lowest_eval_loss(unet, shapes):
    best = unet.curve.loc[unet.curve["eval_loss"].idxmin()]
    touch_sets = draw_touch_sets(shapes["eval"], np.random.default_rng(unet.settings["seed"]))
    masks = shapes["eval"].masks
    loss, jaccard = evaluate(unet.net(), touch_sets, masks, torch.device("cpu"))
    assert unet.scores == best[["epoch", "eval_loss", "eval_jaccard"]].to_dict()
    assert loss == pytest.approx(best["eval_loss"], rel=1e-4)
    assert jaccard.mean() == pytest.approx(best["eval_jaccard"], abs=0.1)


@pytest.mark.parametrize(("epoch", "knows"), [(1, False), (3, False), (4, False), (2, True)])
def test_a_training_killed_after_an_epoch_and_started_again_ends_the_same(
    train, epoch, knows, tmp_path
):
    settings = QUICK.model_copy(update={"known_shapes": knows})
    whole = train(settings, work=tmp_path / "whole")
    with pytest.raises(PowerCutError):
        train(settings, work=tmp_path / "cut", progress=cut_after(f"epoch {epoch}/4"))
    said = []
    resumed = train(settings, work=tmp_path / "cut", progress=said.append)
    assert said[0] == f"U-Net: resuming after epoch {epoch}"
    assert sum("eval loss" in message for message in said[1:]) == 4 - epoch
    assert resumed.version() == whole.version()
    assert resumed.curve.equals(whole.curve)


def test_a_training_killed_while_its_ranges_are_measured_trains_no_epoch_again(train, monkeypatch):
    def cut(*args):
        raise PowerCutError

    with monkeypatch.context() as patch:
        patch.setattr(training, "with_eight_bits", cut)
        with pytest.raises(PowerCutError):
            train()
    said = []
    train(progress=said.append)
    assert said == ["U-Net: resuming after epoch 4"]


def test_a_unet_of_other_layers_is_trained_and_predicts(train, small_shapes, monkeypatch):
    def block(inside: int, outside: int) -> nn.Sequential:
        first, second = (nn.Conv2d(width, outside, 3, padding=1) for width in (inside, outside))
        return nn.Sequential(first, nn.GroupNorm(2, outside), second, nn.SiLU())

    monkeypatch.setattr(unet_module, "_block", block)
    unet = train(QUICK.model_copy(update={"epochs": 1}))
    felt = np.zeros((1, unet.resolution, unet.resolution), np.int8)
    logits = unet.net()(torch.from_numpy(felt).float()[:, None])
    found = Reconstructor(unet, "float32").predict(felt)
    np.testing.assert_allclose(found, torch.sigmoid(logits)[:, 0].detach(), atol=1e-4)


def test_a_checkpoint_of_other_settings_or_shapes_is_not_taken_up(train, small_shapes):
    with pytest.raises(PowerCutError):
        train(progress=cut_after("epoch 2/4"))
    others = {**small_shapes, "train": small_shapes["test"]}
    for changed in ({"settings": QUICK.model_copy(update={"seed": 1})}, {"shapes": others}):
        said = []
        with pytest.raises(PowerCutError):
            train(**changed, progress=lambda m, said=said: (said.append(m), cut_after("1/4")(m)))
        assert "epoch 1/4" in said[0]


@pytest.mark.parametrize(
    "damage", [lambda b: b"", lambda b: b"nonsense", lambda b: b[:-100], lambda b: bytes(len(b))]
)
def test_a_damaged_checkpoint_makes_the_training_start_over(train, tmp_path, damage):
    whole = train(work=tmp_path / "whole")
    with pytest.raises(PowerCutError):
        train(progress=cut_after("epoch 2/4"))
    checkpoint = tmp_path / "checkpoint.pt"
    checkpoint.write_bytes(damage(checkpoint.read_bytes()))
    assert train().version() == whole.version()


def test_a_finished_training_leaves_its_tensorboard_curves_and_no_checkpoint(train, tmp_path):
    trained = train()
    assert not (tmp_path / "checkpoint.pt").exists()
    events = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    logged = [scalar.value for scalar in events.Scalars("eval_jaccard")]
    assert logged == pytest.approx(trained.curve["eval_jaccard"].tolist())


def test_a_unet_that_could_not_be_stored_is_not_trained_again(train, tmp_path):
    """The store was full, or the run killed, after the training and before its asset was stored."""
    trained, said = train(), []
    again = train(progress=said.append)
    assert said == ["U-Net: kept, as nothing that it depends on has changed"]
    assert again.version() == trained.version() and again.curve.equals(trained.curve)
    assert train(previous=trained) is trained
    assert [place.name for place in tmp_path.iterdir()] == ["tensorboard"]


def test_the_seed_decides_the_weights(train, tmp_path):
    torch.manual_seed(3)  # what happened before does not matter
    first = train(work=tmp_path / "first")
    second = train(work=tmp_path / "second")
    other = train(QUICK.model_copy(update={"seed": 1}), work=tmp_path / "other")
    assert first.version() == second.version()
    assert first.version() != other.version()


@pytest.mark.parametrize("field", ["learning_rate", "batch_size", "depth", "channels"])
def test_an_empty_hyperparameter_is_refused(train, field):
    with pytest.raises(TactileError, match=f"lack .*{field}.* materialise unet_search"):
        train(QUICK.model_copy(update={field: None}))


@pytest.mark.parametrize("epochs", [1, 4])
def test_a_loss_that_explodes_is_refused(train, epochs):
    wild = QUICK.model_copy(update={"learning_rate": 1e30, "epochs": epochs, "batch_size": 24})
    with pytest.raises(TactileError, match="no longer finite: choose a lower learning_rate"):
        train(wild)


def test_a_training_that_no_longer_improves_stops(train):
    said = []
    impatient = QUICK.model_copy(update={"epochs": 60, "patience": 2, "learning_rate": 3e-2})
    trained = train(impatient, progress=said.append)
    assert said[-1] == "U-Net: no better eval loss for 2 epochs, stopping"
    assert len(trained.curve) == trained.scores["epoch"] + 2


@given(losses=st.lists(st.sampled_from([1.0, 2.0, 3.0]), max_size=8), patience=st.integers(1, 4))
def test_patience_counts_the_epochs_since_the_lowest_loss(losses, patience):
    curve = [{"eval_loss": loss} for loss in losses]
    since = len(losses) - 1 - losses.index(min(losses)) if losses else 0
    assert stopped_early(curve, patience) == (bool(losses) and since >= patience)


def test_touches_can_be_drawn_some_other_way(train, small_shapes, tmp_path):
    asked = []

    def corner(rng, indices):
        asked.extend(indices.tolist())
        felt = np.zeros((len(indices), 48, 48), np.int8)
        felt[:, 8, 8] = 1
        return felt

    one = QUICK.model_copy(update={"epochs": 1})
    trained = train(one, touches=TouchSource(corner, "corner"))
    assert sorted(asked) == list(range(len(small_shapes["train"])))
    assert trained.version() != train(one, work=tmp_path / "usual").version()


def test_in_training_no_model_is_recalled_for_itself(train, small_shapes, monkeypatch):
    """But for eval shapes, which are of other models, everything is."""
    weigh, trained = KnownShapes.weights, small_shapes["train"]
    own, seen = [], []

    def watched(known, felt, models=None):
        weights = weigh(known, felt, models)
        if models is not None:
            held = torch.from_numpy(models[:, None] == known.models).repeat(1, ORIENTATIONS)
            own.append(weights[held].sum().item())
            seen.extend(models)
        return weights

    monkeypatch.setattr(KnownShapes, "weights", watched)
    unet = train(QUICK.model_copy(update={"known_shapes": True, "epochs": 1}))
    assert sorted(seen) == sorted(trained.model_ids)
    assert own == [0] * 4
    np.testing.assert_array_equal(unpack(unet.known, 48), trained.masks)


def test_known_shapes_tell_a_net_more_than_touches_do(knowing_unet, shapes):
    """Its own train shapes it knows by heart; forgotten, they are as strange to it as others."""
    train = shapes["train"]
    forgotten = train.select(np.flatnonzero(train.categories == "mug"))
    touch_sets = draw_touch_sets(forgotten, np.random.default_rng(0))

    def jaccard(unet):
        return evaluate(unet.net(), touch_sets, forgotten.masks, torch.device("cpu"))[1].mean()

    assert jaccard(knowing_unet) > 5 + jaccard(knowing_unet.forgetting(forgotten.packed))


def test_a_last_batch_of_one_joins_the_one_before(small_shapes):
    """At depth 4 one pixel of a 48-pixel image's window is left: no batch of one goes there."""
    training = begin_training(4, 2, 1e-3, seed=0)
    nine = small_shapes["train"].select(np.arange(9))
    assert np.isfinite(train_epoch(training, nine, batch_size=4))


def test_a_step_in_parts_is_one_by_the_mean_of_the_gradients_of_each_part(small_shapes):
    device = torch.device("cpu")
    some = small_shapes["train"].select(np.arange(17))
    felt = felt_outlines(some)(np.random.default_rng(0), np.arange(17))
    training = begin_training(2, 4, 1e-3, seed=0)
    net = training.net.train()
    alone = [copy.deepcopy(net), copy.deepcopy(net)]
    expected = 0.0
    for one, part in zip(alone, (slice(9), slice(9, 17)), strict=True):
        loss = loss_and_logits(one, felt[part], some.masks[part], device)[0] * len(felt[part]) / 17
        loss.backward()
        expected += loss.item()
    nets = sharing_weights(net, 2)
    with ThreadPoolExecutor(2) as threads:
        found = backward(nets, felt, some.masks, device, None, threads)
    keep_mean_statistics(nets)
    assert found.item() == pytest.approx(expected)
    for mean, one, other in zip(net.parameters(), *(n.parameters() for n in alone), strict=True):
        torch.testing.assert_close(mean.grad, one.grad + other.grad)
    for mean, one, other in zip(net.buffers(), *(n.buffers() for n in alone), strict=True):
        torch.testing.assert_close(mean.float(), (one.float() + other.float()) / 2)
    plain = torch.optim.AdamW(alone[0].parameters(), lr=1e-3, weight_decay=1e-4)
    for weight, other in zip(*(one.parameters() for one in alone), strict=True):
        weight.grad += other.grad
    training.optimizer.step()
    plain.step()
    for weight, expected in zip(net.parameters(), alone[0].parameters(), strict=True):
        torch.testing.assert_close(weight, expected)


def test_a_unet_may_have_weights_that_are_frozen_or_that_nothing_uses(train, monkeypatch):
    class OwnUNet(unet_module.UNet):
        def __init__(self, *sizes):
            super().__init__(*sizes)
            self.unused = nn.Parameter(torch.ones(3))
            self.head.requires_grad_(False)

    monkeypatch.setattr(epoch, "UNet", OwnUNet)
    monkeypatch.setattr(trained_module, "UNet", OwnUNet)
    torch.manual_seed(QUICK.seed)
    begun = OwnUNet(QUICK.depth, QUICK.channels)
    trained = train(QUICK.model_copy(update={"batch_size": 16}))
    torch.testing.assert_close(trained.weights["head.weight"], begun.head.weight.detach())
    torch.testing.assert_close(trained.weights["unused"], torch.ones(3))
    assert not torch.equal(trained.weights["contract.0.0.weight"], begun.contract[0][0].weight)


@pytest.mark.parametrize("batch_size", [5, 17, 24])
@pytest.mark.parametrize("layers", [[], [nn.Dropout2d(0.5)]])
def test_an_epoch_in_parts_trains_the_same_bytes_whatever_thread_is_first(
    small_shapes, batch_size, layers
):
    def trained():
        training = begin_training(2, 4, 1e-3, seed=0)
        training.net.contract[0].extend(layers)
        losses = [
            train_epoch(training, small_shapes["train"], batch_size, parts=PARTS) for _ in range(2)
        ]
        return losses, training.net.state_dict(), training.optimizer.state_dict()["state"]

    first = trained()
    for _ in range(5):
        again = trained()
        assert again[0] == first[0]
        torch.testing.assert_close(again[1:], first[1:], rtol=0, atol=0)


def test_an_epoch_tells_what_share_of_it_is_done(small_shapes):
    training, shares = begin_training(1, 2, 1e-3, seed=0), []
    train_epoch(training, small_shapes["train"], 6, before_batch=shares.append)
    train_epoch(training, small_shapes["train"], 6, samples=12, before_batch=shares.append)
    assert shares == [0, 0.25, 0.5, 0.75, 0, 0.5]


def test_a_finished_training_is_kept_until_something_that_it_depends_on_changes(
    train, small_shapes, tmp_path
):
    one = UNetSettings(**{**QUICK.model_dump(), "epochs": 1})
    trained = train(one)
    assert train(one, previous=trained) is trained
    save_unet(trained, UPath(tmp_path / "unet"))
    stored = load_unet(UPath(tmp_path / "unet"))
    assert train(one, previous=stored) is stored
    seed = one.model_copy(update={"seed": 1})
    fewer = {**small_shapes, "train": small_shapes["train"].select(np.arange(12))}
    touches = outline_source(small_shapes["train"])._replace(key="others")
    for changed in ({"settings": seed}, {"shapes": fewer}, {"touches": touches}):
        again = train(**{"settings": one, **changed}, previous=stored)
        assert again is not stored and again.key != stored.key
