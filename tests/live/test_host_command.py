"""`dlokit host` as a script starts it: in the background, where Ctrl-C is ignored, and ended by SIGTERM."""

import signal
import subprocess
import sys
from pathlib import Path

from dlokit.extras.hosts.certificates import make_certificates
from dlokit.extras.hosts.config import LabHost

DLOKIT = str(Path(sys.executable).with_name("dlokit"))
WAIT_S = 60.0  # a second on an idle machine


def test_a_host_in_the_background_ends_by_sigterm(tmp_path: Path) -> None:
    make_certificates(tmp_path / "lab", [LabHost(name="arm")])
    command = (DLOKIT, "host", "arm", "--connect", "tls/127.0.0.1:9", "--certificates", str(tmp_path / "lab"))
    with subprocess.Popen(
        ("sh", "-c", 'trap "" INT; exec "$@"', "sh", *command),
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as host:
        assert host.stdout is not None
        assert "host arm: decision is at tls/127.0.0.1:9" in host.stdout.readline()
        host.send_signal(signal.SIGTERM)
        assert host.wait(WAIT_S) == 130
