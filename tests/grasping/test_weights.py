"""Weights load only when they are whole, known and fitting; every refusal is one clear error."""

import dataclasses
import json
import pickle

import pytest
import torch

from evg_app.errors import WeightsError
from evg_app.grasping import weights
from evg_app.grasping.weights import WeightsCard, load_weights, save_weights, shipped_weights


@pytest.fixture
def saved(tmp_path, networks):
    """Path of an EquiIGD with random weights and its card."""
    net = networks["equiigd"]
    card = WeightsCard("test", "equiigd", net.config.to_dict(), "", 0, training={"scenes": 3}, limits="a test")
    save_weights(tmp_path, net, card)
    return tmp_path / "test.safetensors"


def edit_card(path, **changes):
    """Change keys of the card beside a weights file."""
    card = path.with_suffix(".json")
    card.write_text(json.dumps({**json.loads(card.read_text()), **changes}))


def test_a_saved_network_comes_back_with_its_card(saved, networks):
    net, card = load_weights(saved)
    for key, value in networks["equiigd"].state_dict().items():
        assert torch.equal(net.state_dict()[key], value)
    assert card.parameters == sum(p.numel() for p in net.parameters()) and card.training == {"scenes": 3}
    assert not net.training


def test_missing_weights_name_what_exists(tmp_path):
    with pytest.raises(WeightsError, match="Shipped weights: ") as caught:
        load_weights("no_such_weights")
    assert caught.value.exit_code == 2
    with pytest.raises(WeightsError, match="do not exist"):
        load_weights(tmp_path / "gone.safetensors")


def test_a_shipped_name_is_looked_up_in_the_package(saved, monkeypatch):
    monkeypatch.setattr(weights, "WEIGHTS_DIR", saved.parent)
    assert shipped_weights() == ["test"]
    assert load_weights("test")[1].name == "test"


def test_a_truncated_file_is_corrupt(saved):
    saved.write_bytes(saved.read_bytes()[:-1000])
    with pytest.raises(WeightsError, match="corrupt or truncated"):
        load_weights(saved)


def test_one_flipped_bit_is_corrupt(saved):
    data = bytearray(saved.read_bytes())
    data[len(data) // 2] ^= 1
    saved.write_bytes(bytes(data))
    with pytest.raises(WeightsError, match="corrupt"):
        load_weights(saved)


def test_a_pickle_is_never_opened(tmp_path, saved):
    import hashlib

    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("unpickled",))

    data = pickle.dumps(Bomb())
    saved.write_bytes(data)
    edit_card(saved, sha256=hashlib.sha256(data).hexdigest())
    with pytest.raises(WeightsError, match="not a safetensors file"):
        load_weights(saved)
    with pytest.raises(WeightsError, match=r"not a \.safetensors file"):
        load_weights(tmp_path / "model.pt")


def test_a_missing_or_broken_card_is_refused(saved):
    card = saved.with_suffix(".json")
    for content in ("{", "[]", '{"name": "x"}', '{"surprise": 1}'):
        card.write_text(content)
        with pytest.raises(WeightsError, match="not a card"):
            load_weights(saved)
    card.unlink()
    with pytest.raises(WeightsError, match="card"):
        load_weights(saved)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"architecture": "resnet"}, "unknown network 'resnet'; available: equigiga, equiigd"),
        ({"architecture": "equigiga"}, "describes no equigiga"),
        ({"architecture": "equigiga", "config": {}}, "does not fit the network 'equigiga'"),
        ({"config": {"hiden": 3}}, "hiden"),
        ({"config": {"hidden": 8}}, "does not fit"),
    ],
)
def test_a_card_of_another_network_is_refused(saved, changes, words):
    edit_card(saved, **changes)
    with pytest.raises(WeightsError, match=words):
        load_weights(saved)


def test_weights_that_are_not_finite_are_refused(saved, tmp_path):
    net, card = load_weights(saved)
    with torch.no_grad():
        next(net.parameters()).view(-1)[0] = float("nan")
    save_weights(tmp_path, net, dataclasses.replace(card, name="nan"))
    with pytest.raises(WeightsError, match="not finite"):
        load_weights(tmp_path / "nan.safetensors")


def test_a_folder_that_cannot_be_written_is_refused(tmp_path, networks):
    with pytest.raises(WeightsError, match="choose another folder"):
        save_weights(tmp_path / "gone", networks["equigiga"], WeightsCard("x", "equigiga", {}, "", 0))


@pytest.mark.parametrize("name", shipped_weights())
def test_shipped_weights_are_whole(name):
    _, card = load_weights(name)
    assert card.name == name and card.training and card.metrics and card.limits and card.intended_use
