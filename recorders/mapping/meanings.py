"""All that a topic may mean, by the name of its tables in a mapping file."""

from __future__ import annotations

from typing import Final

from hrclog.recorders.mapping.actions import Action
from hrclog.recorders.mapping.behavior_tree import BehaviorTree
from hrclog.recorders.mapping.meaning import Meaning
from hrclog.recorders.mapping.plansys2 import PlanSys2
from hrclog.recorders.mapping.safety import Safety
from hrclog.recorders.mapping.signals import Joints, Signal
from hrclog.recorders.mapping.states import States

MEANINGS: Final[dict[str, type[Meaning]]] = {
    meaning.kind: meaning for meaning in (Action, PlanSys2, BehaviorTree, States, Safety, Signal, Joints)
}
