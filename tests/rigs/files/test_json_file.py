import json
import math

import numpy as np

from rigs.files.text import plain, write_json


def test_plain_data_are_what_json_holds(tmp_path):
    data = {
        "numbers": (np.float64(1 / 3), np.float32(0.5), np.int64(123456), 1e-30),
        "none": [math.nan, -math.inf, np.float32("nan"), None],
        7: {"words": "a", "met": np.True_},
    }
    found = plain(data, digits=3)
    assert found == {
        "numbers": [0.333, 0.5, 123456, 1e-30],
        "none": [None] * 4,
        "7": {"words": "a", "met": True},
    }
    assert plain(data)["numbers"][0] == 1 / 3
    write_json(tmp_path / "a.json", found)
    assert json.loads((tmp_path / "a.json").read_text("utf-8")) == found
