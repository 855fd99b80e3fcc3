"""Encoders and the state of a training in files."""

import zipfile

import pytest
import torch

from tomo.wernet import OPTICS, VARIANTS, Encoder, load_encoder, save_encoder
from tomo.wernet.files import load_training, own_copy, save_training


@pytest.fixture
def path(tmp_path):
    return tmp_path / "deep" / "encoder.pt"


@pytest.fixture
def written(path):
    """Return the content of the file of an encoder."""
    save_encoder(Encoder(blocks=1, channels=4), path)
    return torch.load(path, weights_only=True)


def refusal(read, *arguments):
    """Return the single line of a refusal."""
    with pytest.raises(ValueError, match=r"\.pt: ") as caught:
        read(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("inputs", ["relative", "optics"])
def test_an_encoder_comes_back_as_it_was(random_rays, variant, inputs, path):
    shown = OPTICS[7:] if inputs == "optics" else None
    encoder = Encoder(inputs, variant=variant, blocks=2, channels=8, shown=shown, seed=4)
    batch = random_rays([5, 6, 7], inputs).take(torch.arange(3))
    given = batch.features, batch.mask
    encoder(*given)  # moves the running statistics, which belong to the state
    save_encoder(encoder, path)
    assert [p.name for p in path.parent.iterdir()] == ["encoder.pt"]
    again = load_encoder(path)
    assert again.settings == encoder.settings
    assert torch.equal(encoder.eval()(*given), again.eval()(*given))


def test_code_in_a_file_is_not_run(tmp_path):
    ran, path = tmp_path / "ran", tmp_path / "encoder.pt"

    class Mischief:
        def __reduce__(self):
            return ran.touch, ()

    torch.save({"format": "wernet-encoder", "state": Mischief()}, path)
    assert "cannot be read" in refusal(load_encoder, path)
    assert not ran.exists()


MALFORMED = {
    "no settings": lambda c: c.pop("settings"),
    "settings of another type": lambda c: c.update(settings=3),
    "unknown setting": lambda c: c["settings"].update(depth=3),
    "unknown inputs": lambda c: c["settings"].update(inputs="polar"),
    "inputs of another type": lambda c: c["settings"].update(inputs=["optics"]),
    "shown that is not there": lambda c: c["settings"].update(shown=("colour",)),
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
def test_a_malformed_encoder_is_refused_in_one_line(path, written, fault):
    MALFORMED[fault](written)
    torch.save(written, path)
    line = refusal(load_encoder, path)
    assert line.startswith(f"{path}: found an encoder that does not fit its settings: ")


def test_saving_replaces_what_was_there_or_leaves_it(path, written, monkeypatch):
    content = path.read_bytes()

    def fail(_content, temporary):
        temporary.write_bytes(b"half")
        raise OSError("no space left")

    with monkeypatch.context() as patch:
        patch.setattr(torch, "save", fail)
        with pytest.raises(OSError, match="no space left"):
            save_encoder(Encoder(), path)
    assert path.read_bytes() == content
    assert [p.name for p in path.parent.iterdir()] == ["encoder.pt"]
    save_encoder(Encoder(blocks=3), path)
    assert load_encoder(path).blocks == 3


def test_a_copy_is_one_s_own_and_sees_what_is_asked_for(path, written):
    given = Encoder("relative")
    copy = own_copy(given, ("absolute", "relative"))
    assert torch.equal(copy.last.weight, given.last.weight)
    assert copy.last.weight is not given.last.weight
    assert own_copy(path, ("optics",)).settings == written["settings"]
    line = refusal(own_copy, path, ("absolute", "relative"))
    assert line == (
        f"{path}: encoder: found one that sees 'optics' inputs, expected 'absolute' or 'relative'"
        ": it was trained by another method"
    )
    with pytest.raises(ValueError, match=r"^encoder: found one that sees 'relative'"):
        own_copy(given, ("optics",))


def _truncated(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _flipped(path):
    with zipfile.ZipFile(path) as archive:
        numbers = archive.read(max(archive.infolist(), key=lambda one: one.file_size))
    content = bytearray(path.read_bytes())
    content[content.find(numbers) + len(numbers) // 2] ^= 16
    path.write_bytes(content)


def _of_version(number):
    return lambda path: torch.save(torch.load(path, weights_only=True) | {"version": number}, path)


FILES = {
    "truncated": (_truncated, "found a file that cannot be read"),
    "one bit flipped": (_flipped, "found a file that cannot be read"),
    "empty": (lambda path: path.write_bytes(b""), "found a file that cannot be read"),
    "text": (lambda path: path.write_text("none"), "found a file that cannot be read"),
    "a list": (lambda path: torch.save([1, 2], path), "format, version: found None"),
    "an older version": (_of_version(0), ", 0), expected ('wernet-"),
    "of the version before": (_of_version(3), "', 3), expected ('wernet-"),
}


def _training(path):
    save_training(path, "a problem", {"epoch": 2, "voxels": torch.ones(8)})


@pytest.mark.parametrize("fault", FILES)
@pytest.mark.parametrize("kind", ["encoder", "training"])
def test_a_file_of_something_else_is_refused_in_one_line(path, fault, kind):
    save, damage = (
        (lambda p: save_encoder(Encoder(), p)) if kind == "encoder" else _training,
        FILES[fault],
    )
    save(path)
    damage[0](path)
    read = (load_encoder, path) if kind == "encoder" else (load_training, path, "a problem")
    line = refusal(*read)
    assert line.startswith(f"{path}: ")
    assert damage[1] in line


def test_encoders_and_trainings_are_told_apart(path):
    save_encoder(Encoder(), path)
    assert "expected ('wernet-training', 1)" in refusal(load_training, path, "a problem")
    _training(path)
    assert "expected ('wernet-encoder', 4)" in refusal(load_encoder, path)


def test_a_training_comes_back_for_its_own_problem(path):
    assert load_training(path, "a problem") is None
    _training(path)
    found = load_training(path, "a problem")
    assert found["epoch"] == 2
    assert torch.equal(found["voxels"], torch.ones(8))
    line = refusal(load_training, path, "another problem")
    assert "problem: found a training of other images, rays or settings" in line


def test_no_file_or_a_folder_is_named(path):
    with pytest.raises(FileNotFoundError, match=r"encoder\.pt: no such file, expected an encoder"):
        load_encoder(path)
    path.mkdir(parents=True)
    with pytest.raises(ValueError, match=r"encoder\.pt: found a folder, expected an encoder"):
        load_encoder(path)
    with pytest.raises(ValueError, match=r"encoder\.pt: found a folder, expected the state"):
        load_training(path, "a problem")
