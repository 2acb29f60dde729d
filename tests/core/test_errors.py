"""The error tree carries the exit statuses of the command line."""

import pytest

from gcs.core import errors


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (errors.InputError, 2),
        (errors.NotFoundError, 2),
        (errors.InfeasibleError, 3),
        (errors.LinkError, 4),
        (errors.RefusedError, 5),
        (errors.ConflictError, 5),
        (errors.IncompleteError, 6),
    ],
)
def test_exit_statuses_are_those_of_the_command_line(error, status):
    assert error("x").exit_status == status
    assert issubclass(error, errors.GcsError)


def test_the_field_stands_before_the_message():
    assert str(errors.InputError("is empty", field="crane.stl")) == "crane.stl: is empty"
    assert str(errors.InputError("is empty")) == "is empty"
