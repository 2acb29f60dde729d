"""The part of an inspection that one of several flights does."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.core.plan import CellNote, FaceCoverage

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from gcs.core.inspection import FaceTask
    from gcs.core.scenario import Scenario

MOST_OF_A_NAME = 90
"""Characters of the whole plan's name that are kept in those of its flights."""


def part_of_scenario(scenario: Scenario, names: Collection[str], label: str) -> Scenario:
    """What one flight is asked for: the points that it pictures; surface and faces stay, it sees part of them.

    Args:
        scenario: of the whole.
        names: of the flight's viewpoints.
        label: which flight it is, for the name.
    """
    inspection = scenario.inspection
    if inspection is not None:
        mine = tuple(point for point in inspection.points if point.name in names)
        inspection = inspection.model_copy(update={"points": mine})
    return scenario.model_copy(update={"name": f"{scenario.name[:MOST_OF_A_NAME]}, {label}", "inspection": inspection})


def part_of_faces(
    scenario: Scenario, faces: Sequence[FaceCoverage], names: Collection[str]
) -> tuple[FaceCoverage, ...]:
    """What becomes of the cells of faces in one flight: those of the others are not covered by it.

    Args:
        scenario: names the cells.
        faces: of the whole, in the scenario's order.
        names: of the flight's viewpoints.
    """
    tasks = scenario.inspection.faces if scenario.inspection else ()
    return tuple(_part_of_face(task, face, names) for task, face in zip(tasks, faces, strict=True))


def _part_of_face(task: FaceTask, face: FaceCoverage, names: Collection[str]) -> FaceCoverage:
    left_out = {note.cell for note in face.not_covered}
    cells = (task.cell_name(row, column) for row in range(task.rows) for column in range(task.columns))
    others = tuple(
        CellNote(cell, "another flight of the same plan pictures it")
        for cell in cells
        if cell not in names and cell not in left_out
    )
    return FaceCoverage(
        name=face.name,
        cells=face.cells,
        moved=tuple(note for note in face.moved if note.cell in names),
        not_covered=(*face.not_covered, *others),
    )
