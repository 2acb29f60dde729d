"""What flights have shown of their vehicles, and how a flight's mission was sampled."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "learned_dynamics",
        sa.Column("vehicle", sa.String(), nullable=False),
        sa.Column("flight_id", sa.String(), nullable=False),
        sa.Column("learned_at", sa.String(), nullable=False),
        sa.Column("drag_s", sa.Double(), nullable=True),
        sa.Column("drag_sigma_s", sa.Double(), nullable=True),
        sa.Column("lag_s", sa.Double(), nullable=True),
        sa.Column("lag_sigma_s", sa.Double(), nullable=True),
        sa.Column("tilt_lag_s", sa.Double(), nullable=True),
        sa.Column("tilt_lag_sigma_s", sa.Double(), nullable=True),
        sa.ForeignKeyConstraint(
            ["flight_id"], ["flights.id"], name=op.f("fk_learned_dynamics_flight_id_flights"), ondelete="RESTRICT"
        ),
        sa.PrimaryKeyConstraint("vehicle", name=op.f("pk_learned_dynamics")),
    )
    with op.batch_alter_table("flights", schema=None) as batch_op:
        batch_op.add_column(sa.Column("mission_sampling", sa.JSON(), nullable=True))


def downgrade() -> None:
    with op.batch_alter_table("flights", schema=None) as batch_op:
        batch_op.drop_column("mission_sampling")
    op.drop_table("learned_dynamics")
