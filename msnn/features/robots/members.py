"""Calls of robots, as the compiler lowers them."""

from compiler.elaboration.part_members import PartMembers
from compiler.robots.calls import lower_robot_call, unknown_member

MEMBERS = PartMembers(call=lower_robot_call, unknown=unknown_member)
