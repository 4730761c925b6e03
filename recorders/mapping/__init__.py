"""What foreign topics mean: one mapping file, whatever transport the messages come by."""
