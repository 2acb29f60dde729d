"""How alembic runs the steps: on the connection that the station gives it."""

from __future__ import annotations

from alembic import context

from gcs.storage.tables import Base

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=Base.metadata,
    render_as_batch=True,
)
with context.begin_transaction():
    context.run_migrations()
