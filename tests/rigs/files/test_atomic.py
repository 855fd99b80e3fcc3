import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rigs.files import atomic_path, remove_leftovers, whole_folder

ROOT = Path(__file__).parents[3]


def test_the_file_appears_when_the_block_succeeds(tmp_path):
    target = tmp_path / "deep" / "report.json"
    with atomic_path(target) as temporary:
        temporary.write_text("{}")
        assert not target.exists()
        assert temporary.parent == target.parent
        assert temporary.suffix == ".json"
    assert target.read_text() == "{}"
    assert list(target.parent.iterdir()) == [target]


def test_what_stood_there_stays_when_the_block_fails(tmp_path):
    target = tmp_path / "report.json"
    target.write_text("old")

    def write_half():
        with atomic_path(target) as temporary:
            temporary.write_text("half")
            raise RuntimeError("half way")

    with pytest.raises(RuntimeError, match="half way"):
        write_half()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_durable_file_or_folder_is_on_the_disk_before_it_has_its_name(tmp_path, monkeypatch):
    done, replace = [], os.replace
    monkeypatch.setattr(os, "fsync", lambda handle: done.append(os.fstat(handle).st_ino))
    monkeypatch.setattr(os, "replace", lambda *paths: (done.append("named"), replace(*paths)))
    with atomic_path(tmp_path / "state.pt", durable=True) as temporary:
        temporary.write_text("half done")
        file = temporary.stat().st_ino
    assert done == [file, "named", tmp_path.stat().st_ino]
    done.clear()
    with atomic_path(tmp_path / "out.zarr", durable=True) as temporary:
        (temporary / "time").mkdir(parents=True)
        (temporary / "time" / "zarr.json").write_text("{}")
        inside = [temporary / "time" / "zarr.json", temporary / "time", temporary]
        expected = [one.stat().st_ino for one in inside]
    assert done == [*expected, "named", tmp_path.stat().st_ino]
    done.clear()
    with atomic_path(tmp_path / "page.html") as temporary:
        temporary.write_text("")
    assert done == ["named"]


def test_an_error_of_the_system_names_the_file_not_the_temporary_one(tmp_path):
    target = tmp_path / "volume.npz"

    def full_disk():
        with atomic_path(target):
            raise OSError(errno.ENOSPC, "No space left on device")

    def numpy_on_a_full_disk():
        with atomic_path(target):
            raise OSError("4096 requested and 12 written")

    with pytest.raises(OSError, match="No space left") as caught:
        full_disk()
    assert caught.value.filename == str(target)
    with pytest.raises(OSError, match=r"volume\.npz: cannot be written: 4096"):
        numpy_on_a_full_disk()


