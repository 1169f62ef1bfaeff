from tiny_methods import MEASURES, METHODS

from sips_lit.report.method_pictures import draw_method_pictures


def test_pictures(measured_flights, benchmark_folder):
    pairs, measured = measured_flights
    pictures = draw_method_pictures(measured[:2], METHODS, pairs, MEASURES, benchmark_folder / "features")
    assert set(pictures) == {"sips", "corners"}
    assert [picture.label for picture in pictures["sips"]] == ["best", "median", "worst"]
    assert all(picture.image.ndim == 3 for of in pictures.values() for picture in of)
