import os
import re
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nothing.yaml"], "nothing.yaml: no such rig file"),
        (["nothing.zarr"], "nothing.zarr: no such store"),
        (["paper11_22deg", "--scan", "nothing"], "nothing"),
        (["paper11_22deg", "--rig", "rig.yaml"], "--rig and --images together"),
        (["volume.npz"], "volume.npz"),
    ],
)
def test_bad_input_is_one_line(refused, tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    Path("volume.npz").write_bytes(b"no archive")
    assert message in refused("view", *arguments, "--no-browser")


def test_it_serves_this_machine_alone_at_a_free_port_until_ctrl_c():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        run = [sys.executable, str(ROOT / "tools" / "view.py"), "paper11_22deg", "--no-browser"]
        process = subprocess.Popen(
            [*run, "--port", str(port)], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        line = process.stderr.readline()
        found = int(re.search(r"http://127\.0\.0\.1:(\d+)", line)[1])
        assert found > port
        with urllib.request.urlopen(f"http://127.0.0.1:{found}") as answer:
            assert answer.status == 200
        with socket.socket() as other, pytest.raises(ConnectionRefusedError):
            other.connect(("127.0.0.2", found))  # a server at all addresses would answer
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    assert out == ""