def _killed_while_writing(folder, count):
    """Have a process write ``count`` files and a folder at once and be killed in the middle."""
    code = (
        "import os, signal, sys\n"
        "from contextlib import ExitStack\n"
        "from rigs.files import atomic_path, whole_folder\n"
        "with ExitStack() as stack:\n"
        "    for n in range(int(sys.argv[2])):\n"
        "        path = stack.enter_context(atomic_path(f'{sys.argv[1]}/file{n}.npz'))\n"
        "        path.write_text('half')\n"
        "    staging = stack.enter_context(whole_folder(sys.argv[1], last=['report.json']))\n"
        "    (staging / 'report.json').write_text('half')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    done = subprocess.run([sys.executable, "-c", code, folder, str(count)], cwd=ROOT)
    assert done.returncode == -signal.SIGKILL


def test_what_killed_writers_left_is_removed_and_nothing_else(tmp_path):
    keep = [tmp_path / name for name in ("volume.npz", ".volume.npz", ".a.partial-12-3.npz")]
    for path in keep:
        path.write_text("mine")
    _killed_while_writing(tmp_path, 2)
    assert len(list(tmp_path.iterdir())) == len(keep) + 3
    with atomic_path(tmp_path / "running.npz") as temporary:
        temporary.write_text("half")
        assert len(remove_leftovers(tmp_path)) == 3
        assert set(tmp_path.iterdir()) == {*keep, temporary}
    assert all(path.read_text() == "mine" for path in keep)


def test_a_folder_keeps_what_it_has_until_all_is_written(tmp_path):
    def write(text, *names, fail=False):
        with whole_folder(tmp_path, last=["page", "report"], others=["extra"]) as staging:
            for name in names:
                (staging / name).parent.mkdir(parents=True, exist_ok=True)
                (staging / name).write_text(text)
            if fail:
                raise ValueError(f"{staging / 'report'}: found nothing")

    def contents():
        files = sorted(path for path in tmp_path.rglob("*") if path.is_file())
        return {str(path.relative_to(tmp_path)): path.read_text() for path in files}

    write("one", "report", "page", "extra", "images/left")
    with pytest.raises(ValueError, match=f"{tmp_path}/report: found nothing"):
        write("two", "report", "page", fail=True)
    whole = dict.fromkeys(("extra", "images/left", "page", "report"), "one")
    assert contents() == whole
    write("three", "report", "page", "images/left")
    assert contents() == dict.fromkeys(("images/left", "page", "report"), "three")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["images", "page", "report"]


def test_a_folder_without_its_report_is_never_half_of_two_results(tmp_path, monkeypatch):
    """Stopped while files are moved, the folder lacks what says that it is complete."""
    replace = os.replace

    def stop(source, target):
        if Path(target).name == "b":
            raise KeyboardInterrupt
        replace(source, target)

    def write(text):
        with whole_folder(tmp_path, last=["report"]) as staging:
            for name in ("a", "b", "report"):
                (staging / name).write_text(text)

    write("one")
    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", stop)
        with pytest.raises(KeyboardInterrupt):
            write("two")
    assert not (tmp_path / "report").exists()
    write("three")
    assert {path.read_text() for path in tmp_path.iterdir()} == {"three"}


def test_of_two_writers_at_the_same_time_one_is_there_whole(tmp_path):
    code = (
        "import sys\n"
        "from rigs.files import whole_folder\n"
        "for _ in range(100):\n"
        "    with whole_folder(sys.argv[1], last=['report']) as staging:\n"
        "        for name in ('a', 'b', 'c', 'd', 'report'):\n"
        "            (staging / name).write_text(sys.argv[2])\n"
    )
    writers = [
        subprocess.Popen([sys.executable, "-c", code, tmp_path, who], cwd=ROOT) for who in "xy"
    ]
    assert [writer.wait() for writer in writers] == [0, 0]
    assert len({path.read_text() for path in tmp_path.iterdir()}) == 1
    assert len(list(tmp_path.iterdir())) == 5


def test_names_of_many_bytes_have_temporary_ones_too(tmp_path):
    target = tmp_path / ("炎" * 80 + ".npz")  # 244 bytes of the 255 that most systems take
    with atomic_path(target) as temporary:
        temporary.write_text("flame")
    assert target.read_text() == "flame"


def test_leftovers_that_may_not_be_removed_are_nobody_s_error(tmp_path, monkeypatch):
    """In a folder that all may write to they are another user's."""
    _killed_while_writing(tmp_path, 1)

    def refuse(self, missing_ok=False):
        raise PermissionError(errno.EPERM, "Operation not permitted", str(self))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", refuse)
        (removed,) = remove_leftovers(tmp_path)
    assert "files" in removed.name
    assert len(list(tmp_path.iterdir())) == 1

    def hidden(folder):
        raise PermissionError(errno.EACCES, "Permission denied", str(folder))

    with monkeypatch.context() as patch:
        patch.setattr(os, "scandir", hidden)
        assert remove_leftovers(tmp_path) == []


def test_a_folder_inside_may_be_a_link_to_another_disk(tmp_path, monkeypatch):
    replace = os.replace

    def on_two_disks(source, target):
        if "elsewhere" in str(Path(target).parent.resolve()) and "files" in str(source):
            raise OSError(errno.EXDEV, "Invalid cross-device link", str(source), None, str(target))
        replace(source, target)

    monkeypatch.setattr(os, "replace", on_two_disks)
    (tmp_path / "elsewhere").mkdir()
    folder = tmp_path / "scan"
    folder.mkdir()
    (folder / "images").symlink_to(tmp_path / "elsewhere")
    with whole_folder(folder, last=["scan.yaml"]) as staging:
        (staging / "images").mkdir()
        (staging / "images" / "0.tif").write_text("image")
        (staging / "scan.yaml").write_text("scan")
    assert (tmp_path / "elsewhere" / "0.tif").read_text() == "image"
    assert sorted(path.name for path in folder.iterdir()) == ["images", "scan.yaml"]
    assert [path.name for path in (tmp_path / "elsewhere").iterdir()] == ["0.tif"]


@pytest.mark.skipif(not Path("/proc/self/ns/pid").exists(), reason="Linux only")
def test_writers_in_a_container_with_the_machine_s_name_are_left_alone(tmp_path, monkeypatch):
    """Their numbers are not ours: to us, one that runs is a process that there is none of."""
    _killed_while_writing(tmp_path, 1)
    there = sorted(tmp_path.iterdir())
    with monkeypatch.context() as patch:
        patch.setattr(os, "readlink", lambda *_: "pid:[1]")
        assert remove_leftovers(tmp_path) == []
    assert sorted(tmp_path.iterdir()) == there
    assert sorted(remove_leftovers(tmp_path)) == there


def test_a_folder_that_may_be_written_and_not_read(tmp_path, monkeypatch):
    def opened(path, flags, *rest, **more):
        if Path(path) == tmp_path:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return open_before(path, flags, *rest, **more)

    open_before = os.open
    with monkeypatch.context() as patch:
        patch.setattr(os, "open", opened)
        with whole_folder(tmp_path, last=["report"]) as staging:
            (staging / "report").write_text("whole")
    assert (tmp_path / "report").read_text() == "whole"
