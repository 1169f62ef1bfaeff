import pytest

from sips_lit.train.step_times import STEP, Stopwatch, advice, in_words

BUSY = {"select": 0.05, "forward": 0.1, "backward": 0.2, "decode": 0.3, "describe": 0.03, "match": 0.02, "track": 0.1}


def test_a_stopwatch_adds_up_by_stage():
    now = iter([0.0, 1.0, 5.0, 7.5])
    watch = Stopwatch(lambda: next(now))
    with watch("track"):
        pass
    with pytest.raises(ValueError, match="lost"), watch("track"):
        raise ValueError("lost")  # the time of a stage that fails counts, too
    watch.add("match", 2.0)
    assert watch.seconds == {"track": 3.5, "match": 2.0}


@pytest.mark.parametrize(
    ("waiting", "workers", "told"),
    [
        ({}, (2, 2, 4), "the network is the limit"),
        ({"wait_decode": 0.01, "wait_labels": 0.02}, (2, 2, 4), "the network is the limit"),
        ({"wait_decode": 0.2}, (2, 2, 4), "labels wait for decoding: more datamodule.loading_workers (now 2)"),
        ({"wait_decode": 0.2}, (0, 2, 4), "loading_workers (now none: the network reads them itself)"),
        ({"wait_decode": 0.2}, (4, 2, 4), "labels wait for decoding, and all 4 cores decode"),
        ({"wait_decode": 0.2}, (2, 0, 4), "the network waits for decoding: more datamodule.loading_workers"),
        ({"wait_labels": 0.2}, (2, 2, 4), "labels (track is 67% of it): more datamodule.labelling_workers (now 2)"),
        ({"wait_labels": 0.2}, (2, 4, 4), "and all 4 cores label: fewer module.points"),
        ({"wait_decode": 0.1, "wait_labels": 0.2}, (2, 2, 4), "more datamodule.labelling_workers"),
        ({"wait_decode": 0.2, "wait_labels": 0.1}, (2, 2, 4), "more datamodule.loading_workers"),
    ],
)
def test_advice_from_made_up_times(waiting, workers, told):
    assert told in advice(BUSY | waiting, *workers)


def test_waiting_is_judged_by_its_share_of_the_step():
    work = 0.35
    for share, limited in ((0.09, True), (0.11, False)):
        wait = work * share / (1 - share)
        assert advice(BUSY | {"wait_labels": wait}, 2, 2, 4).startswith("the network is the limit") == limited


def test_shares_are_of_the_step_not_of_what_workers_do_beside_it():
    line = in_words(BUSY | {"wait_decode": 0.05}, 2, 2, 4)
    assert line.startswith("400 ms a pair (backward 50%, forward 25%, waiting for frames 12%, select 12%): labels wait")
    assert "decode " not in line.partition(")")[0]


def test_no_times_at_all():
    assert in_words({}, 2, 2, 4).startswith("0 ms a pair ()")
    assert set(STEP).isdisjoint({"decode", "track"})
