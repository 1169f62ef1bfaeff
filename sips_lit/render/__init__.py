"""Pictures for people: points, matches, curves and reliability diagrams."""
