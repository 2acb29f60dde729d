import numpy as np
import pytest
from scipy import ndimage

from gcs.planning.scene.distance_transform import squared_distance_transform


@pytest.mark.parametrize("shape", [(7, 9, 11), (1, 5, 6), (5, 1, 1), (40, 33, 50)])
@pytest.mark.parametrize("share", [0.002, 0.05, 0.5])
def test_it_is_that_of_scipy(shape, share):
    rng = np.random.default_rng(1)
    marked = rng.random(shape) < share
    marked[tuple(rng.integers(0, shape))] = True
    np.testing.assert_array_equal(
        squared_distance_transform(marked), np.rint(ndimage.distance_transform_edt(~marked) ** 2)
    )


def test_without_marks_everything_is_far():
    assert squared_distance_transform(np.zeros((3, 4, 5), dtype=np.bool_)).min() >= 1e12
