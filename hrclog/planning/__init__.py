"""What is to be done and by whom: problems, plans, their order and how they are dispatched."""
