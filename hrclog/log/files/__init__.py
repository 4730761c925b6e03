"""Files as the operating system has them: found, locked, told apart by their first bytes, unpacked."""
