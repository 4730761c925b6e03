"""Recorder, reader, recovery and annotations agree with a model, whatever happens in whichever order."""

from __future__ import annotations

from hypothesis import settings
from recording_machine import RecordingMachine
from sizes import many

TestRecording = RecordingMachine.TestCase
TestRecording.settings = settings(max_examples=many(4, fuzz=300), stateful_step_count=many(12, fuzz=40), deadline=None)
