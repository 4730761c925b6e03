"""The stepped cell: robot and human move in PyBullet, tick by tick."""
