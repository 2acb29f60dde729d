import json
import math
from pathlib import Path

import pytest

from gcs.core.errors import InputError, NotFoundError
from gcs.services.benchmarks.paths import length_round_box, length_round_cylinder
from gcs.services.benchmarks.registry import list_benchmarks, run_benchmark


def tours_make_sense(tours):
    assert tours["face-4x88-open", "cost"] == pytest.approx(414.688, abs=1e-3)
    assert tours["face-4x88-closed", "cost"] == pytest.approx(479.377, abs=1e-3)
    assert all(value >= 0 for (_, figure), value in tours.items() if figure == "gap")


def paths_make_sense(paths):
    assert 0 < paths["any-angle-closed-form", "excess_length"] <= 0.01


MAKES_SENSE = {"tours": tours_make_sense, "paths": paths_make_sense}


@pytest.mark.parametrize("name", list(list_benchmarks()))
def test_the_quick_version_gives_rows_of_the_published_form(name):
    assert {"paths", "tours"} <= set(list_benchmarks())
    result = json.loads(json.dumps(run_benchmark(name, quick=True)))
    assert result["benchmark"] == name
    assert set(result["machine"]) == {"cpu", "cores", "python"}
    for row in result["rows"]:
        assert set(row) == {"case", "figure", "value", "unit", "reference", "reference_value"}
        assert isinstance(row["value"], float)
    if name in MAKES_SENSE:
        MAKES_SENSE[name]({(row["case"], row["figure"]): row["value"] for row in result["rows"]})


def test_the_closed_form_without_clearance_is_the_way_over_the_corners():
    assert length_round_box(3.0, 4.0, 6.0, 0.0) == pytest.approx(5 + 6 + 5)
    # from twice the radius: the tangents meet the circle at 60 degrees, so a third of it is gone round on each side
    assert length_round_cylinder(2.0, 6.0, 1.0) == pytest.approx(2 * math.sqrt(27) + 3 * math.pi / 3)


def test_unknown_names_and_needless_meshes_are_refused():
    with pytest.raises(NotFoundError, match="paths, predictions, tours"):
        run_benchmark("nothing")
    with pytest.raises(InputError, match="takes no mesh"):
        run_benchmark("tours", mesh=Path("crane.stl"))
