"""Field types of the scenario's models, and their base."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Point3 = tuple[Finite, Finite, Finite]
Point2 = tuple[Finite, Finite]


class Strict(BaseModel):
    """Base of all scenario models: frozen, and a field that is not known is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")
