"""A row of the table by the keys of its columns."""

from sips_lit.report.columns import columns_of


class Row:
    """The values of all columns of a method by key, and their deviations."""

    def __init__(self, result) -> None:
        columns = columns_of([result])
        self.values = {column.key: column.value(result) for column in columns}
        self.deviations = {column.key: column.deviation(result) for column in columns if column.deviation}

    def __getitem__(self, key) -> float:
        return self.values[key]
