import socket

import pytest

from dlokit.errors import MachineError
from dlokit.skills.viewer.page import check_port, close_page, open_page


def test_a_port_in_use_is_one_error_that_says_what_to_do() -> None:
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


def test_a_closed_page_gives_its_port_back_and_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    server = open_page("127.0.0.1", 0, "key")
    port = server.get_port()
    with pytest.raises(MachineError):
        check_port("127.0.0.1", port)
    close_page(server)
    check_port("127.0.0.1", port)
    assert capsys.readouterr().out == ""
