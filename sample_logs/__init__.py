"""Small real logs, see README.md beside this file."""
