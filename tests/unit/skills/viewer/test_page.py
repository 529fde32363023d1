import re
import socket
import urllib.request

import pytest

from dlokit.errors import MachineError
from dlokit.skills.viewer.serving.address import new_key
from dlokit.skills.viewer.serving.page import check_port, close_page, open_page


def test_a_port_in_use_is_one_error_with_a_remedy() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(MachineError, match=rf"port {port} .*--port"):
            check_port("127.0.0.1", port)
        with pytest.raises(MachineError, match=rf"port {port} "):
            open_page("127.0.0.1", port, "key")


def test_an_address_of_another_machine_is_an_error_and_not_a_wait() -> None:
    with pytest.raises(MachineError, match=r"192\.0\.2\.1"):  # reserved for documentation: nobody has it
        check_port("192.0.2.1", 0)


@pytest.mark.parametrize("encoding", ["gzip", "identity"])
def test_the_browsers_tab_is_named_dlokit(encoding: str) -> None:
    server = open_page("127.0.0.1", 0, "key")
    try:
        request = urllib.request.Request(f"http://127.0.0.1:{server.get_port()}/key/")
        request.add_header("Accept-Encoding", encoding)
        with urllib.request.urlopen(request, timeout=20.0) as answer:
            page = answer.read().decode()
    finally:
        close_page(server)
    assert re.findall("<title>(.*?)</title>", page) == ["dlokit"]


def test_a_closed_page_releases_its_port_and_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    server = open_page("127.0.0.1", 0, new_key())  # the port follows from the key: no other test may take it
    port = server.get_port()
    with pytest.raises(MachineError):
        check_port("127.0.0.1", port)
    close_page(server)
    check_port("127.0.0.1", port)
    assert capsys.readouterr().out == ""
