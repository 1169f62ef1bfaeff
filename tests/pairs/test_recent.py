import numpy as np

from sips_lit.pairs.recent import Recent


def test_what_was_used_last_is_held_and_not_read_again():
    reads: list[str] = []

    def get(key: str, size: int) -> int:
        def read() -> int:
            reads.append(key)
            return size

        return recent.get(key, read)

    recent: Recent[int] = Recent(10, lambda size: size)
    assert [get("a", 4), get("b", 4), get("a", 4), get("c", 4)] == [4] * 4  # b goes: a was used after it
    assert (reads, recent.held) == (["a", "b", "c"], 8)
    get("a", 4)
    get("b", 4)
    assert reads == ["a", "b", "c", "b"]


def test_one_value_above_the_limit_is_held_alone():
    recent: Recent[np.ndarray] = Recent(10, lambda array: array.nbytes)
    small, large = np.zeros(8, np.uint8), np.zeros(50, np.uint8)
    recent.get("small", lambda: small)
    assert recent.get("large", lambda: large) is large
    assert recent.get("large", lambda: small) is large
    assert recent.held == 50
    assert recent.get("next", lambda: small) is small
    assert recent.held == 8
