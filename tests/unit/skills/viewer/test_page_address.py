import pytest
from unheard_page import every_port_is_free

from dlokit.errors import MachineError
from dlokit.skills.viewer.serving.address import lasting_port, new_key, page_url, watch_key


@pytest.mark.parametrize(
    ("host", "port", "url"),
    [
        ("127.0.0.1", 8080, "http://127.0.0.1:8080/k"),
        ("0.0.0.0", 8080, "http://localhost:8080/k"),
        ("::", 8080, "http://localhost:8080/k"),
        ("::1", 8080, "http://[::1]:8080/k"),
        ("lab-pc", 80, "http://lab-pc/k"),
    ],
)
def test_the_address_can_be_opened_on_the_viewers_machine(host: str, port: int, url: str) -> None:
    assert page_url(host, port, "k") == url


def test_keys_are_random_and_fit_into_an_address() -> None:
    keys = {new_key() for _ in range(100)}
    assert len(keys) == 100
    assert all(len(key) == 32 and key.replace("-", "").replace("_", "").isalnum() for key in keys)


def test_watchers_have_another_key_that_is_always_the_same() -> None:
    key = new_key()
    assert watch_key(key) == watch_key(key) != key
    assert watch_key(key) != watch_key(new_key())
    assert len(watch_key(key)) == 32


def test_a_key_has_a_port_of_its_own_unless_another_program_has_it() -> None:
    port = lasting_port("127.0.0.1", "one", every_port_is_free)
    assert port == lasting_port("127.0.0.1", "one", every_port_is_free) > 0
    assert port != lasting_port("127.0.0.1", "another", every_port_is_free)

    def is_taken(host: str, asked: int) -> None:
        if asked == port:
            raise MachineError("another program has it")

    assert lasting_port("127.0.0.1", "one", is_taken) == 0
    assert lasting_port("127.0.0.1", "another", is_taken) > 0
