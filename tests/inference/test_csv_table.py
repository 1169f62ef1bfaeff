import numpy as np
import pytest

from sips_lit.errors import BadInputError
from sips_lit.inference.csv_table import CsvTable


def test_rows_read_back_exactly(tmp_path):
    path = tmp_path / "new" / "table.csv"
    table = CsvTable(path)
    table.append([["a", "b, c", None], [np.float32(1 / 3), 2, 'say "x"']])
    assert not path.exists(), "half a table has no name"
    table.append([["last"]])
    table.close()
    table.close()
    assert path.read_text() == 'a,"b, c",\n0.33333334,2,"say ""x"""\nlast\n'
    assert [file.name for file in path.parent.iterdir()] == ["table.csv"]


def test_a_table_that_cannot_be_is_told(tmp_path):
    (tmp_path / "table.csv").mkdir()
    with pytest.raises(BadInputError, match="which is a folder"):
        CsvTable(tmp_path / "table.csv")
    with pytest.raises(BadInputError, match="cannot make the folder"):
        CsvTable(tmp_path / "table.csv" / ("x" * 300) / "b.csv")
