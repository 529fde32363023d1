from dlokit.skills.viewer.state import Newest


def test_each_value_is_returned_once_and_only_the_newest() -> None:
    fresh, seen = Newest[int](), list[int]()
    assert not fresh.take(seen.append)
    fresh.put(1)
    fresh.put(2)
    assert fresh.take(seen.append)
    assert not fresh.take(seen.append)
    assert seen == [2]


def test_a_value_can_be_returned_again() -> None:
    fresh, seen = Newest[int](), list[int]()
    fresh.again()
    assert not fresh.take(seen.append)
    fresh.put(3)
    fresh.take(seen.append)
    fresh.again()
    fresh.take(seen.append)
    assert seen == [3, 3]
