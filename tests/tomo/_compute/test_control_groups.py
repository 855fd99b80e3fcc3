"""Limits of containers and batch systems, in hierarchies of folders as Linux shows them."""

import pytest

from tomo._compute import memory

V2 = ("memory.max", "memory.current", "inactive_file")
V1 = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
NONE = {"memory.max": "max", "memory.limit_in_bytes": "9223372036854771712"}
UNLIMITED = object()


def group(folder, version, limit, used=0, inactive=0):
    folder.mkdir(parents=True, exist_ok=True)
    most, current, kept = version
    (folder / most).write_text(f"{NONE[most] if limit is UNLIMITED else limit}\n")
    (folder / current).write_text(f"{used}\n")
    (folder / "memory.stat").write_text(f"anon 100\nactive_file 20\n{kept} {inactive}\n")


def left(tmp_path, *lines):
    own = tmp_path / "own"
    own.write_text("".join(f"{line}\n" for line in lines))
    return memory.left_in_groups(tmp_path / "cgroup", own)


def test_without_groups_there_is_no_limit(tmp_path):
    assert left(tmp_path) is None
    assert memory.left_in_groups(tmp_path / "cgroup", tmp_path / "none") is None


def test_files_that_were_read_are_given_back(tmp_path):
    root = tmp_path / "cgroup"
    group(root, V2, 1000, 300)
    assert left(tmp_path, "0::/") == 700
    group(root, V2, 1000, 300, 180)
    assert left(tmp_path, "0::/") == 880
    group(root, V2, UNLIMITED, 300)
    assert left(tmp_path, "0::/") is None


def test_the_least_limit_of_the_groups_above_counts_as_under_slurm(tmp_path):
    job = tmp_path / "cgroup/system.slice/slurmstepd.scope/job_7"
    group(tmp_path / "cgroup/system.slice", V2, UNLIMITED, 5000)
    group(job, V2, 4000, 1000)
    group(job / "step_0/user", V2, UNLIMITED, 900)
    task = "0::/system.slice/slurmstepd.scope/job_7/step_0/user/task_0"
    assert left(tmp_path, task) == 3000
    group(job / "step_0/user/task_0", V2, 2000, 500, 100)
    assert left(tmp_path, task) == 1600
    group(tmp_path / "cgroup/another.slice", V2, 10, 0)
    assert left(tmp_path, task) == 1600


@pytest.mark.parametrize("mount", ["memory", "cpu,memory"])
def test_version_1(tmp_path, mount):
    lines = ("9:cpuset:/a", f"4:{mount}:/slurm/uid_1/job_7", "1:name=systemd:/")
    root = tmp_path / "cgroup" / mount
    group(root, V1, UNLIMITED, 9000)
    group(root / "slurm/uid_1/job_7", V1, UNLIMITED, 200)
    assert left(tmp_path, *lines) is None
    group(root / "slurm/uid_1", V1, 3000, 700, 50)
    assert left(tmp_path, *lines) == 2350


def test_a_container_that_shows_its_own_group_in_place_of_the_root(tmp_path):
    """The path is that of the host, and not there."""
    group(tmp_path / "cgroup/memory", V1, 1000, 300)
    assert left(tmp_path, "4:memory:/docker/1234") == 700
    assert left(tmp_path, "4:memory:/../../other") == 700


def test_the_limit_is_heeded(monkeypatch):
    monkeypatch.setattr(memory, "left_in_groups", lambda: 12345)
    assert memory.available_memory() == 12345
