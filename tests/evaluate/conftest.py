from flights_measured import benchmark_folder, flights, measured_flights

__all__ = ["benchmark_folder", "flights", "measured_flights"]
