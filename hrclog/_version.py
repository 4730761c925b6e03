"""The version of hrclog."""

__version__ = "0.1.0"
