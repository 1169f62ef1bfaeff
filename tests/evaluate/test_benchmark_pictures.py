from tiny_contenders import CONTENDERS, MEASURES

from sips_lit.evaluate.benchmark_pictures import draw_benchmark_pictures


def test_pictures(measured_flights, benchmark_folder):
    pairs, measured = measured_flights
    pictures = draw_benchmark_pictures(measured[:2], CONTENDERS, pairs, MEASURES, benchmark_folder / "features")
    assert set(pictures) == {"sips", "corners"}
    assert [picture.label for picture in pictures["sips"]] == ["best", "median", "worst"]
    assert all(picture.image.ndim == 3 for of in pictures.values() for picture in of)
