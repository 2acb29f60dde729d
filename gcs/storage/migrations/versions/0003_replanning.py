"""What replanning reports tell beyond the piece that was flown; plans offered for what was skipped."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    with op.batch_alter_table("replan_reports", schema=None) as batch_op:
        batch_op.add_column(sa.Column("plan_hash_after", sa.String(), nullable=True))
        batch_op.add_column(sa.Column("obstacle", sa.JSON(), nullable=True))
        batch_op.add_column(sa.Column("viewpoints", sa.JSON(), nullable=False, server_default="[]"))
        batch_op.alter_column("rejoined_at_s", existing_type=sa.Double(), nullable=True)
        batch_op.drop_column("matches_plan")  # follows from the hashes
    with op.batch_alter_table("replan_reports", schema=None) as batch_op:
        batch_op.alter_column("viewpoints", server_default=None)
    op.create_table(
        "plan_offers",
        sa.Column("id", sa.String(), nullable=False),
        sa.Column("flight_id", sa.String(), nullable=False),
        sa.Column("state", sa.String(), nullable=False),
        sa.Column("created_at", sa.String(), nullable=False),
        sa.Column("viewpoints", sa.JSON(), nullable=False),
        sa.Column("names", sa.JSON(), nullable=False),
        sa.Column("length_m", sa.Double(), nullable=True),
        sa.Column("duration_s", sa.Double(), nullable=True),
        sa.Column("decided_at", sa.String(), nullable=True),
        sa.Column("plan_id", sa.String(), nullable=True),
        sa.Column("failure", sa.JSON(), nullable=True),
        sa.ForeignKeyConstraint(
            ["flight_id"], ["flights.id"], name=op.f("fk_plan_offers_flight_id_flights"), ondelete="RESTRICT"
        ),
        sa.ForeignKeyConstraint(
            ["plan_id"], ["plans.id"], name=op.f("fk_plan_offers_plan_id_plans"), ondelete="SET NULL"
        ),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_plan_offers")),
    )
    op.create_index(op.f("ix_plan_offers_flight_id"), "plan_offers", ["flight_id"], unique=False)


def downgrade() -> None:
    op.drop_table("plan_offers")
    with op.batch_alter_table("replan_reports", schema=None) as batch_op:
        batch_op.add_column(sa.Column("matches_plan", sa.Boolean(), nullable=False, server_default=sa.false()))
        batch_op.alter_column("rejoined_at_s", existing_type=sa.Double(), nullable=False)
        batch_op.drop_column("viewpoints")
        batch_op.drop_column("obstacle")
        batch_op.drop_column("plan_hash_after")
