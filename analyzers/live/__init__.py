"""Follow runs while they are recorded: fold in new events, and draw them in a viewer."""
