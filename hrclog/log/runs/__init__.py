"""Which run events belong to that name none."""
