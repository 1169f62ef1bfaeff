from sips_lit.detect.turns import ROUNDS, least_seconds


def test_the_least_of_the_turns_counts_and_the_first_never():
    now, order = [0.0], []
    seconds = {"a": iter([1.0, 5, 3, 4]), "b": iter([90.0, 2, 9, 7])}

    def way(name: str):
        def run() -> None:
            order.append(name)
            now[0] += next(seconds[name])

        return run

    assert least_seconds({name: way(name) for name in seconds}, clock=lambda: now[0]) == {"a": 3, "b": 2}
    assert order == ["a", "b"] * (ROUNDS + 1)


def test_nothing_to_choose_from_takes_no_time():
    assert least_seconds({}) == {}
