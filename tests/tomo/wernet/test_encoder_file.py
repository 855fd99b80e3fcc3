import pytest
import torch

from tomo.wernet import (
    VARIANTS,
    CorrectionEncoder,
    WeightEncoder,
    load_encoder,
    save_encoder,
)


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
    torch.save(content | {"version": 3}, path)
    with pytest.raises(ValueError, match="version: found 3, expected 2"):
        load_encoder(path)
    torch.save(content | {"settings": content["settings"] | {"blocks": 2}}, path)
    with pytest.raises(ValueError, match="does not fit itself") as caught:
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
    rows, inside = torch.rand(9, 13), torch.ones(9, 1)
    assert torch.equal(encoder(rows, inside), again(rows, inside))
    assert again(rows, inside).abs().max() > 0


def test_an_encoder_of_another_kind_is_refused(tmp_path):
    save_encoder(WeightEncoder(blocks=1), tmp_path / "encoder.pt")
    with pytest.raises(
        ValueError, match="kind: found an encoder of weights, expected one of corr"
    ):
        load_encoder(tmp_path / "encoder.pt", CorrectionEncoder)
