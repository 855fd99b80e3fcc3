import pytest
import torch

from tomo.wernet import VARIANTS, load_encoder, save_encoder
from tomo.wernet.default import CorrectionEncoder
from tomo.wernet.paper import WeightEncoder


@pytest.mark.parametrize("variant", VARIANTS)
def test_save_and_load_round_trip(variant, tmp_path):
    encoder = WeightEncoder(variant, blocks=2, channels=8, seed=4)
    rays = torch.rand(5, 6, 7), torch.ones(5, 1, 7)
    encoder(*rays)  # moves the running statistics, which belong to the state
    path = tmp_path / "encoder.pt"
    save_encoder(encoder, path)
    assert [p.name for p in tmp_path.iterdir()] == ["encoder.pt"]
    again = load_encoder(path)
    assert (again.variant, again.blocks, again.channels) == (variant, 2, 8)
    assert torch.equal(encoder.eval()(*rays), again.eval()(*rays))


def test_files_that_are_no_encoder_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="nothing"):
        load_encoder(tmp_path / "nothing.pt")
    path = tmp_path / "encoder.pt"
    path.write_bytes(b"not a torch file")
    with pytest.raises(ValueError, match=r"encoder\.pt: found a file that cannot be read"):
        load_encoder(path)
    save_encoder(WeightEncoder(blocks=1), path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="cannot be read"):
        load_encoder(path)
    torch.save([1, 2], path)
    with pytest.raises(ValueError, match="format"):
        load_encoder(path)
    path.write_bytes(whole)
    content = torch.load(path, weights_only=True)
    torch.save(content | {"version": 2}, path)
    with pytest.raises(ValueError, match="version: found 2, expected 3"):
        load_encoder(path)
    torch.save(content | {"settings": content["settings"] | {"blocks": 2}}, path)
    with pytest.raises(ValueError, match="does not fit its settings") as caught:
        load_encoder(path)
    assert "\n" not in str(caught.value)


def test_a_pickle_in_the_file_is_not_run(tmp_path):
    ran = tmp_path / "ran"

    class Mischief:
        def __reduce__(self):
            return ran.touch, ()

    torch.save({"format": "wernet-encoder", "state": Mischief()}, tmp_path / "encoder.pt")
    with pytest.raises(ValueError, match="cannot be read"):
        load_encoder(tmp_path / "encoder.pt")
    assert not ran.exists()


def test_a_correction_encoder_comes_back_as_it_was(tmp_path):
    encoder = CorrectionEncoder(blocks=1, channels=4, seed=2)
    torch.nn.init.normal_(encoder.last.weight, generator=torch.Generator().manual_seed(0))
    save_encoder(encoder, tmp_path / "encoder.pt")
    again = load_encoder(tmp_path / "encoder.pt", CorrectionEncoder)
    rows, inside = torch.rand(9, 9), torch.ones(9, 1)
    assert torch.equal(encoder(rows, inside), again(rows, inside))
    assert again(rows, inside).abs().max() > 0


def test_an_encoder_of_another_kind_is_refused(tmp_path):
    save_encoder(WeightEncoder(blocks=1), tmp_path / "encoder.pt")
    with pytest.raises(
        ValueError, match="kind: found an encoder of weights, expected one of corr"
    ):
        load_encoder(tmp_path / "encoder.pt", CorrectionEncoder)


MALFORMED = {
    "no kind": lambda c: c.pop("kind"),
    "unknown kind": lambda c: c.update(kind="transformer"),
    "kind of another type": lambda c: c.update(kind=["correction"]),
    "no settings": lambda c: c.pop("settings"),
    "settings of another type": lambda c: c.update(settings=3),
    "unknown setting": lambda c: c["settings"].update(depth=3),
    "setting out of range": lambda c: c["settings"].update(blocks=0),
    "setting of another type": lambda c: c["settings"].update(blocks="two"),
    "far too large": lambda c: c["settings"].update(channels=10**9),
    "no state": lambda c: c.pop("state"),
    "state of another type": lambda c: c.update(state=[1.0]),
    "number missing": lambda c: c["state"].pop("last.bias"),
    "number of another shape": lambda c: c["state"].update({"last.bias": torch.zeros(2)}),
    "key of another type": lambda c: c["state"].update({3: torch.zeros(1)}),
    "NaN": lambda c: c["state"]["last.bias"].fill_(torch.nan),
    "infinite": lambda c: c["state"]["hidden.0.weight"].fill_(torch.inf),
}


@pytest.mark.parametrize("fault", MALFORMED)
def test_a_malformed_encoder_is_refused_in_one_line(tmp_path, fault):
    path = tmp_path / "encoder.pt"
    save_encoder(CorrectionEncoder(blocks=1, channels=4), path)
    content = torch.load(path, weights_only=True)
    MALFORMED[fault](content)
    torch.save(content, path)
    with pytest.raises(ValueError, match=r"encoder\.pt: found an encoder that ") as caught:
        load_encoder(path)
    assert "\n" not in str(caught.value)


def test_saving_replaces_what_was_there_or_leaves_it(tmp_path, monkeypatch):
    path = tmp_path / "deep" / "encoder.pt"
    save_encoder(CorrectionEncoder(blocks=1, channels=4, seed=1), path)
    content = path.read_bytes()

    def fail(_content, temporary):
        temporary.write_bytes(b"half")
        raise OSError("no space left")

    with monkeypatch.context() as patch:
        patch.setattr(torch, "save", fail)
        with pytest.raises(OSError, match="no space left"):
            save_encoder(CorrectionEncoder(), path)
    assert path.read_bytes() == content
    assert [p.name for p in path.parent.iterdir()] == ["encoder.pt"]
    save_encoder(CorrectionEncoder(blocks=3), path)
    assert load_encoder(path).blocks == 3
